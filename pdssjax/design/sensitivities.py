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
from .experiments import CompleteLimits, Experiment
from .sampling import Grid

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
