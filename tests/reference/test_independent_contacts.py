"""Every law's force along a prescribed motion whose speed and direction change, as its equations alone have it."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pdssjax import Accuracy, Taylor
from pdssjax.core import member
from pdssjax.simulation import FRICTION_FORCE, PrescribedMotion, sensor_samples
from tests.reference.test_independent_laws import LAWS

LEGS = 30, 60
"""Of the cases by default, and of the slow ones."""
PARTS = (0.02, 0.3, 0.95)
"""Of a leg, where the force is looked at."""
ASIDE = ("bristle",)
"""Its bonds are drawn otherwise."""
QUICK = ("elastoplastic",)
"""It alone was wrong where the speed falls while it slides: by 1.5 % of the force."""
CASES = [
    pytest.param(case, marks=() if case in QUICK else pytest.mark.slow)
    for case, (name, _) in LAWS.items()
    if name not in ASIDE
]
ROUNDED = {"stribeck, tustin": 3e-6}
"""Tolerance [N] of a law that the package has with a rounded tip."""


@eqx.filter_jit
def shown(law, times, motion, seen, accuracy):
    return sensor_samples(PrescribedMotion(law, times, motion), seen, accuracy, FRICTION_FORCE)


def zigzag(seed, legs):
    """Times [s] and places [m] of legs that are slow and fast, short and long; two of three go on as before."""
    random = np.random.default_rng(seed)
    speeds = np.exp(random.uniform(np.log(3e-5), np.log(5e-3), legs))
    ways = np.cumprod(np.where(random.random(legs) < 1 / 3, -1.0, 1.0))
    paths = np.exp(random.uniform(np.log(3e-8), np.log(3e-6), legs))
    return np.append(0.0, np.cumsum(paths / speeds)), np.append(0.0, np.cumsum(ways * paths))


def expected(law, times, motion):
    """The force at the PARTS of every leg [N], piece by piece up to where the law changes its form."""
    z, form, last, forces = np.zeros(len(law.atol)), law.born(), 0, []
    for begin, end, place, v in zip(times[:-1], times[1:], motion[:-1], np.diff(motion) / np.diff(times), strict=True):
        way, now = int(np.sign(v)), begin
        at = lambda t, place=place, v=v, begin=begin: place + v * (t - begin)
        form, last = law.turned(z, form, place, way) if way != last else form, way
        for stop in [*(begin + (end - begin) * np.array(PARTS)), end]:
            while now < stop:
                # What a jump of the speed leaves no room for is over.
                for which, left in enumerate(law.room(z, form, at(now), v, way)):
                    form = law.next(z, form, at(now), way, which) if left < 0.0 else form
                rates = lambda t, z, form=form, v=v, way=way, at=at: law.flow(z, form, at(t), v, way)
                count = len(law.room(z, form, at(now), v, way))
                events = [
                    lambda t, z, i=i, form=form, v=v, way=way, at=at: law.room(z, form, at(t), v, way)[i]
                    for i in range(count)
                ]
                for event in events:
                    event.terminal, event.direction = True, -1
                # A law without a state of its own is given one that stays.
                state, rest = (z, rates) if z.size else (np.zeros(1), lambda t, z: [0.0])
                accuracy = dict(rtol=1e-12, atol=1e-19, max_step=(end - begin) / 30)
                run = solve_ivp(rest, (now, stop), state, "DOP853", events=events, **accuracy)
                assert run.success, run.message
                now, z = run.t[-1], run.y[: z.size, -1]
                for which, when in enumerate(run.t_events):
                    form = law.next(z, form, at(now), way, which) if when.size else form
            if stop != end:
                forces.append(law.force(z, form, at(stop), v, way))
    return np.array(forces)


@pytest.mark.parametrize("case", CASES)
def test_the_force_follows_speed_and_direction(case):
    name, law = LAWS[case]
    legs, accuracy = (LEGS[0], Accuracy(method=Taylor(8))) if case in QUICK else (LEGS[1], Accuracy())
    times, motion = zigzag(3, legs)
    seen = (times[:-1, None] + np.diff(times)[:, None] * np.array(PARTS)).ravel()
    friction = member("friction", name)(**{key: jnp.asarray(x) for key, x in dataclasses.asdict(law).items()})
    found = np.asarray(shown(friction, times, motion, seen, accuracy))
    np.testing.assert_allclose(found, expected(law, times, motion), rtol=0.0, atol=ROUNDED.get(case, 1e-7))
