"""A first guess of the noise of a record, from its samples alone."""

from ..metrics import scatter_floor
from .record import Record


def noise_floor(record: Record) -> float:
    """A first guess of the noise of a record, in its unit: `scatter_floor` of what was measured."""
    return scatter_floor(record.measured)
