"""Predictions of experiments and their derivatives by the free parameters, at dense times, in few compiled programs.

Experiments of one kind and waveform are lanes of one predictor of `pdssjax.study`: voltage, frequency, duty,
direction, sample times and the parameters are arguments of what is compiled, so that any number of experiments, draws
and steps of a search share it.
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
from .experiments import Experiment, Limits
from .sampling import Grid

LANES = 8
"""Experiments that are run one after the other in one call."""


class Task(NamedTuple):
    """An experiment at times, under one draw of the parameters."""

    experiment: Experiment
    times: Float[np.ndarray, " m"]
    """[s], ascending, of any number up to that of the group."""
    free: Float[np.ndarray, " p"]
    """The free parameters on the fit's scale."""


class Response(NamedTuple):
    """Predicted samples of an experiment, without a zero of its own."""

    predicted: Float[np.ndarray, " m"]
    """In the unit of the measurement; NaN where the simulation failed."""
    jacobian: Float[np.ndarray, "m p"]
    """The derivative by the free parameters, on the fit's scale."""

    @property
    def finite(self) -> bool:
        """Whether it could be simulated and differentiated."""
        return bool(np.isfinite(self.predicted).all() and np.isfinite(self.jacobian).all())


class _Group(NamedTuple):
    """Compiled functions and sizes shared by experiments of one kind and waveform."""

    problem: Problem
    size: int
    """Sample times of a lane."""
    duration: float
    segments: int


class Sensitivities:
    """Predicts the experiments of a study with all its numbers known, and differentiates the predictions."""

    def __init__(self, study: Study, experiments: Sequence[Experiment], sizes: Mapping[tuple[str, str], int]):
        """**Arguments:** `sizes` are the most sample times by group of the `experiments`."""
        self.study = study
        self.values = study.values()
        self._groups: dict[tuple[str, str], _Group] = {}
        self._by_group: dict[tuple[str, str], list[Experiment]] = {}
        for experiment in experiments:
            self._by_group.setdefault(experiment.group, []).append(experiment)
        for group, size in sizes.items():
            if group in self._by_group:
                self._groups[group] = self._group(self._by_group[group], size)
        self.problem = next(iter(self._groups.values())).problem

    @property
    def paths(self) -> tuple[str, ...]:
        """The free parameters, in the order of the columns."""
        return self.problem.residual.transform.paths

    def _group(self, experiments: Sequence[Experiment], size: int) -> _Group:
        """The problem of `LANES` records of a kind and waveform, compiled once whatever these are."""
        times = np.linspace(0.0, 1.0, size)
        problem = pose(self._with_lanes([(experiments[0], times)], size), self.values, self.study.accuracy)
        # By its own residual, whose lanes are exchanged, not by what predicts the records of a study.
        return _Group(problem._replace(predictor=None), size, 0.0, 0)

    def _with_lanes(self, lanes: Sequence[tuple[Experiment, Float[np.ndarray, " m"]]], size: int) -> Study:
        # Information is that on each parameter's own scale: what a constraint forbids is no matter of derivatives.
        return dataclasses.replace(self.study, records=tuple(self._records(lanes, size)), constraints=())

    def _records(self, lanes: Sequence[tuple[Experiment, Float[np.ndarray, " m"]]], size: int) -> list[Record]:
        """One record per lane: the last one is repeated, and times are padded with the last time."""
        filled = [*lanes, *[lanes[-1]] * (LANES - len(lanes))]
        padded = [(e, np.pad(times, (0, size - times.size), mode="edge")) for e, times in filled]
        made = [e.record(self.study, f"lane {n}", times, 1.0, 0.0) for n, (e, times) in enumerate(padded)]
        # What is set for a record is an argument of what is compiled, and no condition.
        return [dataclasses.replace(record, conditions=frozenset()) for record in made]

    def prepare(self, limits: Limits, grids: Sequence[tuple[Experiment, Grid]]) -> None:
        """Tell how long records may get, which is part of what is compiled.

        **Arguments:** complete `limits`, and the `grids` of all experiments.
        """
        for group, found in self._groups.items():
            own = [(e, grid) for e, grid in grids if e.group == group]
            longest = max(max(float(grid.times[-1]) for _, grid in own), limits.duration or 0.0)
            segments = []
            for experiment, grid in own:
                setup = experiment.measurement.setup(self.study.models)
                until = grid.times if experiment.drive is None else np.array([longest])
                segments.append(setup.segments(experiment.drive, until))
            size = found.size if own[0][0].drive is None else 0
            # Frequencies between those of the experiments have no more segments than the highest of them.
            self._groups[group] = found._replace(duration=longest, segments=max(*segments, size, 2))

    def responses(self, tasks: Sequence[Task], progress: Callable[[int, int], None] | None = None) -> list[Response]:
        """Responses of the tasks, in their order; those of one group, rig and draw run together."""
        batches: dict[object, list[int]] = {}
        for place, task in enumerate(tasks):
            key = (task.experiment.group, task.experiment.rig, task.free.tobytes())
            batches.setdefault(key, []).append(place)
        parts = [places[i : i + LANES] for places in batches.values() for i in range(0, len(places), LANES)]
        found: dict[int, Response] = {}
        # What is compiled for one group runs beside what is compiled for another.
        with ThreadPoolExecutor(min(2, os.cpu_count() or 1)) as pool:
            done = pool.map(lambda places: self._run([tasks[place] for place in places]), parts)
            for places, responses in zip(parts, done, strict=True):
                found |= dict(zip(places, responses, strict=True))
                if progress is not None:
                    progress(len(found), len(tasks))
        return [found[place] for place in range(len(tasks))]

    def _run(self, tasks: Sequence[Task]) -> list[Response]:
        """The tasks of one batch."""
        group = self._groups[tasks[0].experiment.group]
        records = self._records([(task.experiment, task.times) for task in tasks], group.size)
        predictor = Predictor(self.study.models, records)
        lanes = dataclasses.replace(predictor.groups[0], duration=group.duration, segments=group.segments)
        problem = eqx.tree_at(lambda p: p.residual.predictor.groups, group.problem, (lanes,))
        rig = {path: np.asarray(number, float) for path, number in tasks[0].experiment.rig}
        fixed = problem.residual.fixed | rig
        problem = eqx.tree_at(lambda p: p.residual.fixed, problem, fixed)
        used = np.arange(LANES) < len(tasks)
        # A record of no weight is not run.
        problem = eqx.tree_at(lambda p: p.noise, problem, np.where(used, 1.0, np.inf))
        residual, jacobian = (np.asarray(part) for part in problem.linearised(tasks[0].free))
        out = []
        for lane, task in enumerate(tasks):
            rows = slice(lane * group.size, lane * group.size + task.times.size)
            out.append(Response(-residual[rows], -jacobian[rows]))
        return out
