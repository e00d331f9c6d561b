"""Differentiating the steps of an ordinary solver misses how events move: by how much, docs/numerics.md draws."""

import numpy as np
import pytest

from benchmarks.plain_differentiation import SHOWN, derivatives, draw
from benchmarks.problem import NAMES, Problem, column_errors


# By default `test_benchmarks` has a solver whose Jacobian is wrong.
@pytest.mark.slow
def test_a_differentiated_solver_is_wrong_where_pdssjax_is_right():
    problem = Problem(cycles=2, samples=81)
    found = derivatives(problem)
    assert column_errors(found.ours, found.differences).max() < 1e-5
    plain = dict(zip(NAMES, column_errors(found.plain, found.differences), strict=True))
    assert plain["natural frequency"] > 2.0 and plain["mass"] > 0.1
    figure = draw(problem, found)
    assert [axes.get_title().split(":")[0] for axes in figure.axes] == list(SHOWN)
    drawn = figure.axes[0].lines[1].get_ydata()
    np.testing.assert_array_equal(drawn, found.ours[:, NAMES.index("natural frequency")])
