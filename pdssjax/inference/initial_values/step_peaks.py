"""The parameters of a system with one mode from the extremes of its step response.

After a step at t = 0 a second-order system of final value K, natural frequency w and damping ratio xi is extreme at

    t_n = n pi / (w sqrt(1 - xi^2)),    y_n = K (1 - (-a)^n),    a = exp(-pi xi / sqrt(1 - xi^2)),

highs and lows in turn.  Inverted as in the thesis's appendix 1: half a period is the mean of t_n / n; log a the mean
of log|y_n / K - 1| / n, the first overshoot with as much weight as all together; and K the sum of y_n over that of
1 - (-a)^n.  The last two depend on each other and are iterated until they converge (in the thesis until K changes by
less than 0.5 %).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

APART = 1.7
"""Half periods after an extreme within which the next one is searched: more than one, less than two."""

_ROUNDS = 30
"""Iterations; at a damping ratio of 0.18 five leave 1e-12 of the final value, at 0.02 twenty."""

_LEAST = 1e-9
"""Least overshoot, as a fraction of the final value, so that its logarithm is finite."""


class Extremes(NamedTuple):
    """The first extremes of a step response, the first a high; any shape before the last."""

    times: Float[np.ndarray, "... peaks"]
    """Since the step [s]."""
    heights: Float[np.ndarray, "... peaks"]
    """Above the rest before it, in the direction of the step."""


class OneMode(NamedTuple):
    """A second-order system under a step; any shape."""

    final: Float[np.ndarray, "..."]
    """Final value, in the unit of the heights."""
    natural_frequency: Float[np.ndarray, "..."]
    """[rad/s]"""
    damping_ratio: Float[np.ndarray, "..."]


def overshoot_to_damping(log_overshoot: Float[np.ndarray, "..."] | float) -> Float[np.ndarray, "..."]:
    """The damping ratio at which the first overshoot is exp(`log_overshoot`) of the final value."""
    return -np.asarray(log_overshoot) / np.hypot(np.pi, log_overshoot)


def half_period_to_frequency(
    half_period: Float[np.ndarray, "..."] | float, damping_ratio: Float[np.ndarray, "..."] | float
) -> Float[np.ndarray, "..."]:
    """The natural frequency [rad/s] from extreme to extreme [s]."""
    return np.pi / np.asarray(half_period) / np.sqrt(1.0 - np.square(damping_ratio))


def rest_before(time: Float[np.ndarray, " n"], displacement: Float[np.ndarray, " n"]) -> tuple[float, int]:
    """The mean before the step, and of how many samples; the first sample where none is before it."""
    before = time < 0.0
    return (float(np.mean(displacement[before])), int(before.sum())) if before.any() else (float(displacement[0]), 1)


def step_response(system: OneMode, time: Float[np.ndarray, " n"]) -> Float[np.ndarray, "... n"]:
    """Displacement at `time` [s] since the step, shape (..., n); 0 before it."""
    final, frequency, damping = (np.asarray(part)[..., None] for part in system)
    elapsed = np.maximum(time, 0.0)
    ring = frequency * np.sqrt(1.0 - damping**2)
    wave = np.cos(ring * elapsed) + damping * frequency / ring * np.sin(ring * elapsed)
    return final * (1.0 - np.exp(-damping * frequency * elapsed) * wave)


def extremes(time: Float[np.ndarray, " n"], height: Float[np.ndarray, "... n"], count: int) -> Extremes:
    """The first `count` extremes of responses sampled at `time` [s] since the step: samples, nothing in between.

    The highest sample of all is the first one, then the lowest and the highest in turn, each within `APART` half
    periods after the one before; samples before the step (t <= 0) take no part.

    **Arguments:** `height` above the rest before the step, in its direction, shape (..., n).
    """
    after = np.broadcast_to(time > 0.0, height.shape)
    places = [np.argmax(np.where(after, height, -np.inf), axis=-1)]
    half_period = time[places[0]][..., None]
    for n in range(2, count + 1):
        before = time[places[-1]][..., None]
        within = (time > before) & (time <= before + APART * half_period)
        places.append(np.argmax(np.where(within, height if n % 2 else -height, -np.inf), axis=-1))
    at = np.stack(places, axis=-1)
    return Extremes(time[at], np.take_along_axis(height, at, axis=-1))


def one_mode(found: Extremes) -> OneMode:
    """The system whose extremes were `found`, at least two; of the leading shape of its arrays."""
    times, heights = found
    count = times.shape[-1]
    n = np.arange(1, count + 1)
    # Two extremes determine K in closed form: (K - y_2) K = (y_1 - K)^2.
    final = heights[..., 0] ** 2 / (2.0 * heights[..., 0] - heights[..., 1])
    overshoot = np.zeros_like(final)
    for _ in range(_ROUNDS):
        logs = np.log(np.maximum(np.abs(heights / final[..., None] - 1.0), _LEAST))
        overshoot = 0.5 * (np.mean(logs / n, axis=-1) + logs[..., 0])
        signs = np.where(n % 2, 1.0, -1.0)
        final = np.sum(heights, axis=-1) / (count + np.sum(signs * np.exp(overshoot[..., None] * n), axis=-1))
    damping = overshoot_to_damping(overshoot)
    return OneMode(final, half_period_to_frequency(np.mean(times / n, axis=-1), damping), damping)
