"""Whether the fast flanks of a step or a sawtooth are straight, or rounded as behind an amplifier."""

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

if TYPE_CHECKING:
    from .waveform import Waveform

_SHARES = (0.1, 0.5, 0.9)
"""Parts of a flank between which its first and its second half are timed."""

_SAMPLES = 3
"""Between the first and the last of them, at least: with fewer a corner between two samples looks like a bend."""


def rounding_of(time: Float[np.ndarray, " n"], volts: Float[np.ndarray, " n"], waveform: "Waveform") -> float:
    """How much longer a fast flank takes for its second half than for its first one, by the median of all flanks.

    1 of a straight line, ln 5 / ln 1.8 = 2.7 behind an amplifier of first order; NaN of other waveforms and of flanks
    with too few samples.

    **Arguments:** `volts` [V] at `time` [s], and the step or sawtooth found in them.
    """
    if waveform.name not in ("step", "sawtooth"):
        return math.nan
    level = (volts - waveform.counted_from) / waveform.numbers["voltage"]
    passed = 1.0 - level if waveform.direction == "forward" else level
    outside = np.flatnonzero((passed <= _SHARES[0]) | (passed >= _SHARES[-1]))
    ratios = []
    for first, last in itertools.pairwise(outside):
        if passed[first] > _SHARES[0] or passed[last] < _SHARES[-1] or last - first <= _SAMPLES:
            continue
        flank = slice(first, last + 1)
        begin, middle, end = np.interp(_SHARES, np.maximum.accumulate(passed[flank]), time[flank])
        ratios.append((end - middle) / (middle - begin))
    return float(np.median(ratios)) if ratios else math.nan
