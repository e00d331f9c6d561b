"""What samples show of the sensor that took them: its noise, its resolution, and whether it clips or holds its output.

The noise is told by how far neighbours scatter, whatever slower motion there is.  Of a sensor that holds its output,
samples between two large steps are exactly alike, always as many, where motion goes on.  A coarse resolution makes such
repeats, too, but between steps of one count; so only those between larger steps are looked at.  Repeats that noise was
added to, as a digitiser behind the sensor adds it, are not seen.
"""

import math

import numpy as np
from jaxtyping import Bool, Float

_FAR = 3.0
"""Standard deviations from which a second difference counts as motion, not noise."""

_KEPT = 0.98658
"""Standard deviation of a normal variable cut off there."""

_BEND = float(np.sqrt(6.0))
"""Standard deviation of a second difference of white noise of standard deviation 1."""

_FEWEST_TURNS = 8
"""Turns from one sample to the next from which a voltage flickers."""

_TURNING = 0.005
"""Share of the samples that turn in a voltage that flickers, at least."""

_EXACT = 1e-8
"""Part of the samples' standard deviation that no sensor resolves: one of 0.1 nm does 1e-8 of a way of 1 cm."""


def neighbour_scatter(values: Float[np.ndarray, " n"]) -> float:
    """The standard deviation of white noise in `values`, from their second differences.

    Robust against fast motion, such as a slip's, which fills few samples: what lies far out is left out again and
    again.  A smooth motion between samples hardly enters, and rounding no more than it does in the noise itself.  Of
    fewer than eight values, their own standard deviation.
    """
    if values.size < 8:
        return float(np.std(values))
    bends = np.abs(np.diff(values, 2))
    spread = _typical(bends)
    for _ in range(20):
        near = bends[bends <= _FAR * spread] if spread > 0 else bends
        spread = float(np.sqrt(np.mean(near**2))) / _KEPT
    return spread / _BEND


def scatter_between_corners(values: Float[np.ndarray, " n"]) -> float:
    """Standard deviation of white noise in a voltage of straight pieces; most samples must not be next to a corner.

    By the median alone, which stays 0 where nothing but corners scatters.  Each sample next to a corner raises it: 43 %
    too much where a quarter are.  Of fewer than four values, 0.
    """
    return _typical(np.abs(np.diff(values, 2))) / _BEND if values.size > 3 else 0.0


def flicker_of(volts: Float[np.ndarray, " n"]) -> float:
    """How far a voltage jumps to and fro between neighbouring samples, in its unit; 0 where it hardly does.

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
    return max(scatter, _EXACT * float(np.std(measured)), 1e-12)


def _typical(bends: Float[np.ndarray, " n"]) -> float:
    """The standard deviation of normal numbers of these sizes, by their median."""
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
        if long[1:-1].any() or any(_moves(voltage, ends[run] - lengths[run], lengths[run]) for run in outer):
            found[end] = int(np.sum(lengths[long]))
    return found


def _moves(voltage: Float[np.ndarray, " n"] | None, first: int, count: int) -> bool:
    """The voltage goes on in the middle half of a run of samples."""
    if voltage is None:
        return False
    middle = voltage[first + count // 4 : first + count - count // 4]
    return bool(np.ptp(middle) > _MOVED * np.ptp(voltage))


_LARGE = 1.5
"""Steps, in counts of the sensor, that are motion and no rounding."""

_FEWEST = 10
"""Runs of equal samples between such steps from which it is said."""

_ALIKE = 0.9
"""Share of them that must be as long as most, or a sample longer, as where sensor and digitiser are not in step."""

_SOONER = 0.01
"""Share of all steps, small ones, too, that may come sooner after the one before."""

_LONGEST = 8
"""Samples that a value is held for at most; a square wave rests for longer."""

_BETWEEN = 0.02
"""Part of a sample by which the mean run differs from a whole number of them where sensor and digitiser are not in
step."""

_GOES_ON = 0.05
"""Share of the large steps that go on in the direction of the one before; a sampled square wave only alternates."""


def held_for(measured: Float[np.ndarray, " samples"]) -> float | None:
    """For how many samples a sensor shows each value, on average, in a record of them; None for a new one at each."""
    steps = np.diff(measured)
    places = np.flatnonzero(steps)
    if places.size <= _FEWEST:
        return None
    sizes = np.abs(steps[places])
    large = sizes > _LARGE * max(resolution_of(measured) or 0.0, float(np.percentile(sizes, 10.0)))
    both = large[1:] & large[:-1]
    lengths, turns = np.diff(places)[both], np.diff(np.sign(steps[places]))[both]
    if lengths.size < _FEWEST:
        return None
    usual = int(np.percentile(lengths, 5.0))
    if not 2 <= usual <= _LONGEST or np.mean(turns == 0.0) < _GOES_ON or np.mean(np.diff(places) < usual) > _SOONER:
        return None
    once = (lengths == usual) | (lengths == usual + 1)
    # A new value may be the old one where little moves.
    several = lengths % usual == 0
    if np.mean(once) < 0.5 * _ALIKE or np.mean(once | several) < _ALIKE:
        return None
    return float(np.mean(lengths[once]))


def held_in_words(measured: Float[np.ndarray, " samples"]) -> str:
    """Describe a sensor that holds its values, and what to do about it, as a clause after "found"; "" of others."""
    every = held_for(measured)
    if every is None:
        return ""
    cure = f"write held = {every:.0f} in its [[record]]"
    if abs(every - round(every)) > _BETWEEN:
        cure = "read it at the rate at which the sensor shows new ones"
    return (
        f"a new value at every {every:.2g} samples only, and the one before in between, as of a sensor that holds its "
        f"output: it is late there, and the stack looks slower than it is; {cure}"
    )


def fresh_samples(measured: Float[np.ndarray, " samples"], every: int) -> Bool[np.ndarray, " samples"]:
    """Which samples are the first of a value, where a sensor shows a new one at `every` so many of them."""
    changes = np.flatnonzero(np.diff(measured)) + 1
    first = int(np.argmax(np.bincount(changes % every, minlength=every)))
    return np.arange(measured.size) % every == first
