"""What was measured: one record for each run of the rig."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

COLUMNS = {
    "platform": {"time": "s", "displacement": "m"},
    "effector": {"time": "s", "displacement": "m"},
    "friction": {"time": "s", "motion": "m", "force": "N"},
    "force": {"time": "s", "force": "N"},
}
"""What may be measured, and the columns that a record of it has, with their SI units; what is explained comes last."""


@dataclasses.dataclass(frozen=True, eq=False)
class Record:
    """A run of the rig: the drive or the motion applied, and what was measured."""

    name: str
    """As reports call it; no other record of the study has it."""
    file: Path
    """The CSV file it comes from."""
    role: str
    """"fit": fitted; "validate": only predicted and compared."""
    measures: str
    """What: displacement of "platform" or "effector", "friction" force of the contact alone under
    a prescribed motion, or "force" of the blocked end-effector on a sensor."""
    drive: Any
    """The voltage, from t = 0 on; fields in SI.  None for "friction"."""
    overrides: frozenset[str]
    """The drive's fields that the record itself sets; they do not follow the study's "drive.…"."""
    time: np.ndarray
    """Sample times [s], strictly increasing, shape (samples,); the drive starts at 0."""
    measured: np.ndarray
    """Displacement [m] or force [N], shape (samples,)."""
    noise: float | None
    """Standard deviation of the noise [m or N]; None: estimate it."""
    offset: float | None
    """Zero of the sensor [m or N]; None: free."""
    motion: np.ndarray | None = None
    """Of "friction": the relative displacement of platform against end-effector [m], shape (samples,)."""
    resolution: float = 0.0
    """Step [m or N] in which the sensor counts: for a virtual rig; a fit needs it within the noise."""
    columns: dict[str, tuple[str, str]] = dataclasses.field(default_factory=dict)
    """By quantity, the name of the column, and its unit; "" where the name says it."""
    start: float = 0.0
    """When the drive starts on the clock of the file [s]; `time` counts from there."""

    @property
    def unit(self) -> str:
        """SI unit of what was measured."""
        return list(COLUMNS[self.measures].values())[-1]
