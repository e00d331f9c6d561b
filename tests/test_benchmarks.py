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
from benchmarks.measure import Curve, Entry, Outcome, Rung, climb
from benchmarks.peers import peers
from benchmarks.peers.base import AbstractPeer, differences
from benchmarks.peers.c_floor import CFloor, simulate
from benchmarks.peers.scipy_lsoda import SciPyLSODA
from benchmarks.problem import NAMES, PARAMETERS, Problem, effector, pieces
from benchmarks.table import as_json, as_markdown, as_text
from pdssjax.expansion import Taylor
from pdssjax.integration import Accuracy

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
    assert {"C floor", "diffrax Tsit5", "diffrax Kvaerno5", "numbalsoda", "SciPy LSODA"} <= set(found)
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
    right = jax.jit(jax.jacfwd(lambda q: effector(PARAMETERS * jnp.exp(q), SHORT, ACCURACY)))(jnp.zeros(len(NAMES)))
    assert worst(simulate(PARAMETERS, SHORT, 1e-8, order=12, jacobian=True)[1], np.asarray(right)) < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("peer", peers(), ids=lambda peer: peer.name)
def test_every_peer_agrees(peer: AbstractPeer, ours):
    if reason := peer.missing():
        pytest.skip(reason)
    trajectory = peer.trajectory(SHORT).run(PARAMETERS, min(peer.tolerances))
    np.testing.assert_allclose(trajectory, ours, atol=1e-4)


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
