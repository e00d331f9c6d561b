"""Properties of a sensor from its samples: noise, resolution, clipping, and held output.

The scatter of neighbours shows the noise, whatever slower motion there is.  A sensor that holds its output shows runs
of equal samples between two large steps, all of the same length.  A coarse resolution makes runs, too, but between
steps of one count, which are therefore ignored.  Runs are not found where a digitiser has added noise to them.
"""

import math
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float

Samples: TypeAlias = Float[np.ndarray, " n"]
"""One number a sample."""

_MOTION_SIGMAS = 3.0
"""Second differences beyond this many standard deviations count as motion, not noise."""

_TRUNCATED_STD = 0.98658
"""Standard deviation of a standard normal variable truncated at `_MOTION_SIGMAS`."""

_SECOND_DIFFERENCE_STD = float(np.sqrt(6.0))
"""Standard deviation of a second difference of white noise of standard deviation 1."""


def neighbour_scatter(values: Samples) -> float:
    """The standard deviation of white noise in `values`, from their second differences.

    Fast motion such as a slip fills few samples, and is left out by repeated truncation.  Smooth motion hardly enters;
    rounding enters as it does in the noise itself.  Of fewer than eight values, their standard deviation.
    """
    if values.size < 8:
        return float(np.std(values))
    bends = np.abs(np.diff(values, 2))
    spread = _std_from_median(bends)
    for _ in range(20):
        near = bends[bends <= _MOTION_SIGMAS * spread] if spread > 0 else bends
        spread = float(np.sqrt(np.mean(near**2))) / _TRUNCATED_STD
    return spread / _SECOND_DIFFERENCE_STD


def scatter_between_corners(values: Samples) -> float:
    """Standard deviation of white noise in a voltage of straight pieces; most samples must not be next to a corner.

    By the median alone, which stays 0 where nothing but corners scatters.  Each sample next to a corner raises it: 43 %
    too much where a quarter are.  Of fewer than four values, 0.
    """
    return _std_from_median(np.abs(np.diff(values, 2))) / _SECOND_DIFFERENCE_STD if values.size > 3 else 0.0


def flicker_of(volts: Samples) -> float:
    """Amplitude of the jumps of a voltage to and fro between neighbouring samples, in its unit; 0 where they are rare.

    That is one step of a converter that flickers between two, however seldom, and 1.7 standard deviations of white
    noise.  A voltage without noise turns at its corners alone.
    """
    steps = np.diff(volts)
    turns = np.flatnonzero(steps[1:] * steps[:-1] < 0)
    # Of a voltage that flickers at least one sample in 200 lies at a reversal.
    if turns.size < max(8, 0.005 * volts.size):
        return 0.0
    return float(np.percentile(np.minimum(np.abs(steps[turns]), np.abs(steps[turns + 1])), 90.0))


def scatter_floor(measured: Samples) -> float:
    """A first guess of the noise from the scatter of second differences, in the samples' unit; above zero."""
    scatter = neighbour_scatter(measured)
    if measured.size < 8:
        return scatter or 1e-9
    # At least that of a sensor of 0.1 nm over a way of 1 cm.
    return max(scatter, 1e-8 * float(np.std(measured)), 1e-12)


def _std_from_median(bends: Samples) -> float:
    """Estimate the standard deviation of normal deviates from the median of their absolute values."""
    return 1.4826 * float(np.median(bends))


def resolution_of(measured: Samples) -> float | None:
    """The step in which samples are counted, in their unit; None where none is seen."""
    levels = np.unique(measured)
    if levels.size < 3:
        return None
    steps = np.diff(levels)
    step = float(np.min(steps[steps > 1e-9 * np.ptp(levels)]))
    counts = steps / step
    near = np.abs(counts - np.round(counts)) < 0.05 + 1e-6 * counts
    return float(np.sum(steps[near]) / np.sum(np.round(counts[near]))) if np.mean(near) > 0.98 else None


def rounding_of_counts(measured: Samples) -> float:
    """Standard deviation of the rounding to steps, in the samples' unit; 0 where no step is seen."""
    return (resolution_of(measured) or 0.0) / math.sqrt(12.0)


def counts_without_noise(measured: Samples) -> bool:
    """Whether samples are counted in steps that hide their noise: neighbours scatter less than rounding alone does."""
    return rounding_of_counts(measured) > scatter_floor(measured)


_RUN_RATIO = 4
"""Least ratio of a run at an extreme to the longest run of equal samples in between, which a coarse sensor has, too."""


def clipped_counts(values: Samples, voltage: Samples | None = None) -> dict[str, int]:
    """How many samples lie in long runs of exactly the "highest" or the "lowest" value; neither where none does.

    Runs with which the record begins or ends count only beside others, or where the `voltage` moves on: without a drive
    a sensor without noise shows such a rest.
    """
    beside = np.flatnonzero(np.diff(values) != 0.0)
    ends = np.append(beside + 1, values.size)
    lengths = np.diff(np.append(0, ends))
    levels = values[ends - 1]
    inside = (levels > values.min()) & (levels < values.max())
    least = max(8, _RUN_RATIO * int(np.max(lengths[inside], initial=0)))
    found = {}
    for end, level in (("highest", values.max()), ("lowest", values.min())):
        long = (levels == level) & (lengths >= least)
        counts = bool(long[1:-1].any())
        if voltage is not None:
            for run in {0, lengths.size - 1}:
                # The voltage goes on in the middle half of the run.
                quarter = lengths[run] // 4
                middle = slice(ends[run] - lengths[run] + quarter, ends[run] - quarter)
                counts |= bool(long[run] and np.ptp(voltage[middle]) > 0.1 * np.ptp(voltage))
        if counts:
            found[end] = int(np.sum(lengths[long]))
    return found


_FEWEST_RUNS = 10
"""Least number of runs of equal samples, each between two large steps, to conclude that a sensor holds values."""

_USUAL_LENGTH_SHARE = 0.9
"""Least share of these runs with the usual length, or one sample more where sensor and digitiser are not in step."""


def hold_length(measured: Samples) -> float | None:
    """Mean number of samples for which a sensor holds each value; None where every sample is a new value."""
    steps = np.diff(measured)
    places = np.flatnonzero(steps)
    if places.size <= _FEWEST_RUNS:
        return None
    sizes = np.abs(steps[places])
    # Steps of more than one count are motion and not rounding.
    large = sizes > 1.5 * max(resolution_of(measured) or 0.0, float(np.percentile(sizes, 10.0)))
    both = large[1:] & large[:-1]
    lengths, turns = np.diff(places)[both], np.diff(np.sign(steps[places]))[both]
    if lengths.size < _FEWEST_RUNS:
        return None
    usual = int(np.percentile(lengths, 5.0))
    # A sampled square wave rests for longer, or alternates only; no new value comes sooner than a sensor holds one.
    if not 2 <= usual <= 8 or np.mean(turns == 0.0) < 0.05 or np.mean(np.diff(places) < usual) > 0.01:
        return None
    once = (lengths == usual) | (lengths == usual + 1)
    # A new value may be the old one where little moves.
    several = lengths % usual == 0
    if np.mean(once) < 0.5 * _USUAL_LENGTH_SHARE or np.mean(once | several) < _USUAL_LENGTH_SHARE:
        return None
    return float(np.mean(lengths[once]))


def describe_hold(measured: Samples) -> str:
    """Describe a sensor that holds its values, and what to do about it, as a clause after "found"; "" of others."""
    every = hold_length(measured)
    if every is None:
        return ""
    cure = f"write held = {every:.0f} in its [[record]]"
    if abs(every - round(every)) > 0.02:  # sensor and digitiser are out of step
        cure = "export the record at the rate at which the sensor updates"
    return (
        f"a new sensor value only every {every:.2g} samples, repeated in between (sample and hold): repeated values "
        f"lag behind, which makes the stack look slower than it is; {cure}"
    )


def fresh_samples(measured: Samples, every: int) -> Bool[np.ndarray, " samples"]:
    """Mark the first sample of each value of a sensor that shows a new value once in `every` samples."""
    changes = np.flatnonzero(np.diff(measured)) + 1
    first = int(np.argmax(np.bincount(changes % every, minlength=every)))
    return np.arange(measured.size) % every == first
