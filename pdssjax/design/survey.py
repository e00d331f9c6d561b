"""The information of any sampling of any experiment, from few simulations: dense responses, kept and interpolated.

Under every draw of the parameters an experiment is simulated and differentiated once, on its grid; every schedule of
its samples then is an interpolation, a whitening and a product of matrices.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from ..study import Study
from .experiments import Experiment, Limits
from .information import Noise, record_information
from .sampling import Grid, Schedule
from .sensitivities import Response, Sensitivities, Task

_LEAST_LANE = 400
"""Sample times of a lane at least."""


@dataclasses.dataclass(frozen=True, eq=False)
class Point:
    """Parameters of the study, and of its rival where there is one, at which experiments are simulated."""

    free: Float[np.ndarray, " p"]
    """The study's free parameters on the fit's scale."""
    rival: Float[np.ndarray, " r"] | None = None
    """The rival's."""


class Survey:
    """Simulates experiments of a study, and of a rival study with another law, and keeps what they show."""

    def __init__(self, study: Study, rival: Study | None, limits: Limits, experiments: Sequence[Experiment]):
        self.limits = limits
        self.experiments = list(experiments)
        ringing = study.values().get("piezo.natural_frequency")
        self.ringing = None if ringing is None else float(ringing)
        self._grids = {experiment: self._new_grid(experiment) for experiment in experiments}
        sizes: dict[tuple[str, str], int] = {}
        for experiment, grid in self._grids.items():
            sizes[experiment.group] = max(sizes.get(experiment.group, _LEAST_LANE), grid.times.size)
        self.sizes = sizes
        self.own = Sensitivities(study, experiments, sizes)
        self.rival = None if rival is None else Sensitivities(rival, experiments, sizes)
        pairs = list(self._grids.items())
        for sensitivities in (self.own, self.rival):
            if sensitivities is not None:
                sensitivities.prepare(limits, pairs)
        self._columns: dict[tuple[Experiment, int], Float[np.ndarray, "m q"]] = {}

    @property
    def size(self) -> int:
        """Columns of an information: parameters of the study, and with a rival its parameters and the difference."""
        return len(self.own.paths) + (0 if self.rival is None else len(self.rival.paths) + 1)

    def _new_grid(self, experiment: Experiment) -> Grid:
        return experiment.grid(self.ringing, self.limits.interval or 1e-3, self.limits.duration or 1.0)

    def grid(self, experiment: Experiment) -> Grid:
        """The dense grid of an experiment."""
        if experiment not in self._grids:
            self._grids[experiment] = self._new_grid(experiment)
        return self._grids[experiment]

    def noise(self, kind: str) -> Noise:
        """The noise of a kind of record, misfit included."""
        return Noise(self.limits.noise[kind], self.limits.correlation_time.get(kind, 0.0))

    def simulate(
        self, experiments: Sequence[Experiment], points: Mapping[int, Point], progress: Callable[[int, int], None]
    ) -> None:
        """Simulate the `experiments` on their grids at all `points`, by their number, as far as that is not done."""
        pairs = [(e, k) for k in points for e in experiments if (e, k) not in self._columns]
        asked = [(e, points[k], self.grid(e).times) for e, k in pairs]
        for pair, columns in zip(pairs, self.columns(asked, progress), strict=True):
            self._columns[pair] = columns

    def columns(
        self,
        asked: Sequence[tuple[Experiment, Point, Float[np.ndarray, " m"]]],
        progress: Callable[[int, int], None] | None = None,
    ) -> list[Float[np.ndarray, "m q"]]:
        """The Jacobian of each experiment at a point and times; with a rival [J, J_rival, difference].

        Not finite where a simulation fails.
        """
        own = _in_pieces(self.own, [Task(e, t, point.free) for e, point, t in asked], self.sizes, progress)
        if self.rival is None:
            return [response.jacobian for response in own]
        wanted = [(e, t, point.rival) for e, point, t in asked]
        tasks = [Task(e, t, free) for e, t, free in wanted if free is not None]
        other = _in_pieces(self.rival, tasks, self.sizes, None)
        return [
            np.column_stack([mine.jacobian, theirs.jacobian, mine.predicted - theirs.predicted])
            for mine, theirs in zip(own, other, strict=True)
        ]

    def extent(self, experiment: Experiment, point: Point) -> float:
        """Range of the measured quantity in the cycles of the grid, in its unit."""
        (seen,) = self.own.responses([Task(experiment, self.grid(experiment).times, point.free)])
        return float(np.ptp(seen.predicted))

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

    def exact_information(
        self, records: Sequence[tuple[Experiment, Schedule]], points: Sequence[Point]
    ) -> Float[np.ndarray, "records draws q q"]:
        """The information of `records` at all `points`, simulated at their own samples."""
        times = [schedule.times(experiment.period) for experiment, schedule in records]
        asked = [(e, point, t) for (e, _), t in zip(records, times, strict=True) for point in points]
        columns = self.columns([(e, point, np.maximum(t, 0.0)) for e, point, t in asked])
        found = []
        for (experiment, _, t), each in zip(asked, columns, strict=True):
            each = np.where(t[:, None] < 0.0, 0.0, each)
            finite = bool(np.isfinite(each).all())
            noise = self.noise(experiment.kind)
            found.append(record_information(each, t, noise) if finite else np.zeros((self.size, self.size)))
        return np.array(found).reshape(len(records), len(points), self.size, self.size)


def _in_pieces(
    sensitivities: Sensitivities,
    tasks: Sequence[Task],
    sizes: Mapping[tuple[str, str], int],
    progress: Callable[[int, int], None] | None,
) -> list[Response]:
    """The responses to `tasks` that may have more times than a lane: each is simulated in as many lanes as it takes."""
    pieces: list[Task] = []
    counts: list[int] = []
    for task in tasks:
        size = sizes[task.experiment.group]
        parts = [task.times[i : i + size] for i in range(0, task.times.size, size)]
        if task.experiment.drive is None and len(parts) > 1:  # a prescribed motion is known at its own samples only
            parts = [task.times[:: -(-task.times.size // size)]]
        pieces += [task._replace(times=part) for part in parts]
        counts.append(len(parts))
    responses = iter(sensitivities.responses(pieces, progress))
    out = []
    for count in counts:
        parts = [next(responses) for _ in range(count)]
        joined = np.concatenate([part.predicted for part in parts]), np.concatenate([part.jacobian for part in parts])
        out.append(Response(*joined))
    return out
