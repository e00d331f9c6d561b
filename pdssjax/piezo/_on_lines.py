"""A composed stack under a voltage of straight lines: all its corners at once, then all samples.

Only the elements of hysteresis have to be passed one corner after the other.  Creep and mechanics are
linear: what a line adds to them is known for all lines side by side, and a short recurrence joins them.  Curved
segments are taken as many short lines.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int

from ..core import ScalarLike
from ..drive.base import Segment
from ._dynamics import AbstractDynamics, Aim, shifted_powers

_MOST_ALTOGETHER = 100_000
"""Lines of a chain, unless `_FEWEST` of a segment are more: their states, with derivatives, take memory."""

_MOST = 2000
"""Lines a segment; with so many the voltage is off by 6e-7 of the swing of a sine, (2 pi / lines)^2 / 16, at most."""

_FEWEST = 256
"""Minimum chords per segment; relative error below 4e-5."""


def lines_a_segment(segments: int) -> int:
    """Into how many lines each of so many curved segments is divided."""
    return min(max(_MOST_ALTOGETHER // segments, _FEWEST), _MOST)


def straightened(segments: Segment, many: int) -> Segment:
    """The chords of `many` equal parts of every segment, one after the other.

    **Arguments:** `segments` are arrays of shape (k,), all of finite length.

    **Returns:** arrays of shape (k `many`,), without a wave.
    """
    parts = jnp.arange(many + 1) / many
    times = segments.duration[:, None] * parts
    of_segment = lambda segment, at: jax.vmap(lambda t: segment.voltage(t).level)(at)
    levels = jax.vmap(of_segment)(segments, times)
    lasts = jnp.repeat(segments.duration / many, many)
    rises = jnp.diff(levels, axis=1).ravel()
    slopes = jnp.where(lasts > 0.0, rises, 0.0) / jnp.where(lasts > 0.0, lasts, 1.0)
    return Segment(lasts, levels[:, :-1].ravel(), slopes)


def place_among_lines(
    segments: Segment, places: Int[Array, " m"], t_local: Float[Array, " m"], many: int
) -> tuple[Int[Array, " m"], Float[Array, " m"]]:
    """The line of `straightened` in which a moment is, `t_local` [s] into its segment, and how far into it [s]."""
    lasts = segments.duration[places] / many
    part = jnp.floor(t_local / jnp.where(lasts > 0.0, lasts, 1.0)).astype(int)
    part = jnp.clip(part, 0, many - 1)
    return places * many + part, t_local - part * lasts


TOGETHER = 512
"""Samples evaluated at once: the intermediate results of many, with their derivatives, would fill the memory."""


class CeramicArrays(NamedTuple):
    """Numbers of hysteresis, asymmetry and creep, as arrays."""

    memoryless: tuple[ScalarLike, ...]
    """Coefficients of the voltage, its square, ... [m/V], [m/V^2], ..."""
    weights: Float[Array, " n"]
    """Weights of the elements [m/V]."""
    thresholds: Float[Array, " n"]
    """[V]"""
    shares: Float[Array, " m"]
    """Gains of creep [m/V]."""
    times: Float[Array, " m"]
    """Time constants of creep [s]."""


class Moment(NamedTuple):
    """A stack at the begin of a line, or within it; arrays of several have the lines first."""

    mechanics: Float[Array, "*k q"]
    stops: Float[Array, "*k n"]
    """How far the voltage is ahead of each element [V]."""
    crept: Float[Array, "*k m"]
    """[m]"""


class Line(NamedTuple):
    """A stretch of voltage; arrays of several have the lines first."""

    start: Float[Array, "*k"]
    """[V]"""
    slope: Float[Array, "*k"]
    """[V/s]"""


def aim_on_line(ceramic: CeramicArrays, line: Line, stops: Float[Array, " n"], crept: Float[Array, " m"]) -> Aim:
    """The aim from the begin of a line on."""
    begin, slope = line
    base = shifted_powers((0.0, *ceramic.memoryless), begin, slope)
    steady = ceramic.shares * (begin - slope * ceramic.times)
    level = base[0] + ceramic.weights @ (begin - stops) + jnp.sum(steady)
    rise = base[1] + jnp.sum(ceramic.shares) * slope
    way = ceramic.thresholds - jnp.where(slope < 0.0, -1.0, 1.0) * stops
    begins = way / jnp.where(slope != 0.0, jnp.abs(slope), 1.0)
    return Aim((level, rise, *base[2:]), ceramic.weights * slope, begins, crept - steady, 1.0 / ceramic.times)


def advanced(
    ceramic: CeramicArrays, dynamics: AbstractDynamics, line: Line, begin: Moment, elapsed: ScalarLike
) -> Moment:
    """The stack `elapsed` [s] after the `begin` of a line, without a force."""
    aim = aim_on_line(ceramic, line, begin.stops, begin.crept)
    mechanics = dynamics.advanced(tuple(begin.mechanics), aim, elapsed)
    run = line.slope * elapsed
    stops = jnp.clip(begin.stops + run, -ceramic.thresholds, ceramic.thresholds)
    end = ceramic.shares * (line.start + run - line.slope * ceramic.times)
    crept = end + aim.amplitudes * jnp.exp(-aim.rates * elapsed)
    return Moment(jnp.asarray(mechanics, float), stops, crept)


def begins_of_lines(
    ceramic: CeramicArrays,
    dynamics: AbstractDynamics,
    lines: Line,
    durations: Float[Array, " k"],
    voltage: ScalarLike,
    begin: Moment,
) -> Moment:
    """The stack just after each corner; `voltage` is the voltage [V] before the first, in the state `begin`."""
    run = lines.slope * durations
    jump = lines.start - jnp.concatenate([jnp.reshape(jnp.asarray(voltage, float), 1), (lines.start + run)[:-1]])
    limit = lambda stops: jnp.clip(stops, -ceramic.thresholds, ceramic.thresholds)

    def pass_corner(
        stops: Float[Array, " n"], ways: tuple[Float[Array, ""], Float[Array, ""]]
    ) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        after = limit(stops + ways[0])
        return limit(after + ways[1]), after

    _, stops = lax.scan(pass_corner, begin.stops, (jump, run))
    fades = jnp.exp(-durations[:, None] / ceramic.times)
    begun = ceramic.shares * (lines.start[:, None] - lines.slope[:, None] * ceramic.times)
    added = begun * (1.0 - fades) + ceramic.shares * run[:, None]
    crept = _recurrence(begin.crept, fades, added, lambda fade, c: fade * c)
    still = jnp.zeros_like(begin.mechanics)
    of_line = lambda line, stops, crept, time: advanced(ceramic, dynamics, line, Moment(still, stops, crept), time)
    gained = jax.vmap(of_line)(lines, stops, crept, durations).mechanics
    free = lambda time: jnp.stack([_free(dynamics, e, time) for e in jnp.eye(still.size)], axis=1)
    turns = jax.vmap(free)(durations) if still.size else jnp.zeros((durations.size, 0, 0))
    mechanics = _recurrence(begin.mechanics, turns, gained, lambda turn, x: turn @ x)
    return Moment(mechanics, stops, crept)


def inside_lines(
    ceramic: CeramicArrays, dynamics: AbstractDynamics, lines: Line, begins: Moment, elapsed: Float[Array, " samples"]
) -> Moment:
    """The stack `elapsed` [s] after the begins of as many lines."""
    of_sample = lambda at: advanced(ceramic, dynamics, *at)
    arguments = lines, begins, elapsed
    if elapsed.size <= TOGETHER:
        return jax.vmap(of_sample)(arguments)
    # What a stack does not have is no part of the map, which refuses arrays without elements.
    has = [begin.shape[-1] > 0 for begin in begins]
    kept = lambda at: [part for part, there in zip(of_sample(at), has, strict=True) if there]
    parts = iter(lax.map(kept, arguments, batch_size=TOGETHER))
    return Moment(*(next(parts) if there else begin for begin, there in zip(begins, has, strict=True)))


def _free(dynamics: AbstractDynamics, state: Float[Array, " q"], time: ScalarLike) -> Float[Array, " q"]:
    """Where the mechanics go by themselves."""
    none = jnp.zeros(0)
    aim = Aim((jnp.zeros(()), jnp.zeros(())), none, none, none, none)
    return jnp.asarray(dynamics.advanced(tuple(state), aim, time), float)


def _recurrence(
    begin: Float[Array, " q"], factors: Array, added: Float[Array, "k q"], times: Callable[[Array, Array], Array]
) -> Float[Array, "k q"]:
    """x_0 = `begin`, x_(k+1) = factor_k x_k + added_k: the first k of them."""

    def pass_line(x: Array, line: tuple[Array, Array]) -> tuple[Array, Array]:
        return times(line[0], x) + line[1], x

    return lax.scan(pass_line, begin, (factors, added))[1]
