"""The sweep that every simulator does: a grid of voltages and frequencies.

Each point is its own run from rest.  It is looked at where `pdssjax.sweep` looks: six samples on
the slow flank of the last of its cycles and six on the flank that follows.
"""

import dataclasses
import itertools

import numpy as np

from pdssjax.metrics import FLANK
from pdssjax.sweeps import LANES

_LINE = 6


@dataclasses.dataclass(frozen=True)
class Grid:
    """Every voltage with every frequency, the frequency changing fastest."""

    voltages: tuple[float, ...]
    frequencies: tuple[float, ...]
    cycles: int = 4

    @property
    def points(self) -> np.ndarray:
        """Voltage [V] and frequency [Hz], shape (points, 2)."""
        return np.array(list(itertools.product(self.voltages, self.frequencies)))

    @property
    def times(self) -> np.ndarray:
        """Sample times [s], shape (points, samples)."""
        phases = np.linspace(*FLANK, _LINE)
        turns = np.concatenate([self.cycles - 1 + phases, self.cycles + phases])
        return turns / self.points[:, 1:]

    def net_steps(self, effector: np.ndarray) -> np.ndarray:
        """Net step of the last cycle [um] from the samples [um], shape (points,).

        The samples of a flank lie evenly about its middle, so that their mean is the level of its line there.
        """
        return effector[:, _LINE:].mean(axis=1) - effector[:, :_LINE].mean(axis=1)

    def thinned(self, every: int) -> "Grid":
        """Every so manieth voltage only."""
        return dataclasses.replace(self, voltages=self.voltages[::every])


def grid(voltages: int = 40, frequencies: int = 25) -> Grid:
    """20 to 80 V and 2 to 50 Hz."""
    return Grid(tuple(np.linspace(20.0, 80.0, voltages).tolist()), tuple(np.linspace(2.0, 50.0, frequencies).tolist()))


def in_blocks(rows: np.ndarray) -> np.ndarray:
    """Rows in the blocks of `pdssjax.sweep`, shape (blocks, lanes, ...); the last row fills the last block."""
    rows = np.concatenate([rows, np.repeat(rows[-1:], -len(rows) % LANES, axis=0)])
    return rows.reshape(-1, LANES, rows.shape[1])
