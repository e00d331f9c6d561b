"""`study.predict` on the two 5 Hz records of the packaged example, and its Jacobian (nine columns)."""

import dataclasses
import time

import jax
import jax.numpy as jnp
import numpy as np

from pdssjax import Accuracy, Study, Taylor

from ..contest import contest
from ..measure import Effort, Entry, Outcome, interleave, seconds_of
from ..peers.base import AbstractPeer, Prepared, ladder
from ..problem import UM, Reference
from ..rig import sawtooths, truth


def measure(effort: Effort) -> Outcome:
    """At the accuracy asked for, and as a user calls it, at the default."""
    right = _reference()
    able = [(_Prediction(8, every), ladder(1e-3, 1e-6)) for every in (False, True)]
    values = contest(
        "predict",
        able,
        prepare=lambda peer: peer.trajectory(None),  # pyright: ignore[reportArgumentType]
        error=right.error,
        targets={"0.001 um": 1e-3},
        parameters=_start(),
        effort=effort,
    )
    slopes = contest(
        "predict, Jacobian",
        able,
        prepare=lambda peer: peer.jacobian(None),  # pyright: ignore[reportArgumentType]
        error=right.jacobian_error,
        targets={"0.001": 1e-3},
        parameters=_start(),
        effort=effort,
    )
    usual = _as_called(right, effort)
    return Outcome(values.entries + slopes.entries + usual)


def _as_called(right: Reference, effort: Effort) -> list[Entry]:
    """`study.predict(values)` and its Jacobian, neither wrapped nor tuned."""
    study, start = sawtooths(), _start()
    paths = _paths(study)
    given = dict(zip(paths, start, strict=True))
    slopes = jax.jit(jax.jacfwd(lambda vector: _stacked(study, vector, Accuracy())))
    whole = lambda rows: UM * np.concatenate([np.asarray(row) for row in rows])
    scaled = lambda jacobian: UM * np.asarray(jacobian) * start
    calls = {
        "predict": (lambda: jax.block_until_ready(study.predict(given)), lambda rows: right.error(whole(rows))),
        "predict, Jacobian": (
            lambda: jax.block_until_ready(slopes(start)),
            lambda jacobian: right.jacobian_error(scaled(jacobian)),
        ),
    }
    entries = []
    for job, (call, error) in calls.items():
        effort.report(f"{job}: as called")
        entry = Entry(job, "pdssjax, as called", call, "default", float(Accuracy().tolerance) * UM, ours=True)
        entry.first_seconds = seconds_of(call)
        entry.error, entry.note = error(call()), "compilation within the first call"
        entries.append(entry)
    interleave(entries, effort)
    return entries


def _reference() -> Reference:
    study, start = sawtooths(every_cycle=True), _start()
    tight = Accuracy(1e-15, 1e-15, Taylor(12))

    def run(logarithms):
        x = UM * _stacked(study, start * jnp.exp(logarithms), tight)
        return x, x

    jacobian, values = jax.jit(jax.jacfwd(run, has_aux=True))(jnp.zeros(start.size))
    return Reference(np.asarray(values), np.asarray(jacobian))


@dataclasses.dataclass(frozen=True)
class _Prediction(AbstractPeer):
    """`study.predict` compiled for any tolerance."""

    order: int
    every_cycle: bool

    @property
    def name(self) -> str:
        return f"pdssjax, order {self.order}" + (", every cycle stepped" if self.every_cycle else "")

    def trajectory(self, problem) -> Prepared:
        return self._compiled(lambda study, p, accuracy: UM * _stacked(study, p, accuracy))

    def jacobian(self, problem) -> Prepared:
        def run(study, p, accuracy):
            logarithmic = lambda q: UM * _stacked(study, p * jnp.exp(q), accuracy)
            return jax.jacfwd(logarithmic)(jnp.zeros(p.size))

        return self._compiled(run)

    def _compiled(self, function) -> Prepared:
        study = sawtooths(self.every_cycle)

        def run(p, tolerance):
            return function(study, p, Accuracy(1e-6 * tolerance, 1e-6 * tolerance, Taylor(self.order)))

        begun = time.perf_counter()
        ready = jax.jit(run).lower(_start(), 1e-5).compile()
        seconds = time.perf_counter() - begun
        return Prepared(lambda p, tolerance: np.asarray(ready(p, tolerance)), seconds)


def _paths(study: Study) -> list[str]:
    return [path for path, parameter in study.parameters.items() if parameter.free]


def _start() -> np.ndarray:
    return np.array([truth()[path] for path in _paths(sawtooths())])


def _stacked(study: Study, vector, accuracy: Accuracy):
    """All samples of all records as one vector [m]."""
    return jnp.concatenate(study.predict(dict(zip(_paths(study), vector, strict=True)), accuracy))
