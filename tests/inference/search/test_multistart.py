"""Races of starts and restarts leave wrong minima: on sums of squares of a few numbers, fitted by SciPy."""

from types import SimpleNamespace

from waves import Waves, at, run

from pdssjax.inference import Ending, Fit
from pdssjax.inference.search.races import MOST_RESTARTS, PATIENCE, beyond_discontinuity, restarts, successive_halving


def told(messages):
    return lambda message: messages.append(message)


def test_the_best_of_many_starts_goes_on_and_all_evaluations_are_counted():
    problem, messages, limits = Waves(4.0, 2.0), [], []

    def watched(problem, starts, report, limit=200):
        limits.append(limit)
        return run(problem, starts, report, limit)

    first = run(problem, at(6.0, -5.0), None)
    assert first.chi2 > 1.0
    others = [at(a, b) for a in (-4.0, 1.3, 5.0) for b in (-6.0, 0.9, 4.0)]
    never = lambda fit: False
    best, begun = successive_halving(
        first, problem, at(6.0, -5.0), others, [(9, 2), (4, 3)], never, watched, told(messages)
    )
    assert best.chi2 < 1e-12
    assert begun in others
    assert limits[:13] == [2] * 9 + [3] * 4
    assert best.evaluations > first.evaluations + sum(limits[:13]) / 2
    assert messages[0] == "trying others: start 1 of 9, 2 iterations each"


def test_what_is_good_enough_is_not_bettered_and_patience_ends():
    problem, calls = Waves(4.0, 2.0), []

    def watched(problem, starts, report, limit=200):
        calls.append(limit)
        return run(problem, starts, report, limit)

    best = run(problem, at(1.0, 1.0), None)
    others = [at(a, a) for a in (-6.0, -3.0, 4.0, 7.0, 8.0)]
    same, begun = successive_halving(best, problem, at(1.0, 1.0), others, [(5, 2)], lambda fit: True, watched, print)
    assert calls == [2] * 5 and begun == at(1.0, 1.0) and same.chi2 == best.chi2
    calls.clear()
    same, _ = successive_halving(best, problem, at(1.0, 1.0), others, [(5, 2)], lambda fit: False, watched, print)
    assert calls == [2] * 5 + [200] * PATIENCE and same.chi2 == best.chi2


def test_restarts_go_from_valley_to_valley():
    problem = Waves(60.0, 0.3)  # minima every 0.1
    first = run(problem, at(1.5, 0.6), None)
    assert first.chi2 > 0.1
    far = Fit(*first[:4], first.iterations, first.evaluations, Ending.DISCONTINUITY)
    # Chi-square here is below one: what counts as another result is measured in units of noise.
    scaled = SimpleNamespace(**{name: getattr(problem, name) for name in ("bounds", "encode", "decode", "residual")})
    scaled.whitened = lambda free: 30.0 * problem.whitened(free)
    start = run(scaled, problem.decode(far.free), None)
    best = restarts(start, scaled, run, 2 * MOST_RESTARTS)
    assert best.chi2 < 0.5 * start.chi2
    assert best.evaluations > start.evaluations
    # Nothing to leave where every step was accepted, and the end is an ordinary one.
    assert beyond_discontinuity(start, scaled, run, print) is start
    # However many evaluations went into the fits that it was compared with.
    raced = start._replace(evaluations=100 * start.evaluations)
    assert beyond_discontinuity(raced, scaled, run, print) is raced
    for ending in (Ending.DISCONTINUITY, Ending.SMALL_JUMP):
        messages = []
        beyond_discontinuity(start._replace(ending=ending), scaled, run, told(messages))
        assert messages
