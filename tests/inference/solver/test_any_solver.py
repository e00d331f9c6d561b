"""The lines of docs/python.md that put a study into SciPy and into optimistix end where the data say."""

import pickle
import re
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import optimistix
import pytest
from platform_study import DAMPING, GAIN, PLATFORM, RATE, write_platform

import pdssjax

PAGE = Path(__file__).parents[3] / "docs/python.md"
TRUTH = {"piezo.gain": GAIN, "piezo.natural_frequency": RATE, "piezo.damping_ratio": DAMPING}


@pytest.fixture
def study(tmp_path) -> pdssjax.Study:
    """Of a platform alone, in closed form; nothing is said of the contact."""
    text = "\n".join(line for line in PLATFORM.splitlines() if '"friction.' not in line)
    return pdssjax.load_study(write_platform(tmp_path, text))


@pytest.mark.parametrize("solver", ["scipy", "optimistix"])
def test_a_study_goes_into_any_solver_in_three_lines(study, solver):
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)
    posed = [block for block in blocks if "pose_problem" in block]
    (lines,) = [block for block in posed if f"import {solver}" in block or f"from {solver}" in block]
    given = {"pdssjax": pdssjax, "study": study}
    exec(lines, given)
    problem, start, values = given["problem"], given["start"], given["values"]

    found, jacobian = problem.encode(values), problem.jacobian(problem.encode(values))
    residual = np.asarray(problem.whitened(found))
    assert float(residual @ residual) < float(np.sum(np.asarray(problem.whitened(start)) ** 2))
    # No column has anything left to explain, and the truth lies within five standard errors.
    norms = np.linalg.norm(jacobian, axis=0) * np.linalg.norm(residual)
    assert np.max(np.abs(residual @ jacobian) / norms) < 1e-4
    errors = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    assert np.all(np.abs(found - problem.encode(TRUTH)) < 5.0 * errors)
    assert set(values) == set(TRUTH)


def test_the_jacobian_of_a_problem_is_that_of_its_residuals(study):
    problem, start = pdssjax.pose_problem(study)
    step = 1e-6 * np.eye(start.size)
    central = [(problem.whitened(start + h) - problem.whitened(start - h)) / 2e-6 for h in step]
    jacobian = np.asarray(problem.jacobian(start))
    np.testing.assert_allclose(jacobian, np.stack(central, axis=1), atol=1e-5 * np.abs(jacobian).max())
    assert np.all(problem.bounds[0] <= start) and np.all(start <= problem.bounds[1])


def test_a_problem_passes_through_jit_and_as_arguments_of_a_solver(study):
    problem, start = pdssjax.pose_problem(study)
    given, traced = np.asarray(problem.whitened(start)), []

    @jax.jit
    def whitened(problem, free):
        traced.append(free)
        return problem.whitened(free)

    np.testing.assert_allclose(whitened(problem, start), given, rtol=1e-9)
    twice = eqx.tree_at(lambda problem: problem.noise, problem, 2.0 * problem.noise)
    np.testing.assert_allclose(whitened(twice, start), 0.5 * given, rtol=1e-9)
    assert len(traced) == 1

    solver = optimistix.LevenbergMarquardt(rtol=1e-8, atol=1e-8)
    found = optimistix.least_squares(lambda free, problem: problem.whitened(free), solver, start, args=twice)
    closed = optimistix.least_squares(lambda free, _: twice.whitened(free), solver, start)
    np.testing.assert_allclose(found.value, closed.value, rtol=1e-6)
    assert pickle.loads(pickle.dumps(problem)).noise == problem.noise
