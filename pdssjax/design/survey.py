"""The information of any sampling of any experiment, from few simulations: dense responses, kept and interpolated.

Experiments of one kind and waveform are lanes of one predictor of `pdssjax.study`: voltage, frequency, duty,
direction, sample times and the parameters are arguments of what is compiled, so that any number of experiments, draws
and steps of a search share it.  Under every draw of the parameters an experiment is simulated and differentiated once,
on its grid; every schedule of its samples then is an interpolation, a whitening and a product of matrices.
"""

import dataclasses
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float

from ..inference import Problem, pose
from ..study import Predictor, Record, Study
from .experiments import CompleteLimits, Experiment
from .information import Noise, record_information
from .sampling import Grid, Schedule

LANES = 8
"""Experiments that are run one after the other in one call."""


class Simulation(NamedTuple):
    """An experiment at times, under one draw of the parameters."""

    experiment: Experiment
    times: Float[np.ndarray, " m"]
    """[s], ascending, of any number up to that of the group."""
    free: Float[np.ndarray, " p"]
    """The free parameters on the fit's scale."""


class Response(NamedTuple):
    """Predicted samples of an experiment, without a zero of its own."""

    predicted: Float[np.ndarray, " m"]
    """Predicted samples in the unit of the measurement; NaN where the simulation failed."""
    jacobian: Float[np.ndarray, "m p"]
    """The derivative by the free parameters, on the fit's scale."""


class _Group(NamedTuple):
    """Compiled functions and sizes shared by experiments of one kind and waveform."""

    problem: Problem
    size: int
    """Sample times of a lane."""
    duration: float
    segments: int


class Sensitivities:
    """Predicts the experiments of a study with all its numbers known, and differentiates the predictions."""

    def __init__(
        self,
        study: Study,
        limits: CompleteLimits,
        grids: Mapping[Experiment, Grid],
        sizes: Mapping[tuple[str, str], int],
    ):
        """**Arguments:** the `grids` of all experiments; `sizes` are the most sample times by group."""
        self.study = study
        self._groups = {
            group: self._group(limits, {e: grid for e, grid in grids.items() if e.group == group}, size)
            for group, size in sizes.items()
        }
        self.problem = next(iter(self._groups.values())).problem

    @property
    def paths(self) -> tuple[str, ...]:
        """The free parameters, in the order of the columns."""
        return self.problem.residual.transform.paths

    def _group(self, limits: CompleteLimits, grids: Mapping[Experiment, Grid], size: int) -> _Group:
        """The problem of `LANES` records of a kind and waveform, compiled once whatever these are.

        How long records may get is part of what is compiled.
        """
        first = next(iter(grids))
        lanes = self._records([(first, np.linspace(0.0, 1.0, size))], size)
        # Information is that on each parameter's own scale: what a constraint forbids is no matter of derivatives.
        study = dataclasses.replace(self.study, records=tuple(lanes), constraints=())
        problem = pose(study, study.values(), study.accuracy)
        longest = max(*(float(grid.times[-1]) for grid in grids.values()), limits.duration)
        segments = []
        for experiment, grid in grids.items():
            setup = experiment.measurement.setup(study.models)
            until = grid.times if experiment.drive is None else np.array([longest])
            segments.append(setup.segments(experiment.drive, until))
        # Frequencies between those of the experiments have no more segments than the highest of them.
        most = max(*segments, size if first.drive is None else 0, 2)
        # By its own residual, whose lanes are exchanged, not by what predicts the records of a study.
        return _Group(problem._replace(predictor=None), size, longest, most)

    def _records(self, lanes: Sequence[tuple[Experiment, Float[np.ndarray, " m"]]], size: int) -> list[Record]:
        """One record per lane: the last one is repeated, and times are padded with the last time."""
        filled = [*lanes, *[lanes[-1]] * (LANES - len(lanes))]
        padded = [(e, np.pad(times, (0, size - times.size), mode="edge")) for e, times in filled]
        made = [e.record(self.study, f"lane {n}", times, 1.0, 0.0) for n, (e, times) in enumerate(padded)]
        # What is set for a record is an argument of what is compiled, and no condition.
        return [dataclasses.replace(record, conditions=frozenset()) for record in made]

    def responses(
        self, simulations: Sequence[Simulation], progress: Callable[[int, int], None] | None = None
    ) -> list[Response]:
        """Responses of the simulations, in their order; those of one group, rig and draw run together."""
        batches: dict[object, list[int]] = {}
        for place, simulation in enumerate(simulations):
            key = (simulation.experiment.group, simulation.experiment.rig, simulation.free.tobytes())
            batches.setdefault(key, []).append(place)
        parts = [places[i : i + LANES] for places in batches.values() for i in range(0, len(places), LANES)]
        found: dict[int, Response] = {}
        # What is compiled for one group runs beside what is compiled for another.
        with ThreadPoolExecutor(min(2, os.cpu_count() or 1)) as pool:
            done = pool.map(lambda places: self._run([simulations[place] for place in places]), parts)
            for places, responses in zip(parts, done, strict=True):
                found |= dict(zip(places, responses, strict=True))
                if progress is not None:
                    progress(len(found), len(simulations))
        return [found[place] for place in range(len(simulations))]

    def _run(self, simulations: Sequence[Simulation]) -> list[Response]:
        """The responses of one batch."""
        group = self._groups[simulations[0].experiment.group]
        records = self._records([(simulation.experiment, simulation.times) for simulation in simulations], group.size)
        predictor = Predictor(self.study.models, records)
        lanes = dataclasses.replace(predictor.groups[0], duration=group.duration, segments=group.segments)
        problem = eqx.tree_at(lambda p: p.residual.predictor.groups, group.problem, (lanes,))
        rig = {path: np.asarray(number, float) for path, number in simulations[0].experiment.rig}
        fixed = problem.residual.fixed | rig
        problem = eqx.tree_at(lambda p: p.residual.fixed, problem, fixed)
        used = np.arange(LANES) < len(simulations)
        # A record of no weight is not run.
        problem = eqx.tree_at(lambda p: p.noise, problem, np.where(used, 1.0, np.inf))
        residual, jacobian = (np.asarray(part) for part in problem.linearised(simulations[0].free))
        out = []
        for lane, simulation in enumerate(simulations):
            rows = slice(lane * group.size, lane * group.size + simulation.times.size)
            out.append(Response(-residual[rows], -jacobian[rows]))
        return out


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
