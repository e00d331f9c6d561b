"""The benchmark can be trusted: its parts import, and its simulators do the same run.  No clock is looked at."""

import importlib
import json
import math
import pkgutil

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import benchmarks
from benchmarks.grid import Grid, in_blocks
from benchmarks.measure import Curve, Entry, Outcome, Rung, climb
from benchmarks.peer_fits import AbstractFit, OutOfTime, Residual
from benchmarks.peers import peers
from benchmarks.peers.base import AbstractPeer, differences, persist
from benchmarks.peers.c_floor import CFloor, simulate, simulate_grid
from benchmarks.peers.pdssjax_taylor import PdssJax
from benchmarks.peers.scipy_lsoda import SciPyLSODA
from benchmarks.problem import NAMES, PARAMETERS, Problem, effector, pieces
from benchmarks.rig import sawtooths, truth
from benchmarks.table import as_json, as_markdown, as_text
from pdssjax import Accuracy, Taylor
from pdssjax.integration import TIGHT

SHORT = Problem(cycles=2, samples=101)
needs_gcc = pytest.mark.skipif(CFloor().missing() is not None, reason="there is no gcc")
ACCURACY = Accuracy(1e-13, 1e-13, Taylor(6))  # a low order: little to compile


@pytest.fixture(scope="module")
def ours() -> np.ndarray:
    """The short run by pdssjax [um]."""
    return np.asarray(jax.jit(lambda p: effector(p, SHORT, ACCURACY))(PARAMETERS))


def worst(jacobian, right) -> float:
    return float(np.max(np.linalg.norm(jacobian - right, axis=0) / np.linalg.norm(right, axis=0)))


def test_every_module_imports_and_every_peer_is_found():
    for module in pkgutil.walk_packages(benchmarks.__path__, "benchmarks."):
        importlib.import_module(module.name)
    found = [peer.name for peer in peers()]
    assert len(found) == len(set(found))
    assert {"C floor", "CasADi CVODES", "diffrax Tsit5", "diffrax Kvaerno5", "numbalsoda", "SciPy LSODA"} <= set(found)
    assert all(peer.tolerances == tuple(sorted(peer.tolerances, reverse=True)) for peer in peers())


def test_scipy_agrees(ours):
    trajectory = SciPyLSODA(numba=False).trajectory(SHORT).run(PARAMETERS, 1e-9)
    np.testing.assert_allclose(trajectory, ours, atol=1e-5)


@needs_gcc
def test_the_c_floor_agrees(ours):
    np.testing.assert_allclose(simulate(PARAMETERS, SHORT, 1e-8, order=12)[0], ours, atol=1e-6)


@needs_gcc
def test_the_jacobian_of_the_c_floor_agrees_with_differences():
    jacobian = simulate(PARAMETERS, SHORT, 1e-8, order=12, jacobian=True)[1]
    run = lambda p, tolerance: simulate(p, SHORT, tolerance, order=12)[0]
    assert worst(differences(run, PARAMETERS, 1e-10), jacobian) < 1e-4


@needs_gcc
@pytest.mark.slow
def test_the_jacobian_of_the_c_floor_agrees_with_ours():
    # The low order is too coarse for derivatives: 7e-5.
    right = jax.jit(jax.jacfwd(lambda q: effector(PARAMETERS * jnp.exp(q), SHORT, TIGHT)))(jnp.zeros(len(NAMES)))
    assert worst(simulate(PARAMETERS, SHORT, 1e-8, order=12, jacobian=True)[1], np.asarray(right)) < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("peer", peers(), ids=lambda peer: peer.name)
def test_every_peer_agrees(peer: AbstractPeer, ours):
    if reason := peer.missing():
        pytest.skip(reason)
    trajectory = peer.trajectory(SHORT).run(PARAMETERS, min(peer.tolerances))
    np.testing.assert_allclose(trajectory, ours, atol=1e-4)


def points_one_by_one(grid: Grid) -> np.ndarray:
    """The C stepper on each point of a grid, as a record of its own, read at the samples."""
    rows = []
    for (voltage, frequency), times in zip(grid.points, grid.times, strict=True):
        dense = Problem(voltage, frequency, grid.cycles + 1, 50 * (grid.cycles + 1) + 1)
        found = simulate(PARAMETERS, dense, 1e-8, order=12)[0]
        # The samples stand at multiples of 0.02 of a period.
        rows.append(found[np.round(50 * times * frequency).astype(int)])
    return np.array(rows)


SWEEP = Grid((20.0, 64.0, 80.0), (2.0, 5.0, 50.0), cycles=2)


@needs_gcc
def test_the_c_floor_sweeps_as_it_runs_one_by_one():
    np.testing.assert_allclose(simulate_grid(PARAMETERS, SWEEP, 1e-8, order=12), points_one_by_one(SWEEP), atol=1e-6)


@needs_gcc
@pytest.mark.slow
@pytest.mark.parametrize("peer", [p for p in peers() if p.sweep_tolerances], ids=lambda peer: peer.name)
def test_every_peer_sweeps_alike(peer: AbstractPeer):
    if reason := peer.missing():
        pytest.skip(reason)
    found = peer.sweep(SWEEP).run(PARAMETERS, min(peer.sweep_tolerances))
    np.testing.assert_allclose(found, simulate_grid(PARAMETERS, SWEEP, 1e-8, order=12), atol=2e-3)


@pytest.mark.slow
@needs_gcc
def test_ours_sweeps_like_the_c_floor():
    found = PdssJax(6).sweep(SWEEP).run(PARAMETERS, 1e-6)
    np.testing.assert_allclose(found, simulate_grid(PARAMETERS, SWEEP, 1e-8, order=12), atol=1e-3)


def test_blocks_hold_every_row_and_repeat_the_last():
    rows = np.arange(70.0).reshape(35, 2)
    blocks = in_blocks(rows)
    np.testing.assert_array_equal(blocks.reshape(-1, 2)[:35], rows)
    assert (blocks.reshape(-1, 2)[35:] == rows[-1]).all()


@needs_gcc
def test_casadi_agrees_in_its_trajectory_but_not_in_its_jacobian():
    pytest.importorskip("casadi")
    peer = next(peer for peer in peers() if peer.name == "CasADi CVODES")
    values, slopes = simulate(PARAMETERS, SHORT, 1e-8, order=12, jacobian=True)
    np.testing.assert_allclose(peer.trajectory(SHORT).run(PARAMETERS, 1e-9), values, atol=1e-4)
    assert worst(peer.jacobian(SHORT).run(PARAMETERS, 1e-9), slopes) > 0.1


def test_a_solver_that_gets_stuck_is_tried_at_looser_tolerances():
    tried = []
    found = persist(lambda t: tried.append(t) or np.array([np.nan if len(tried) < 3 else 1.0]), 1e-7)
    assert found == 1.0 and tried == sorted(tried) and len(tried) == 3


class _Walks(AbstractFit):
    """Asks for the residuals again and again."""

    name = "walks"

    def minimise(self, residual, start):
        for i in range(10**9):
            residual(start * (1 + 1e-6 * i))
        return ""


def test_a_fit_is_broken_off_and_keeps_its_best():
    residual = Residual(SciPyLSODA(numba=False), sawtooths(), truth())
    residual._whitened = lambda x: 1.0 + x
    found = _Walks().run(residual, 0.05)
    assert found.cut and found.calls > 1 and "more than" in found.says()
    assert found.chi2 == residual.best[0] == 4.0 * len(residual.free)
    assert found.values["effector.mass"] == truth()["effector.mass"]
    with pytest.raises(OutOfTime):
        residual(np.ones(len(residual.free)))


def test_pieces_cover_the_record():
    found = pieces(SHORT.drive(), 0.4)
    assert [(piece.begin, piece.end) for piece in found] == [(0.0, 0.2), (0.2, 0.4)]
    assert all(piece.voltage == 0.0 and math.isclose(piece.slope, 320.0) for piece in found)


def test_a_lucky_rung_is_not_chosen():
    errors = [1e-4, 1e-2, 1e-3, 1e-5]
    curve = Curve("job", "who", [Rung(10.0**-i, error, 1.0) for i, error in enumerate(errors)])
    found = curve.reaching(1e-3)
    assert found and found.tolerance == 1e-2
    assert curve.reaching(1e-6) is None


def test_the_ladder_ends_where_a_run_fails():
    error = {1.0: 1e-2, 0.1: 1e-3, 0.01: math.inf}
    curve = climb("job", "who", lambda tolerance: tolerance, error.__getitem__, list(error))
    assert [rung.tolerance for rung in curve.rungs] == [1.0, 0.1]


def test_results_are_shown_and_kept():
    entry = Entry("job", "a peer", None, "1e-3", 1e-5, 3.0, True, 0.5, 0.002, [0.001, 0.003, 0.002], "a note")
    curve = Curve("job", "a peer", [Rung(1e-5, 3.0, 0.002)], wrong=True)
    outcomes = {"job": Outcome([entry], [curve], {"count": 3}, ["a sentence"])}
    head = {"date": "2026-01-01", "processor": "p", "cores": 2, "system": "s", "python": "3", "gcc": None}
    head |= {"packages": {"jax": "1"}, "revision": None, "load_before": [0.5]}
    for text in (as_text(head, outcomes), as_markdown(head, outcomes, "plot.png")):
        assert "WRONG" in text and "2 ms" in text and "a sentence" in text
    kept = json.loads(as_json(head, outcomes))
    assert kept["entries"][0]["median_seconds"] == 0.002
    assert kept["curves"][0]["wrong"] and kept["facts"] == {"count": 3}
