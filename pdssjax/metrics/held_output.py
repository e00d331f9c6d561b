"""Whether a sensor shows a new value only at every so many samples, and the same in between.

Where motion goes on, samples between two large steps are then exactly alike, always as many.  A coarse resolution makes
such repeats, too, but between steps of one count; so only those between larger steps are looked at.
Repeats that noise was added to, as a digitiser behind the sensor adds it, are not seen.
"""

import numpy as np
from jaxtyping import Bool, Float

from .sensor_resolution import resolution_of

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
    """What a sensor shows that holds its values, and what to do about it, as what follows "found"; "" of others."""
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
