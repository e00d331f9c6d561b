"""Metrics of an actuator's motion and force in each cycle (thesis, sections 3.4 and 3.5).

In every cycle of a sawtooth drive the end-effector rides forward with the platform (stick) and
slides back when the platform does (slip).  With the stroke S of the stick phase, the back-slip S_0
of the slip phase and the frequency f,

    net step          dS = S - S_0
    step efficiency   eta_e = (S - S_0) / S        (3.1), as a fraction
    average speed     v = f dS

(3.1) leaves open where the stick phase begins.  Here a line is fitted to the middle of every slow
flank, where the ring-down of the slip has decayed:

- dS is the distance from the middle of one flank to the middle of the next;
- S is the flank's slope times the time it sticks: the period less the slip's duration.  With none
  given, the lines reach to the drop, and what the ring-down moves counts as slip;
- S_0 = S - dS.

A line fitted by least squares neither favours nor avoids noise, while the highest and lowest
samples (`turning_points`, what one reads off a plot) do: they widen S and S_0 by up to some
standard deviations of the noise each.  The fitted part lies symmetrically about the flank's
middle, so that a flank bent by the hysteresis of the piezo keeps its S, dS and S_0.

The functions on cycles work under `jit`, `vmap` and `grad`; they take the number of cycles as a
Python number, since it is the shape of what they return.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.ops import segment_max, segment_min, segment_sum
from jaxtyping import Array, Float, Int

Samples = Float[Array, " m"] | Float[np.ndarray, " m"]

Number = Float[Array, ""] | float

FLANK = (0.2, 0.8)
"""Fitted part of a slow flank, as fractions of it; symmetric about its middle."""

PLATEAU = (0.75, 0.95)
"""The part whose line gives the output force; short of the end, since the drop's time is not known to a sample."""

LEAST_SAMPLES = 4
"""Samples that a fitted part must hold; with fewer, the cycle's entries are NaN."""


class CycleMetrics(NamedTuple):
    """Metrics of each cycle, shape (cycles,).  All lengths are negative where the drive is backward."""

    stroke: Float[Array, " cycles"]
    """S, the motion of the stick phase [m]."""
    back_slip: Float[Array, " cycles"]
    """S_0, the motion that the slip takes back [m]; of the other sign than S where it adds to it."""
    net_step: Float[Array, " cycles"]
    """S - S_0 [m]."""
    efficiency: Float[Array, " cycles"]
    """(3.1) as a fraction: 1 without back-slip, negative where a load wins."""
    speed: Float[Array, " cycles"]
    """Average speed [m/s]."""
    noise: Float[Array, " cycles"]
    """Standard deviation of the samples about the flank's line [m]."""


class TurningPoints(NamedTuple):
    """The extreme samples on either side of each slip, shape (slips,)."""

    before: Float[Array, " slips"]
    """The furthest along the slow flank, within a quarter of a period before the slip's end."""
    after: Float[Array, " slips"]
    """The furthest back, within a quarter of a period after the slip."""


class ForceMetrics(NamedTuple):
    """Forces of each cycle of a blocked-force record, shape (cycles,) [N]."""

    output: Float[Array, " cycles"]
    """Force at the end of the slow flank by its line: what the thesis reads as the maximum, free of the noise."""
    maximum: Float[Array, " cycles"]
    """The highest sample, noise included."""
    minimum: Float[Array, " cycles"]
    mean: Float[Array, " cycles"]


@partial(jax.jit, static_argnames="cycles")
def cycle_metrics(
    time: Samples, displacement: Samples, frequency: Number, start: Number, cycles: int, slip_duration: Number = 0.0
) -> CycleMetrics:
    """Stroke, back-slip, step efficiency (3.1) and speed of each cycle of a stick-slip motion.

    **Arguments:** `time` [s] ascends; `displacement` [m] is the end-effector's; `frequency` [Hz];
    `start` [s] is when a slip begins, from which on `cycles` cycles are counted, each a slow
    flank and the slip at its end.  The samples must reach 0.8 of a cycle beyond them, since the
    last slip is told by the flank that follows; where they do not, the last entries are NaN.
    `slip_duration` [s] is how long a slip takes: the fall time of the drive, or more if the
    ring-down is not to count as sticking.

    A drift of the zero adds to S and to dS alike, and cannot be told from a net motion.
    """
    time, displacement = jnp.asarray(time), jnp.asarray(displacement)
    period = 1.0 / frequency
    sticks = period - slip_duration
    level, slope, noise = _lines(time, displacement, period, start + slip_duration, sticks, cycles + 1, FLANK)
    stroke, net = slope[:-1] * sticks, jnp.diff(level)
    return CycleMetrics(stroke, stroke - net, net, net / stroke, net * frequency, noise[:-1])


@partial(jax.jit, static_argnames="slips")
def turning_points(
    time: Samples, displacement: Samples, frequency: Number, start: Number, slips: int, slip_duration: Number = 0.0
) -> TurningPoints:
    """The highest sample before each slip and the lowest after it, for a slow flank that rises.

    **Arguments:** as for `cycle_metrics`; the first slip is the one at `start`.  Give
    -displacement where the slow flank falls.

    Of these, S = before[1:] - after[:-1] and S_0 = before[1:] - after[1:].  Slips without
    samples beside them give infinities.
    """
    time, displacement = jnp.asarray(time), jnp.asarray(displacement)
    period = 1.0 / frequency
    # Slip k owns the samples from a half period before it to a half period after.
    turn = (time - start) / period
    slip = jnp.floor(turn + 0.5).astype(int)
    phase = turn - slip
    group = jnp.where((slip >= 0) & (slip < slips), slip, slips)
    before = jnp.where((phase > -0.25) & (phase * period <= slip_duration + 1e-9 * period), displacement, -jnp.inf)
    after = jnp.where((phase >= 0) & (phase * period < slip_duration + 0.25 * period), displacement, jnp.inf)
    return TurningPoints(segment_max(before, group, slips + 1)[:-1], segment_min(after, group, slips + 1)[:-1])


@partial(jax.jit, static_argnames="cycles")
def force_metrics(
    time: Samples, force: Samples, frequency: Number, start: Number, cycles: int, slip_duration: Number = 0.0
) -> ForceMetrics:
    """Output force of each cycle of an actuator that pushes a force sensor (section 3.5).

    **Arguments:** as for `cycle_metrics`, with the `force` [N] on the sensor, positive where it
    grows along the slow flank; no samples beyond the last cycle are needed.

    Since the force is a sawtooth too, the thesis compares maxima.  The highest of n samples
    exceeds the truth by up to sqrt(2 log n) standard deviations of the noise; so the output
    force is read at the end of the flank off a line through the fifth of it before the last 5 %.
    """
    time, force = jnp.asarray(time), jnp.asarray(force)
    period = 1.0 / frequency
    sticks = period - slip_duration
    level, slope, _ = _lines(time, force, period, start + slip_duration, sticks, cycles, PLATEAU)
    end = level + slope * (1.0 - 0.5 * sum(PLATEAU)) * sticks
    group, _ = _groups(time, period, start, cycles)
    count = segment_sum(jnp.ones_like(time), group, cycles + 1)
    mean = segment_sum(force, group, cycles + 1) / count
    highest, lowest = segment_max(force, group, cycles + 1), segment_min(force, group, cycles + 1)
    return ForceMetrics(end, highest[:-1], lowest[:-1], mean[:-1])


def _groups(
    time: Float[Array, " m"], period: Number, start: Number, count: int
) -> tuple[Int[Array, " m"], Float[Array, " m"]]:
    """The cycle of each sample, `count` for those outside, and the time since it began."""
    turn = jnp.floor((time - start) / period)
    inside = (turn >= 0) & (turn < count)
    return jnp.where(inside, turn, count).astype(int), time - start - turn * period


def _lines(
    time: Float[Array, " m"],
    values: Float[Array, " m"],
    period: Number,
    start: Number,
    duration: Number,
    count: int,
    part: tuple[float, float],
) -> tuple[Float[Array, " cycles"], Float[Array, " cycles"], Float[Array, " cycles"]]:
    """Lines by least squares through `part` of each slow flank, which lasts `duration` from `start` on.

    Returns their values in the middle of `part`, their slopes, and the standard deviation about
    them, shape (count,) each; NaN where there are too few samples.
    """
    group, since = _groups(time, period, start, count)
    weight = jnp.where((since >= part[0] * duration) & (since <= part[1] * duration), 1.0, 0.0)
    total = lambda terms: segment_sum(weight * terms, group, count + 1)[:-1]
    samples = total(jnp.ones_like(since))
    enough = samples >= LEAST_SAMPLES
    held = jnp.where(enough, samples, LEAST_SAMPLES)
    # About the means of each flank, so that nothing cancels.
    spread = lambda per_flank: jnp.append(per_flank, 0.0)[group]
    mean_time, mean_value = total(since) / held, total(values) / held
    moment, deviation = since - spread(mean_time), values - spread(mean_value)
    square = total(moment**2)
    slope = total(moment * deviation) / jnp.where(enough, square, 1.0)
    residual = deviation - spread(slope) * moment
    variance = total(residual**2) / (held - 2)
    # The square root has no derivative at 0, which a noiseless record reaches.
    noise = jnp.sqrt(jnp.where(variance > 0, variance, 1.0)) * (variance > 0)
    level = mean_value + slope * (0.5 * (part[0] + part[1]) * duration - mean_time)
    clear = lambda lines: jnp.where(enough, lines, jnp.nan)
    return clear(level), clear(slope), clear(noise)


class CycleDrift(NamedTuple):
    """Net displacement and stroke of a cycle, in the unit of the samples."""

    net: float
    """Mean displacement from one cycle to the next."""
    standard_error: float
    """Standard error of `net` from the scatter of the samples, with independent noise."""
    stroke: float
    """Range within a cycle after the drift is removed."""


def drift_per_cycle(
    time: Float[np.ndarray, " n"], values: Float[np.ndarray, " n"], frequency: float
) -> CycleDrift | None:
    """Compare every sample with that one cycle later; the first cycle is left out where there are three.

    **Arguments:** `time` [s] ascends; `frequency` in cycles a second [Hz].

    **Returns:** None where the samples cover less than two cycles.
    """
    period = 1.0 / frequency
    covered = (time[-1] - time[0]) * frequency
    if covered < 2.0 - 1e-6:
        return None
    begin = time[0] + (period if covered > 3.0 else 0.0)
    whole = int((time[-1] - begin) * frequency + 1e-6) - 1
    first = (time >= begin) & (time < begin + whole * period)
    steps = np.interp(time[first] + period, time, values) - values[first]
    straight = values - np.mean(steps) * (time - time[0]) * frequency
    return CycleDrift(float(np.mean(steps)), float(np.std(steps) / np.sqrt(steps.size)), float(np.ptp(straight)))
