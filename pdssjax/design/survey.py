"""The information of any sampling of any experiment, from few simulations: dense responses, kept and interpolated.

Under every draw of the parameters an experiment is simulated and differentiated once, on its grid; every schedule of
its samples then is an interpolation, a whitening and a product of matrices.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from ..study import Study
from .experiments import CompleteLimits, Experiment
from .information import Noise, record_information
from .sampling import Grid, Schedule
from .sensitivities import Response, Sensitivities, Simulation


@dataclasses.dataclass(frozen=True, eq=False)
class Point:
    """Parameters of the study, and of its rival where there is one, at which experiments are simulated."""

    free: Float[np.ndarray, " p"]
    """The study's free parameters on the fit's scale."""
    rival: Float[np.ndarray, " r"] | None = None
    """The rival's free parameters on the scale of its fit."""


class Survey:
    """Simulates experiments of a study, and of a rival study with another law, and keeps their derivatives."""

    def __init__(self, study: Study, rival: Study | None, limits: CompleteLimits, experiments: Sequence[Experiment]):
        self.limits = limits
        ringing = study.values().get("piezo.natural_frequency")
        self.ringing = None if ringing is None else float(ringing)
        self._grids: dict[Experiment, Grid] = {}
        sizes: dict[tuple[str, str], int] = {}
        for experiment in experiments:
            sizes[experiment.group] = max(sizes.get(experiment.group, 400), self.grid(experiment).times.size)
        self.sizes = sizes
        self.own = Sensitivities(study, limits, self._grids, sizes)
        self.rival = None if rival is None else Sensitivities(rival, limits, self._grids, sizes)
        self._columns: dict[tuple[Experiment, int], Float[np.ndarray, "m q"]] = {}

    @property
    def size(self) -> int:
        """Columns of an information: parameters of the study, and with a rival its parameters and the difference."""
        return len(self.own.paths) + (0 if self.rival is None else len(self.rival.paths) + 1)

    def grid(self, experiment: Experiment) -> Grid:
        """The dense grid of an experiment."""
        if experiment not in self._grids:
            self._grids[experiment] = experiment.grid(self.ringing, self.limits.interval, self.limits.duration)
        return self._grids[experiment]

    def noise(self, kind: str) -> Noise:
        """The noise of a kind of record, misfit included."""
        return Noise(self.limits.noise[kind], self.limits.correlation_time.get(kind, 0.0))

    def simulate(
        self, experiments: Sequence[Experiment], points: Mapping[int, Point], progress: Callable[[int, int], None]
    ) -> None:
        """Simulate the `experiments` on their grids at all `points`, by their number, as far as that is not done."""
        pairs = [(e, k) for k in points for e in experiments if (e, k) not in self._columns]
        requests = [(e, points[k], self.grid(e).times) for e, k in pairs]
        for pair, columns in zip(pairs, self.columns(requests, progress), strict=True):
            self._columns[pair] = columns

    def columns(
        self,
        requests: Sequence[tuple[Experiment, Point, Float[np.ndarray, " m"]]],
        progress: Callable[[int, int], None] | None = None,
    ) -> list[Float[np.ndarray, "m q"]]:
        """The Jacobian of each experiment at a point and times; with a rival [J, J_rival, difference].

        Not finite where a simulation fails.
        """
        own = _in_pieces(self.own, [Simulation(e, t, point.free) for e, point, t in requests], self.sizes, progress)
        if self.rival is None:
            return [response.jacobian for response in own]
        simulations = [Simulation(e, t, p.rival) for e, p, t in requests if p.rival is not None]
        other = _in_pieces(self.rival, simulations, self.sizes, None)
        return [
            np.column_stack([mine.jacobian, theirs.jacobian, mine.predicted - theirs.predicted])
            for mine, theirs in zip(own, other, strict=True)
        ]

    def extent(self, experiment: Experiment, point: Point) -> float:
        """Range of the measured quantity in the cycles of the grid, in its unit."""
        (response,) = self.own.responses([Simulation(experiment, self.grid(experiment).times, point.free)])
        return float(np.ptp(response.predicted))

    def is_simulated(self, experiment: Experiment, number: int = 0) -> bool:
        """Whether an experiment could be simulated at a point of that number."""
        return bool(np.isfinite(self._columns[experiment, number]).all())

    def information(
        self, experiment: Experiment, schedule: Schedule, numbers: Sequence[int]
    ) -> Float[np.ndarray, "draws q q"]:
        """The information of an experiment that is sampled so, at the points of these `numbers`; interpolated.

        It is zero at a point where the simulation failed: a plan does not count on it there.
        """
        times, grid = schedule.times(experiment.period), self.grid(experiment)
        out = np.zeros((len(numbers), self.size, self.size))
        for place, number in enumerate(numbers):
            if self.is_simulated(experiment, number):
                columns = grid.interpolated(self._columns[experiment, number], times)
                out[place] = record_information(columns, times, self.noise(experiment.kind))
        return out

    def exact_columns(
        self, records: Sequence[tuple[Experiment, Schedule]], points: Sequence[Point]
    ) -> list[tuple[Experiment, Float[np.ndarray, " n"], Float[np.ndarray, "n q"]]]:
        """Experiment, times and `columns` of each of the `records` at each of the `points`, at their own samples."""
        times = [schedule.times(experiment.period) for experiment, schedule in records]
        requests = [(e, point, t) for (e, _), t in zip(records, times, strict=True) for point in points]
        columns = self.columns([(e, point, np.maximum(t, 0.0)) for e, point, t in requests])
        # Before the drive begins nothing depends on the parameters.
        return [
            (e, t, np.where(t[:, None] < 0.0, 0.0, each)) for (e, _, t), each in zip(requests, columns, strict=True)
        ]

    def exact_information(
        self, records: Sequence[tuple[Experiment, Schedule]], points: Sequence[Point]
    ) -> Float[np.ndarray, "records draws q q"]:
        """The information of `records` at all `points`, simulated at their own samples."""
        found = [
            record_information(columns, times, self.noise(experiment.kind))
            if np.isfinite(columns).all()
            else np.zeros((self.size, self.size))
            for experiment, times, columns in self.exact_columns(records, points)
        ]
        return np.array(found).reshape(len(records), len(points), self.size, self.size)


def _in_pieces(
    sensitivities: Sensitivities,
    simulations: Sequence[Simulation],
    sizes: Mapping[tuple[str, str], int],
    progress: Callable[[int, int], None] | None,
) -> list[Response]:
    """The responses to `simulations` that may have more times than a lane: each takes as many lanes as it needs."""
    pieces: list[Simulation] = []
    counts: list[int] = []
    for simulation in simulations:
        size = sizes[simulation.experiment.group]
        parts = [simulation.times[i : i + size] for i in range(0, simulation.times.size, size)]
        if simulation.experiment.drive is None and len(parts) > 1:
            # A prescribed motion is known at its own samples only.
            parts = [simulation.times[:: -(-simulation.times.size // size)]]
        pieces += [simulation._replace(times=part) for part in parts]
        counts.append(len(parts))
    responses = iter(sensitivities.responses(pieces, progress))
    out = []
    for count in counts:
        parts = [next(responses) for _ in range(count)]
        joined = np.concatenate([part.predicted for part in parts]), np.concatenate([part.jacobian for part in parts])
        out.append(Response(*joined))
    return out
