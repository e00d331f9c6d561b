"""What walks leave because the stack was misread is told from what a wrong law leaves; on a linear model."""

from types import SimpleNamespace

import numpy as np
import pytest

from pdssjax.inference import Ending, Evidence, Fit
from pdssjax.inference.losses.squares import Squares
from pdssjax.inference.prior import Prior
from pdssjax.inference.search import races
from pdssjax.inference.stack_first import held_stack
from pdssjax.inference.stack_first.peak_picking import PATHS

TIME = np.arange(0.0, 1.0, 1e-3)
ERRORS = np.array([1e-3, 5e-3, 5e-3])


class Namespace(SimpleNamespace):
    def _replace(self, **changed):
        return Namespace(**vars(self) | changed)


def held(misread, law):
    """A fit of a step, and of a walk with the stack `misread` by so many standard errors and so much of a law lacking.

    Without the stack free the walk has fitted its friction, the fourth parameter, as well as it can.
    """
    random = np.random.default_rng(3)
    shapes = np.stack([TIME, np.sin(9.0 * TIME), np.sin(14.0 * TIME), np.cos(9.0 * TIME)], axis=1)
    jacobian = np.vstack([shapes * [1e3, 1e3, 1e3, 0.0], shapes * 1e3])
    left = 1e3 * shapes[:, :3] @ (misread * ERRORS) + law * np.sin(25.0 * TIME) + random.normal(size=TIME.size)
    friction = np.linalg.lstsq(shapes[:, 3:], left)[0]
    left = left - shapes[:, 3:] @ friction
    step = 1e3 * shapes[:, :3] @ (misread * ERRORS) + random.normal(size=TIME.size)

    def record(name, alone):
        shows = SimpleNamespace(platform_alone=alone, effector_moves=not alone)
        given = dict(time=TIME, measured=np.zeros(TIME.size), noise=1.0, offset=0.0, drive=None, measures=name)
        return SimpleNamespace(name=name, measurement=shows, conditions=frozenset(), **given)

    records = record("platform", True), record("effector", False)
    paths = (*PATHS, "friction.f_c")
    transform = SimpleNamespace(
        paths=paths,
        at_bound=lambda free: np.zeros(free.size, bool),
        among=lambda those: np.array([path in those for path in paths]),
    )
    residual = SimpleNamespace(transform=transform, loss=Squares(), prior=Prior(), fixed={})
    rows = [slice(0, TIME.size), slice(TIME.size, 2 * TIME.size)]
    problem = Namespace(records=records, noise=np.ones(2), residual=residual, rows=rows, rows_apart=slice(0, 0))
    problem.decode = lambda free: dict(zip(paths, free, strict=True))
    state = Namespace(residual=np.append(step, left), jacobian=jacobian)
    fit = Fit(np.zeros(4), state, True, "", 1, 1, Ending.CONVERGED)  # pyright: ignore
    return fit, problem


STACK = SimpleNamespace(prior=Prior.of_covariance(PATHS, np.zeros(3), np.diag(ERRORS**2)))


WITH_STACK_FREED = held_stack.with_stack_freed


def freed(fit, problem):
    evidence = WITH_STACK_FREED(fit, problem, STACK)  # pyright: ignore
    evidence.problem.rows = [slice(0, TIME.size)]  # pyright: ignore
    return evidence


@pytest.mark.parametrize(
    "misread, law, poor",
    [(0.0, 0.0, False), (1.5, 0.0, False), (-1.5, 0.0, False), (30.0, 0.0, True), (1.5, 3.0, True)],
    ids=["right", "misread", "the other way", "beyond its errors", "and a wrong law"],
)
def test_what_a_misread_stack_leaves_of_walks_is_no_fault_of_the_law(misread, law, poor):
    fit, problem = held(misread, law)
    assert Evidence(problem, fit).leaves_more_than_noise is (misread != 0.0 or law != 0.0)
    assert freed(fit, problem).leaves_more_than_noise is poor


@pytest.mark.parametrize("law, reason", [(0.0, None), (3.0, "poor")], ids=["misread", "wrong law"])
def test_other_optima_are_not_looked_for_where_the_stack_explains_what_is_left(monkeypatch, law, reason):
    fit, problem = held(1.5, law)
    monkeypatch.setattr(held_stack, "point_of_whole_study", lambda study, point, *_: point)
    monkeypatch.setattr(held_stack, "with_stack_freed", lambda fit, problem, stack: freed(fit, problem))
    excused = lambda fit, problem: held_stack.due_to_stack(None, STACK, None, fit, problem)  # pyright: ignore
    contest = lambda excused: races.RaceContext(
        SimpleNamespace(parameters={}, records=()), problem, [], False, None, None, excused
    )
    assert races.reason_at_first(fit, contest(None)) == "poor"
    assert races.reason_at_first(fit, contest(excused)) == reason
