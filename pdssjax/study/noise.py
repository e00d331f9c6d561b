"""A first guess of the noise of a record, from its samples alone."""

import numpy as np

from .record import Record

_FAR = 3.0
"""Standard deviations from which a second difference counts as motion, not noise."""

_KEPT = 0.98658
"""Standard deviation of a normal variable cut off there."""


def noise_floor(record: Record) -> float:
    """A first guess of the noise of a record from the scatter of its second differences, in its unit.

    Robust against the fast motion of a slip, which fills few samples: what lies far out is
    left out again and again.  A smooth motion between samples hardly enters, and rounding
    no more than it does in the noise itself.
    """
    if record.measured.size < 8:
        return float(np.std(record.measured)) or 1e-9
    bends = np.abs(np.diff(record.measured, 2))
    spread = 1.4826 * float(np.median(bends))
    for _ in range(20):
        near = bends[bends <= _FAR * spread] if spread > 0 else bends
        spread = float(np.sqrt(np.mean(near**2))) / _KEPT
    return max(spread / np.sqrt(6.0), 1e-4 * float(np.std(record.measured)), 1e-12)
