"""The first root of a guard in a step is found to rounding: simple, double, hidden between samples, at either end.

The referee is `numpy.polynomial`: guards are made of their roots, or their roots are found by its companion matrix.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from marks import slow
from numpy.polynomial import polynomial as poly

from pdssjax.integration.event_location import first_crossing
from pdssjax.integration.taylor_series import polynomial

MOST_STEPS = 3
"""That may end before an event until it is located."""
SIZE = 17
"""Coefficients of a guard: those of a step of order 16."""
LENGTH = 1e-4
"""Of a step [s]."""


@jax.jit
def located(coefficients):
    """(part of the step, event, which) for guards of shape (guards, SIZE) in the part of a step."""
    guards = tuple(polynomial(list(c / LENGTH ** jnp.arange(SIZE))) for c in coefficients)
    time, event, which = first_crossing(guards, SIZE, jnp.asarray(LENGTH))
    return time / LENGTH, event, which


def padded(*guards) -> np.ndarray:
    return np.stack([np.pad(np.asarray(g, float), (0, SIZE - len(g))) for g in guards])


def where(guard, most_steps=MOST_STEPS) -> float:
    """Where a guard crosses zero first; where it is nearly flat a step ends before, and the next one begins there."""
    begin = 0.0
    for _ in range(most_steps):
        part, event, _ = located(padded(guard, [1.0]))
        if event or part == 1.0:
            return begin + float(part) * (1.0 - begin)
        rest = poly.Polynomial(guard)(poly.Polynomial([float(part), 1.0 - float(part)]))
        guard, begin = rest.coef, begin + float(part) * (1.0 - begin)
    return np.nan


def root(*roots: complex, scale: float = 1.0) -> float:
    """Where the guard with these roots, positive at first, is found to cross zero."""
    guard = np.real(poly.polyfromroots(roots))
    positive = guard[0] if guard[0] != 0.0 else poly.polyval(1e-6, guard)
    return where(guard * np.sign(positive) * scale)


@pytest.mark.parametrize("scale", [1.0, 1e-14])
@pytest.mark.parametrize("at", [1e-7, 0.01, 0.3, 1 / 3, 0.5, 0.99, 1.0 - 1e-12])
def test_a_simple_root(at, scale):
    assert root(at, scale=scale) == pytest.approx(at, rel=1e-13, abs=1e-15)


@pytest.mark.parametrize("depth", [1e-1, 1e-2, 1e-3, 1e-4, 1e-6])
@pytest.mark.parametrize("at", [0.02, 0.21, 0.4, 0.75, 0.9])
def test_a_dip_below_zero_between_two_samples(at, depth):
    found = root(at, at + 0.09 * depth)
    assert found == pytest.approx(at, abs=1e-15 / (0.09 * depth))


def test_the_dip_is_found_before_the_crossing_that_follows():
    assert root(0.41, 0.43, 0.8) == pytest.approx(0.41, abs=1e-13)


def test_a_guard_that_only_comes_near_does_not_cross():
    for near in (1e-3, 1e-5):
        assert root(0.4 + near * 1j, 0.4 - near * 1j) == 1.0


def test_a_guard_that_touches_zero_crosses_there_or_not_at_all():
    found = root(0.4, 0.4)
    assert found == 1.0 or found == pytest.approx(0.4, abs=1e-7)


def test_a_guard_that_is_nearly_flat_where_it_crosses():
    """A factor of 5e-4 at the root and of 1 elsewhere: the secant of the bracket says nothing of the slope."""
    for at in (0.25, 0.31, 0.62):
        pair = (at + 0.02 + 0.01j, at + 0.02 - 0.01j)
        assert root(at, *pair) == pytest.approx(at, abs=1e-12)


def test_guards_that_begin_near_zero_without_a_slope():
    # Of these the first is a bond's at a corner of the voltage, located 5 ns late before.
    random = np.random.default_rng(5)
    guards = [[1.81765341e-8, 1.47650583e-8, -2.80537732e-2, 5.01737279e-3, 5.99115455e-3, -9.87184067e-4]]
    for _ in range(200):
        guard = random.normal(size=9) * 0.5 ** np.arange(9)
        guard[:2] = 10.0 ** random.uniform(-8.0, -3.0), 10.0 ** random.uniform(-12.0, -4.0) * random.choice([-1.0, 1.0])
        guards.append([*guard[:2], -abs(guard[2]) - 1e-2, *guard[3:]])
    crossed = 0
    for guard in guards:
        roots = poly.polyroots(guard)
        real = roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0.0) & (roots.real < 1.0)]
        if real.size and real.min() < 0.1:
            slope = abs(poly.polyval(real.min(), poly.polyder(guard)))
            assert where(guard, 8) == pytest.approx(real.min(), abs=1e-14 * np.abs(guard).sum() / slope)
            crossed += 1
    assert crossed > 150


def test_the_end_of_the_step_is_no_crossing():
    assert root(1.0) == pytest.approx(1.0, abs=2e-15)
    assert root(1.0 + 1e-9) == 1.0


def test_a_root_at_the_start_is_that_of_the_event_before():
    assert root(0.0, 0.6) == pytest.approx(0.6, abs=1e-13)
    assert root(0.0, 0.03) == pytest.approx(0.03, abs=1e-13)
    assert root(0.0) == 1.0


@pytest.mark.parametrize("noise", [0.0, -1e-16, -1e-13])
def test_rounding_at_the_start_is_no_fall(noise):
    # A step of a tenth of a millisecond: within a nanosecond, 1e-5 of it, what is left rises above zero.
    assert where([0.0, noise, 1.0, 0.0, -4.0]) == pytest.approx(0.5, abs=1e-12)
    assert where([0.0, 1e-2 * noise, -1e-13, 1.0, 0.0, -4.0]) == pytest.approx(0.5, abs=1e-12)
    assert where([0.0, -1e-4, 0.0, -1.0]) == 0.0


@pytest.mark.parametrize("rounding", [-1e-26, 0.0, 1e-26])
def test_a_guard_that_begins_with_rounding_and_falls_does_so_at_once(rounding):
    # A stop's at rest on it: what it falls by sets in with the fourth power of the time.
    part, event, _ = located(padded([0.0, rounding, 0.0, rounding, -1.8e-10, -1.4e-11], [1.0]))
    assert event and part == 0.0
    part, event, _ = located(padded([rounding, 0.0, 0.0, rounding, -1.8e-10, -1.4e-11], [1.0]))
    assert event and part == 0.0
    # One that bends down, and rises before by rounding: for so short a time that it comes to nothing.
    for rise in (1e-13, 1e-10, 1e-8):
        part, event, _ = located(padded([abs(rounding), rise, -1.0], [1.0]))
        assert event and part == (0.0 if rounding else pytest.approx(rise, rel=1e-6))


@pytest.mark.parametrize("begin", [0.0, 1e-20, 1e-16])
def test_a_guard_that_begins_with_rounding_and_rises_falls_later(begin):
    # A ball just thrown up from where it was found to land, and what leaves with no speed; deep at the first sample.
    assert where([begin, 0.04, -1.0]) == pytest.approx(0.04, abs=1e-12)
    assert where([begin, -1e-20, 0.04, -1.0]) == pytest.approx(0.04, abs=1e-12)
    assert where([begin, 1e-20, 0.04, -1.0]) == pytest.approx(0.04, abs=1e-12)


def test_which_guard_crosses_first():
    part, _, which = located(padded([0.7, -1.0], [1.0]))
    assert (float(which), float(part)) == (0.0, pytest.approx(0.7, abs=1e-14))
    part, _, which = located(padded([0.7, -1.0], [0.2, -1.0]))
    assert (float(which), float(part)) == (1.0, pytest.approx(0.2, abs=1e-14))


@pytest.mark.parametrize("begin", [None, slow(-1e-18), 0.0, slow(1e-18), slow(1e-16)])
def test_guards_drawn_at_random_against_the_companion_matrix(begin):
    """Oscillations that die out or grow, as a guard's are in a step: the first descending root, if any.

    Well above zero at first, or beginning there but for rounding, as it does after an event, and rising.
    """
    random = np.random.default_rng(0)
    missed = 0
    for _ in range(2000):
        rates = random.uniform(-4.0, 1.0, 2) + 1j * random.uniform(0.0, 5.0, 2)
        sizes = random.normal(size=2) * np.exp(1j * random.uniform(0.0, 2.0 * np.pi, 2))
        orders = np.arange(SIZE)
        factorial = np.cumprod(np.maximum(orders, 1.0))
        guard = sum(np.real(a * r**orders) for a, r in zip(sizes, rates, strict=True)) / factorial
        if begin is None:
            guard[0] = abs(guard[0]) + 1e-3
        else:
            guard[:2] = begin, abs(guard[1]) + 1e-2
        roots = poly.polyroots(guard)
        real = np.sort(roots[np.abs(roots.imag) < 1e-9].real)
        inside = real[(real > 1e-10) & (real < 1.0)]
        expected = inside[0] if inside.size else 1.0
        missed += not abs(where(guard) - expected) <= 1e-9
    assert missed == 0
