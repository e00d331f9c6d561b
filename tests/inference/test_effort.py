"""What a user's effort changes of a fit: starts, evaluations, and the slow steps after which it ends."""

import pytest
from waves import Waves, at, run

from pdssjax import InputError
from pdssjax.inference.effort import EFFORTS, USUAL, effort_of
from pdssjax.inference.least_squares import _slow_message
from pdssjax.inference.search.multistart import Budget


def test_an_unknown_effort_is_refused_with_the_nearest():
    with pytest.raises(InputError, match='effort: found "thoroug"; did you mean "thorough"'):
        effort_of("thoroug")


def test_more_effort_tries_more_starts_evaluations_and_slow_steps():
    quick, usual, thorough = (EFFORTS[name] for name in ("quick", "usual", "thorough"))
    assert [effort.some(48) for effort in (quick, usual, thorough)] == [12, 48, 96] and quick.some(1) == 1
    for less, more in ((quick, usual), (usual, thorough)):
        assert less.evaluations < more.evaluations and less.iterations < more.iterations
        assert less.slow_steps < more.slow_steps and less.slow_gain > more.slow_gain


def test_a_slow_end_says_what_the_last_steps_gained_and_what_goes_on():
    course = [(2 * k, 480.0 + 0.01 * (30 - k)) for k in range(31)]
    said = _slow_message(USUAL, course)
    assert "the last 24 evaluations gained 0.12" in said and '"thorough" goes on' in said
    assert "goes on" not in _slow_message(EFFORTS["thorough"], course)
    assert "the last 0 evaluations" in _slow_message(USUAL, course[:1])


def test_once_the_evaluations_are_spent_a_run_takes_a_single_step():
    limits, problem = [], Waves(1.0, 0.0)

    def noted(problem, starts, report, limit=200):
        limits.append(limit)
        return run(problem, starts, report, limit)

    budget = Budget(USUAL._replace(evaluations=1))
    counted = budget.counted(noted)
    first = counted(problem, at(0.0, 0.0), None, 7)
    counted(problem, at(0.5, 0.5), None)
    assert limits == [7, 1] and budget.refused == 1 and budget.spent == first.evaluations
