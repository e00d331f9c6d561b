"""A first guess of the noise of a record, from its samples alone."""

import numpy as np

from ..metrics import neighbour_scatter
from .record import Record


def noise_floor(record: Record) -> float:
    """A first guess of the noise of a record from the scatter of its second differences, in its unit; above zero."""
    scatter = neighbour_scatter(record.measured)
    if record.measured.size < 8:
        return scatter or 1e-9
    return max(scatter, 1e-4 * float(np.std(record.measured)), 1e-12)
