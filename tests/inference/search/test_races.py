"""Why a fit is compared with others, with which, for how long: a case a reason, on sums of squares of two numbers.

What a search would find is made up here; fits, races and restarts are the real ones.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from waves import PATHS, Waves, at, run

from pdssjax import Accuracy
from pdssjax.core import quantity
from pdssjax.inference import EFFORTS, Ending, Evidence, Fit, evidence as evidence_of_fit
from pdssjax.inference.losses.base import AbstractLoss
from pdssjax.inference.losses.huber import Huber
from pdssjax.inference.losses.squares import Squares
from pdssjax.inference.prior import Prior
from pdssjax.inference.search import multistart, races
from pdssjax.inference.search.multistart import best_fit
from pdssjax.inference.search.races import MOST_RESTARTS
from pdssjax.inference.validation import MissedRecord
from pdssjax.study import Parameter

HALVING, THRICE, COMPARING = [(10, 5), (4, 7)], [(30, 5), (12, 7)], [(48, 6), (12, 12)]
BAD, WORSE, NEAR = at(6.0, -5.0), at(8.0, -8.0), at(1.2, 0.9)


class Rig:
    """A study that stands for `problem`; what is asked of searches, races and restarts is noted."""

    def __init__(self, monkeypatch, problem, given, ranked, scattered=(), longer=0, effort=EFFORTS["usual"]):
        self.problem, self.longer, self.messages, self.events, self.losses = problem, longer, [], [], []
        self.effort = effort
        quantity_of = quantity(1.0, "m")  # what is declared matters to no race
        parameters = {path: Parameter(path, "m", quantity_of, start=given.get(path)) for path in PATHS}
        self.study = SimpleNamespace(models=None, parameters=parameters, records=problem.records)
        starts = at(0.0, 0.0) | given
        monkeypatch.setattr(multistart, "guess_starts", lambda *_: (starts, len(given) < 2))
        monkeypatch.setattr(multistart, "pose", lambda *_: problem)
        monkeypatch.setattr(multistart, "warn_of_memory_use", lambda *_: None)
        monkeypatch.setattr(multistart, "is_separable", lambda *_: False)
        monkeypatch.setattr(races, "piezo_alone", lambda *_: {})
        monkeypatch.setattr(races, "rank_starts", self.noted("ranked", ranked))
        monkeypatch.setattr(races, "scatter_starts", self.noted("scattered", scattered))
        monkeypatch.setattr(races, "successive_halving", self.watched("race", races.successive_halving))
        monkeypatch.setattr(races, "restarts", self.watched("restarts", races.restarts))

    first_is_lost = False

    def noted(self, name, found):
        def search(models, parameters, records, *more, **how):
            free = [path for path, parameter in parameters.items() if parameter.start is None]
            self.losses.append(how.pop("loss", None) or more[-1])
            self.events.append((name, free, *[m for m in more if not isinstance(m, AbstractLoss)], *how))
            return list(found)

        return search

    def watched(self, name, real):
        def watched(*arguments):
            self.events.append((name, arguments))
            return real(*arguments)

        return watched

    def fitted(self):
        """The best fit and its starts; fits that are not cut short are said to have taken `longer`."""
        limits = []

        def counted(problem, starts, report, limit=200):
            limits.append(limit)
            fit = run(problem, starts, report, limit)
            more = self.longer if len(limits) == 1 or limit == 200 else 0
            ended = fit.success and not (self.first_is_lost and len(limits) == 1)
            return fit._replace(iterations=fit.iterations + more, evaluations=fit.evaluations + more, success=ended)

        evidence, starts = best_fit(self.study, Accuracy(), counted, self.messages.append, effort=self.effort)  # pyright: ignore
        self.limits = limits
        return evidence.fit, starts

    @property
    def races(self):
        """Of each, the starts it had, its rounds, and whether a perfect fit ends it; one on its way never does."""
        perfect = run(self.problem, at(1.0, 1.0), None)
        assert perfect.ending == Ending.CONVERGED
        of = [arguments for name, *(arguments,) in self.of("race")]
        assert not any(good(perfect._replace(success=False)) for _, _, _, _, _, good, _, _ in of)
        return [(others, [tuple(r) for r in rounds], good(perfect)) for _, _, _, others, rounds, good, _, _ in of]

    def of(self, name):
        return [event for event in self.events if event[0] == name]


def everywhere(count=40):
    """Starts of which the first leads to the lowest minimum."""
    return [NEAR] + [at(*point) for point in np.random.default_rng(1).uniform(-9.0, 9.0, (count, 2))]


def test_a_fit_that_explains_its_records_is_compared_with_none(monkeypatch):
    rig = Rig(monkeypatch, Waves(1.0, 0.0), BAD, everywhere())
    fit, starts = rig.fitted()
    assert fit.chi2 < 1e-12 and starts == BAD and rig.events == [] and rig.limits == [200]


def test_a_poor_fit_is_compared_with_what_else_the_search_found_until_one_is_good(monkeypatch):
    rig = Rig(monkeypatch, Waves(4.0, 2.0, platform_alone=True), {}, [BAD, *everywhere()])
    fit, starts = rig.fitted()
    assert rig.races == [(everywhere(), HALVING, True)]
    # What the platform shows is reported with the start from before its own fit.
    assert fit.chi2 < 1e-12 and starts in [begun | {"piezo.gain": 0.0} for begun in everywhere()[:10]]
    assert rig.limits[:15] == [12, *[5] * 10, *[7] * 4]
    assert "searching for starts" in rig.messages and "going on from the best of the other starts" in rig.messages


def test_a_poor_fit_from_starts_given_is_compared_with_a_search_without_them_then_with_scattered_ones(monkeypatch):
    rig = Rig(monkeypatch, Waves(4.0, 2.0), BAD, [WORSE], everywhere())
    fit, starts = rig.fitted()
    first, second = rig.races
    assert first == ([WORSE], HALVING, True) and second == ([*everywhere()[:16], *everywhere()[:32]], COMPARING, False)
    # The first search may not use the starts given, but for the platform's; nothing shows that alone here.
    assert rig.of("ranked") == [("ranked", ["friction.f_c"], {}, 1.0)]
    assert rig.losses and all(loss is rig.problem.residual.loss for loss in rig.losses)
    (_, _, around, held), (_, _, beside, kept, how) = rig.of("scattered")
    assert held == [] and set(around) == set(PATHS)
    # Those that go first have the stack as the study gives it.
    assert kept == ["piezo.gain"] and beside["piezo.gain"] == BAD["piezo.gain"] and how == "to_sticking"
    assert fit.chi2 < 1e-12 and starts in everywhere()
    (restarted,) = rig.of("restarts")
    assert restarted[1][3] == 2 * MOST_RESTARTS
    wanted = [
        "searching for starts that differ in every parameter",
        "searching for starts with the stack as the study gives it",
        "restarting the best from perturbed points",
    ]
    assert [message for message in rig.messages if message in wanted] == wanted


def test_a_good_fit_after_a_race_from_starts_given_is_compared_no_more(monkeypatch):
    rig = Rig(monkeypatch, Waves(4.0, 2.0), BAD, [NEAR], everywhere())
    fit, starts = rig.fitted()
    assert rig.races == [([NEAR], HALVING, True)]
    # What the platform shows is reported with the start that the study gave it.
    assert fit.chi2 < 1e-12 and starts == NEAR | {"piezo.gain": BAD["piezo.gain"]}


def test_a_fit_without_a_platform_record_is_compared_with_thrice_as_many_however_good_it_is(monkeypatch):
    rig = Rig(monkeypatch, Waves(1.0, 0.0), {"friction.f_c": 2.0}, [NEAR, *everywhere()])
    fit, starts = rig.fitted()
    assert rig.races == [(everywhere(), THRICE, False)]
    assert fit.chi2 < 1e-12
    assert rig.limits[:43] == [12, *[5] * 30, *[7] * 12]
    assert starts in [NEAR, *everywhere()]  # the piezo's too were searched for


def test_where_the_platform_is_seen_alone_a_good_fit_is_enough_and_its_start_is_from_before(monkeypatch):
    rig = Rig(monkeypatch, Waves(1.0, 0.0, platform_alone=True), {"friction.f_c": 2.0}, [NEAR, *everywhere()])
    fit, starts = rig.fitted()
    assert rig.races == [] and fit.chi2 < 1e-12
    assert starts == NEAR | {"piezo.gain": 0.0}


class Noisy(Waves):
    """Among samples of which most are noise; what is left at a bound of one parameter is not poor, but seen."""

    def __init__(self, bound, **more):
        super().__init__(1.0, 0.0, **more)
        self.bounds = np.full(2, -10.0), np.array([10.0, bound])
        self.records[0].time, self.records[0].measured = np.arange(64.0), np.zeros(64)
        self.white = np.random.default_rng(0).normal(size=60)

    def whitened(self, free):
        return np.append(8.0 * super().whitened(free), self.white)


def test_a_fit_that_ran_into_a_bound_is_compared_with_starts_that_differ_in_every_parameter(monkeypatch):
    problem = Noisy(0.5)
    rig = Rig(monkeypatch, problem, at(0.0, 0.0), [WORSE], [at(-3.0, 0.4)])
    fit, _ = rig.fitted()
    assert fit.free[1] == pytest.approx(0.5)
    assert rig.races == [(2 * [at(-3.0, 0.4)], COMPARING, False)]
    assert len(rig.of("restarts")) == 1


def test_what_was_measured_apart_is_held_where_the_fit_put_it_when_others_are_scattered(monkeypatch):
    problem = Waves(1.0, 0.0)
    apart = Prior(("friction.f_c",), np.array([3.0]), np.array([[10.0]]))
    told = SimpleNamespace(prior=apart, transform=SimpleNamespace(paths=PATHS), loss=Squares())
    monkeypatch.setattr(problem, "residual", told)
    monkeypatch.setattr(
        races, "scatter_starts", lambda models, parameters, records, around, held, loss: [(around, held)]
    )
    study = SimpleNamespace(models=None, parameters={}, records=())
    contest = races.RaceContext(study, problem, [], False, run, lambda message: None)
    ((around, held),) = races._scattered(SimpleNamespace(free=np.array([2.0, 3.01])), at(5.0, 5.0), contest)
    assert held == ["friction.f_c"] and around == at(5.0, 3.01)


def test_what_the_platform_shows_is_held_where_the_fit_put_it_when_others_are_scattered(monkeypatch):
    problem = Noisy(0.5, platform_alone=True)
    rig = Rig(monkeypatch, problem, at(0.0, 0.0), [WORSE], [])
    _, starts = rig.fitted()
    ((_, _, around, held),) = rig.of("scattered")
    assert held == ["piezo.gain"] and around["piezo.gain"] == pytest.approx(1.0, abs=1e-6)
    assert around["friction.f_c"] == 0.0
    # None was found: nothing is raced, and nothing restarted.
    assert rig.races == [] and rig.of("restarts") == [] and starts == at(0.0, 0.0)


@pytest.mark.parametrize("longer, races", [(40, 0), (60, 1)])
def test_a_fit_that_took_a_long_way_is_compared_with_all_else_that_the_search_found(monkeypatch, longer, races):
    rig = Rig(monkeypatch, Waves(1.0, 0.0, platform_alone=True), {}, [NEAR, *everywhere()], longer=longer)
    fit, starts = rig.fitted()
    assert rig.races == [(everywhere(), HALVING, False)] * races
    assert fit.chi2 < 1e-12 and starts["piezo.gain"] == 0.0
    assert ("that was a long way: comparing with other starts" in rig.messages) == bool(races)
    assert rig.of("restarts") == [] and rig.of("scattered") == []


def test_a_long_way_after_a_race_is_no_reason_for_another(monkeypatch):
    rig = Rig(monkeypatch, Waves(4.0, 2.0, platform_alone=True), {}, [BAD, *everywhere()], longer=100)
    fit, _ = rig.fitted()
    assert fit.iterations > 100 and rig.races == [(everywhere(), HALVING, True)]


def test_a_long_way_from_starts_given_has_nothing_to_be_compared_with(monkeypatch):
    rig = Rig(monkeypatch, Waves(1.0, 0.0), BAD, [WORSE], longer=100)
    fit, starts = rig.fitted()
    assert rig.events == [] and starts == BAD and fit.iterations > 100


def test_a_long_way_from_starts_given_that_leads_to_no_end_is_compared_with_a_search_without_them(monkeypatch):
    rig = Rig(monkeypatch, Waves(1.0, 0.0), BAD, everywhere(), longer=100)
    rig.first_is_lost = True
    fit, starts = rig.fitted()
    # What the platform shows is reported with the start that was given.
    assert fit.success and starts in [begun | {"piezo.gain": BAD["piezo.gain"]} for begun in everywhere()]
    assert rig.races == [(everywhere(), HALVING, False)]
    assert "that was a long way: comparing with other starts" in rig.messages


def reason_in_the_end(problem, fit, starts, raced):
    contest = races.RaceContext(SimpleNamespace(parameters={}, records=()), problem, [], False, run, None)
    return races.reason_in_the_end(fit, starts, contest, raced)


@pytest.mark.parametrize(
    "raced, poor, reason",
    [
        (False, True, None),  # before any race a bound alone counts
        (True, True, "elsewhere"),
        (True, False, None),
    ],
)
def test_a_fit_that_a_race_left_poor_may_lie_elsewhere(raced, poor, reason):
    problem = Waves(4.0, 2.0)
    fit = run(problem, BAD if poor else at(1.0, 1.0), None)
    assert Evidence(problem, fit).is_poor is poor
    assert reason_in_the_end(problem, fit, BAD, raced) == reason


@pytest.mark.parametrize(("bound", "reason"), [(0.5, "elsewhere"), (0.9, None)], ids=["seen", "within the noise"])
def test_a_bound_that_a_fit_ran_into_hides_what_lies_beyond_where_it_leaves_more_than_noise(bound, reason):
    problem = Noisy(bound)
    fit = run(problem, at(0.0, 0.0), None)
    assert fit.free[1] == bound and not Evidence(problem, fit).is_poor
    assert reason_in_the_end(problem, fit, at(0.0, 0.0), False) == reason
    assert reason_in_the_end(problem, fit, at(0.0, bound), False) is None


def test_residuals_are_poor_by_size_by_neighbours_and_by_what_repeats():
    problem, random = Waves(1.0, 0.0), np.random.default_rng(2)
    (record,) = problem.records
    time = np.arange(0.0, 1.0, 1e-3)
    drive = SimpleNamespace(cycle_frequency=lambda: 10.0)
    fit = run(problem, at(1.0, 1.0), None)

    def poor(residual, noise=1.0):
        made = {"time": time, "measured": residual, "noise": noise, "drive": drive}
        problem.records = (SimpleNamespace(**vars(record) | made),)
        return Evidence(problem, fit._replace(state=SimpleNamespace(residual=residual))).leaves_more_than_noise

    white = random.normal(size=time.size)
    assert not poor(white)
    assert not poor(1.2 * white, None)  # the guess was too low: it is as large everywhere
    assert poor(1.2 * white)  # four standard deviations of chi-square where it is known
    # As large in all, neighbours alike: coloured noise, unless it lies at one place.
    alike = 0.98 * np.convolve(white, [0.7, 0.7], "same")
    swelling = np.exp(-(((time - 0.6) / 0.2) ** 2))
    for noise in (1.0, None):
        assert not poor(alike, noise)
        assert poor(alike * swelling / np.sqrt(np.mean(swelling**2)), noise)
    assert poor(1.4 * np.sin(3.0 * np.pi * time))  # alike for as long as the record
    phases = np.tile(random.normal(size=100), 10)
    assert poor(0.9 * white + 0.4 * phases)  # as large, alike in every cycle


def with_glitches(loss, wrong):
    """Two slopes of a line, 1000 samples, 40 glitches; fitted by least squares, or with a misfit beside.

    The fit that glitches pull leaves twice the noise of all other samples.
    """
    problem, random, time = Waves(1.0, 0.0), np.random.default_rng(2), np.arange(0.0, 1.0, 1e-3)
    problem.residual.loss = loss
    measured = random.normal(size=1000) + wrong * np.sin(40.0 * time)
    measured[random.choice(1000, 40, replace=False)] += random.normal(100.0, 300.0, 40)
    given = {"time": time, "measured": measured, "noise": 1.0}
    problem.records = (SimpleNamespace(**vars(problem.records[0]) | given),)
    jacobian = -np.stack([np.ones(1000), time], 1)
    free = -np.linalg.lstsq(jacobian, measured)[0] if isinstance(loss, Squares) else np.zeros(2)
    state = SimpleNamespace(residual=np.asarray(loss.root(measured + jacobian @ free)), jacobian=jacobian)
    return problem, run(Waves(1.0, 0.0), at(1.0, 1.0), None)._replace(free=free, state=state)


@pytest.mark.parametrize("loss", [Squares(), Huber()])
def test_neither_glitches_nor_what_they_pull_a_fit_off_by_make_it_poor(loss):
    problem, fit = with_glitches(loss, 0.0)
    if isinstance(loss, Squares):
        assert np.median(np.abs(fit.state.residual)) > 2.0
    assert not Evidence(problem, fit).leaves_more_than_noise
    assert Evidence(*with_glitches(loss, 1.0)).leaves_more_than_noise


def test_a_slip_at_another_time_makes_a_fit_poor_however_few_its_samples():
    """One that the measurement does not show as a spike is no glitch."""
    problem, fit = with_glitches(Squares(), 0.0)
    (record,) = problem.records
    walked = np.random.default_rng(2).normal(size=1000) - 200.0 * (record.time > 0.5)
    problem.records = (SimpleNamespace(**vars(record) | {"measured": walked}),)
    fit.state.residual = walked + 200.0 * (record.time > 0.503)
    assert Evidence(problem, fit).leaves_more_than_noise


class Lines(Waves):
    """Two records of a straight line each, with 400 samples and noise of 1; the second as if its slope were other."""

    def __init__(self, other: float):
        super().__init__(1.0, 0.0)
        time, random = np.linspace(0.0, 1.0, 400), np.random.default_rng(4)
        given, self.noise = vars(self.records[0]) | {"time": time, "noise": None}, np.ones(2)
        self.jacobian = np.stack([np.ones(800), np.tile(time, 2)], axis=1)
        parts = {"first": random.normal(size=400), "second": other * time + random.normal(size=400)}
        self.records = tuple(SimpleNamespace(**given | {"name": n, "measured": part}) for n, part in parts.items())
        self.measured = np.concatenate([*parts.values()])

    rows, rows_apart = [slice(0, 400), slice(400, 800)], slice(800, 800)

    def fitted(self):
        free, *_ = np.linalg.lstsq(self.jacobian, self.measured)
        state = SimpleNamespace(residual=self.jacobian @ free - self.measured, jacobian=self.jacobian)
        return Fit(free, state, True, "", 1, 1, Ending.CONVERGED)  # pyright: ignore


@pytest.mark.parametrize("other, poor", [(0.0, False), (0.25, False), (1.0, True)])
def test_records_that_contradict_each_other_make_a_fit_poor_although_it_leaves_no_more_than_noise(other, poor):
    problem = Lines(other)
    fit = problem.fitted()
    assert not Evidence(problem, fit).leaves_more_than_noise
    assert Evidence(problem, fit).is_poor is poor
    assert reason_in_the_end(problem, fit, at(*fit.free), True) == ("elsewhere" if poor else None)


@pytest.mark.parametrize(
    ("unknown", "excused", "reason"),
    [
        ((), None, "poor"),
        (("piezo.gain@wet",), None, None),  # a number of its own may be all that is wrong
        ((), lambda fit, problem: True, None),
    ],
)
def test_a_fit_that_misses_a_record_that_was_not_fitted_is_compared_with_others(monkeypatch, unknown, excused, reason):
    problem = Waves(1.0, 0.0)
    fit = run(problem, at(0.0, 0.0), None)
    assert not Evidence(problem, fit).is_poor
    validation = SimpleNamespace(**vars(problem.records[0]) | {"name": "validation", "role": "validate"})
    study = SimpleNamespace(parameters={}, records=(*problem.records, validation))
    asked = []

    def missed(study, problem, free, covariance):
        asked.append(covariance)
        return (MissedRecord(validation, unknown),)

    monkeypatch.setattr(evidence_of_fit, "missed_records", missed)
    contest = races.RaceContext(study, problem, [], False, run, None, excused)
    assert races.reason_at_first(fit, contest) == reason
    # Residuals are 1.7 times the distance from (1, 1).
    np.testing.assert_allclose(asked, [np.eye(2) / 1.7**2][: len(asked)])
    assert bool(asked) == (excused is None)


@pytest.mark.parametrize(("effort", "tried"), [("quick", 12), ("usual", 48)])
def test_effort_says_how_many_starts_a_poor_fit_is_compared_with(monkeypatch, effort, tried):
    rig = Rig(monkeypatch, Waves(4.0, 2.0), BAD, [WORSE], everywhere(), effort=EFFORTS[effort])
    rig.fitted()
    assert rig.races[-1][1] == [(tried, 6), (tried // 4, 12)] and len(rig.races[-1][0]) == tried
    assert rig.of("restarts")[-1][1][3] == EFFORTS[effort].some(2 * MOST_RESTARTS)


def test_once_the_evaluations_are_spent_the_best_so_far_is_brought_to_its_end_and_told(monkeypatch):
    scarce = EFFORTS["usual"]._replace(evaluations=30)
    rig = Rig(monkeypatch, Waves(4.0, 2.0), BAD, [WORSE], everywhere(), effort=scarce)
    fit, _ = rig.fitted()
    whole = run(rig.problem, BAD, None)
    assert fit.ending != Ending.RUNNING and fit.chi2 <= whole.chi2
    assert "no other start was fitted" in fit.message and '"thorough" goes on' in fit.message
    assert rig.limits.count(1) > 10
