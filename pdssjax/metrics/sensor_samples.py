"""Properties of a sensor from its samples: noise, resolution, clipping, and held output.

The noise is told by how far neighbours scatter, whatever slower motion there is.  Of a sensor that holds its output,
samples between two large steps are exactly alike, always as many, where motion goes on.  A coarse resolution makes such
repeats, too, but between steps of one count; so only those between larger steps are looked at.  Repeats that noise was
added to, as a digitiser behind the sensor adds it, are not seen.
"""

import math

import numpy as np
from jaxtyping import Bool, Float

_MOTION_SIGMAS = 3.0
"""Second differences beyond this many standard deviations count as motion, not noise."""

_TRUNCATED_STD = 0.98658
"""Standard deviation of a standard normal variable truncated at `_MOTION_SIGMAS`."""

_SECOND_DIFFERENCE_STD = float(np.sqrt(6.0))
"""Standard deviation of a second difference of white noise of standard deviation 1."""

_FEWEST_TURNS = 8
"""Least number of reversals between neighbouring samples in a voltage that flickers."""

_TURNING = 0.005
"""Least share of samples at a reversal in a voltage that flickers."""

_LEAST_RELATIVE_NOISE = 1e-8
"""Smallest noise as a fraction of the samples' standard deviation: a sensor of 0.1 nm over a way of 1 cm."""


def neighbour_scatter(values: Float[np.ndarray, " n"]) -> float:
    """The standard deviation of white noise in `values`, from their second differences.

    Robust against fast motion, such as a slip's, which fills few samples: what lies far out is left out again and
    again.  A smooth motion between samples hardly enters, and rounding no more than it does in the noise itself.  Of
    fewer than eight values, their own standard deviation.
    """
    if values.size < 8:
        return float(np.std(values))
    bends = np.abs(np.diff(values, 2))
    spread = _std_from_median(bends)
    for _ in range(20):
        near = bends[bends <= _MOTION_SIGMAS * spread] if spread > 0 else bends
        spread = float(np.sqrt(np.mean(near**2))) / _TRUNCATED_STD
    return spread / _SECOND_DIFFERENCE_STD


def scatter_between_corners(values: Float[np.ndarray, " n"]) -> float:
    """Standard deviation of white noise in a voltage of straight pieces; most samples must not be next to a corner.

    By the median alone, which stays 0 where nothing but corners scatters.  Each sample next to a corner raises it: 43 %
    too much where a quarter are.  Of fewer than four values, 0.
    """
    return _std_from_median(np.abs(np.diff(values, 2))) / _SECOND_DIFFERENCE_STD if values.size > 3 else 0.0


def flicker_of(volts: Float[np.ndarray, " n"]) -> float:
    """Amplitude of the jumps of a voltage to and fro between neighbouring samples, in its unit; 0 where they are rare.

    That is one step of a converter that flickers between two, however seldom, and 1.7 standard deviations of white
    noise.  A voltage without noise turns at its corners alone.
    """
    steps = np.diff(volts)
    turns = np.flatnonzero(steps[1:] * steps[:-1] < 0)
    if turns.size < max(_FEWEST_TURNS, _TURNING * volts.size):
        return 0.0
    return float(np.percentile(np.minimum(np.abs(steps[turns]), np.abs(steps[turns + 1])), 90.0))


def scatter_floor(measured: Float[np.ndarray, " samples"]) -> float:
    """A first guess of the noise from the scatter of second differences, in the samples' unit; above zero."""
    scatter = neighbour_scatter(measured)
    if measured.size < 8:
        return scatter or 1e-9
    return max(scatter, _LEAST_RELATIVE_NOISE * float(np.std(measured)), 1e-12)


def _std_from_median(bends: Float[np.ndarray, " n"]) -> float:
    """Estimate the standard deviation of normal deviates from the median of their absolute values."""
    return 1.4826 * float(np.median(bends))


def resolution_of(measured: Float[np.ndarray, " samples"]) -> float | None:
    """The step in which samples are counted, in their unit; None where none is seen."""
    levels = np.unique(measured)
    if levels.size < 3:
        return None
    steps = np.diff(levels)
    step = float(np.min(steps[steps > 1e-9 * np.ptp(levels)]))
    counts = steps / step
    near = np.abs(counts - np.round(counts)) < 0.05 + 1e-6 * counts
    return float(np.sum(steps[near]) / np.sum(np.round(counts[near]))) if np.mean(near) > 0.98 else None


def rounding_of_counts(measured: Float[np.ndarray, " samples"]) -> float:
    """Standard deviation of the rounding to steps, in the samples' unit; 0 where no step is seen."""
    return (resolution_of(measured) or 0.0) / math.sqrt(12.0)


def counts_without_noise(measured: Float[np.ndarray, " samples"]) -> bool:
    """Whether samples are counted in steps that hide their noise: neighbours scatter less than rounding alone does."""
    return rounding_of_counts(measured) > scatter_floor(measured)


_RUN = 8
"""Equal samples in a row, at least."""

_TIMES = 4
"""How many times as long as any run of equal samples between the extremes: a coarse sensor has such, too."""

_MOVED = 0.1
"""Part of its range that a voltage goes through in the middle half of a run, if the drive runs there."""


def clipped(values: Float[np.ndarray, " n"], voltage: Float[np.ndarray, " n"] | None = None) -> dict[str, int]:
    """How many samples lie in long runs of exactly the "highest" or the "lowest" value; neither where none does.

    Runs with which the record begins or ends count only beside others, or where the `voltage` moves on: without a drive
    a sensor without noise shows such a rest.
    """
    beside = np.flatnonzero(np.diff(values) != 0.0)
    ends = np.append(beside + 1, values.size)
    lengths = np.diff(np.append(0, ends))
    levels = values[ends - 1]
    inside = (levels > values.min()) & (levels < values.max())
    least = max(_RUN, _TIMES * int(np.max(lengths[inside], initial=0)))
    found = {}
    for end, level in (("highest", values.max()), ("lowest", values.min())):
        long = (levels == level) & (lengths >= least)
        outer = [run for run in {0, lengths.size - 1} if long[run]]
        if long[1:-1].any() or any(_voltage_changes(voltage, ends[run] - lengths[run], lengths[run]) for run in outer):
            found[end] = int(np.sum(lengths[long]))
    return found


def _voltage_changes(voltage: Float[np.ndarray, " n"] | None, first: int, count: int) -> bool:
    """The voltage goes on in the middle half of a run of samples."""
    if voltage is None:
        return False
    middle = voltage[first + count // 4 : first + count - count // 4]
    return bool(np.ptp(middle) > _MOVED * np.ptp(voltage))


_LEAST_MOTION_STEP = 1.5
"""Least step that is motion and not rounding, in counts of the sensor."""

_FEWEST_RUNS = 10
"""Least number of runs of equal samples, each between two large steps, to conclude that a sensor holds values."""

_USUAL_LENGTH_SHARE = 0.9
"""Least share of these runs with the usual length, or one sample more where sensor and digitiser are not in step."""

_EARLY_STEP_SHARE = 0.01
"""Largest share of all steps, small ones included, that may come sooner than a held value allows."""

_LONGEST_HOLD = 8
"""Most samples for which a value is held; a square wave rests for longer."""

_OUT_OF_STEP = 0.02
"""Deviation of the mean run from a whole number of samples that shows sensor and digitiser to be out of step."""

_CONTINUING_SHARE = 0.05
"""Least share of large steps in the direction of the step before; a sampled square wave only alternates."""


def hold_length(measured: Float[np.ndarray, " samples"]) -> float | None:
    """Mean number of samples for which a sensor holds each value; None where every sample is a new value."""
    steps = np.diff(measured)
    places = np.flatnonzero(steps)
    if places.size <= _FEWEST_RUNS:
        return None
    sizes = np.abs(steps[places])
    large = sizes > _LEAST_MOTION_STEP * max(resolution_of(measured) or 0.0, float(np.percentile(sizes, 10.0)))
    both = large[1:] & large[:-1]
    lengths, turns = np.diff(places)[both], np.diff(np.sign(steps[places]))[both]
    if lengths.size < _FEWEST_RUNS:
        return None
    usual = int(np.percentile(lengths, 5.0))
    if (
        not 2 <= usual <= _LONGEST_HOLD
        or np.mean(turns == 0.0) < _CONTINUING_SHARE
        or np.mean(np.diff(places) < usual) > _EARLY_STEP_SHARE
    ):
        return None
    once = (lengths == usual) | (lengths == usual + 1)
    # A new value may be the old one where little moves.
    several = lengths % usual == 0
    if np.mean(once) < 0.5 * _USUAL_LENGTH_SHARE or np.mean(once | several) < _USUAL_LENGTH_SHARE:
        return None
    return float(np.mean(lengths[once]))


def describe_hold(measured: Float[np.ndarray, " samples"]) -> str:
    """Describe a sensor that holds its values, and what to do about it, as a clause after "found"; "" of others."""
    every = hold_length(measured)
    if every is None:
        return ""
    cure = f"write held = {every:.0f} in its [[record]]"
    if abs(every - round(every)) > _OUT_OF_STEP:
        cure = "export the record at the rate at which the sensor updates"
    return (
        f"a new sensor value only every {every:.2g} samples, repeated in between (sample and hold): repeated values "
        f"lag behind, which makes the stack look slower than it is; {cure}"
    )


def fresh_samples(measured: Float[np.ndarray, " samples"], every: int) -> Bool[np.ndarray, " samples"]:
    """Mark the first sample of each value of a sensor that shows a new value once in `every` samples."""
    changes = np.flatnonzero(np.diff(measured)) + 1
    first = int(np.argmax(np.bincount(changes % every, minlength=every)))
    return np.arange(measured.size) % every == first
