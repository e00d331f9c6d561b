"""What the failure of a point of a sweep means."""

from ..integration import FAILURES

SKIPPED, NOT_COMPUTED, INCOMPLETE, GRAZING = (len(FAILURES) + i for i in range(4))

POINT_FAILURES = (
    *FAILURES,
    "skipped: the numbers of its drive contradict each other",
    "its block of points could not be computed",
    "its cycle was measured, but the further metrics or derivatives could not be found: too many steps, or no finite "
    "number",
    "a reversal of its cycle grazes: its metrics are those of cycles integrated one after the other, and neither "
    "derivatives nor multiplier hold there",
)
"""By its number; 0 is none."""
