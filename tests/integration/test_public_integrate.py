"""Systems written from docs/integration.md alone, beside closed forms: values and derivatives both ways."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pdssjax.integration import HybridSystem, integrate
from pdssjax.integration.chebyshev import basis

FEW = 128
"""Steps for which there is room: less to compile for and to expand."""


class BouncingBall(HybridSystem):
    """Falls, and bounces off the floor."""

    def vector_field(self, t, y, args, mode):
        return y[1], -args["gravity"]

    def guards(self, t, y, args, mode):
        return y[0]

    def after_event(self, t, y, args, mode, which):
        return (jnp.zeros(()), -args["restitution"] * y[1]), mode


class Room(HybridSystem):
    """A temperature that a heater in mode 1 raises; it is switched at two levels."""

    def vector_field(self, t, y, args, mode):
        return -args["loss"] * y + jnp.where(mode == 1, args["power"], 0.0)

    def guards(self, t, y, args, mode):
        low, high = args["levels"]
        return jnp.where(mode == 1, high - y, y - low)

    def after_event(self, t, y, args, mode, which):
        return y, 1 - mode


def ball(parameters, times):
    """Height and speed and the first three impacts, from the law of free fall."""
    height, gravity, restitution = parameters
    first = jnp.sqrt(2.0 * height / gravity)
    impacts = first + jnp.concatenate([jnp.zeros(1), jnp.cumsum(2.0 * first * restitution ** jnp.arange(1, 4))])
    number = jnp.searchsorted(jax.lax.stop_gradient(impacts), times, side="right")
    since = times - jnp.where(number == 0, 0.0, impacts[number - 1])
    speed = jnp.where(number == 0, 0.0, gravity * first * restitution**number)
    start = jnp.where(number == 0, height, 0.0)
    return jnp.stack([start + speed * since - 0.5 * gravity * since**2, speed - gravity * since]), impacts[:3]


def with_slopes(function, differentiate=jax.jacfwd):
    """Derivatives and values of `function`, compiled together."""
    return jax.jit(differentiate(lambda p: (function(p),) * 2, has_aux=True))


@pytest.mark.parametrize(("length", "time"), [(1.0, 1.0)])
def test_a_ball_bounces_as_the_law_of_free_fall_has_it(length, time):
    units = jnp.array([length, length / time**2, 1.0])
    scale = jnp.array([[length], [length / time]])
    times = jnp.linspace(0.0, 1.5, 40)

    def motion(p):
        args = {"gravity": p[1] * units[1], "restitution": p[2]}
        start, atol = (p[0] * length, 0.0), (1e-13 * length, 1e-13 * length / time)
        solution = integrate(
            BouncingBall(), 2.0 * time, 3.5 * time, start, args, saveat=(2.0 + times) * time, atol=atol, max_steps=FEW
        )
        return jnp.stack(solution.ys) / scale, solution.events.ts[:3] / time - 2.0

    parameters = jnp.array([0.8, 9.81, 0.7])
    expected = jax.jacfwd(lambda p: ball(p, times))(parameters)
    for differentiate in (jax.jacfwd, jax.jacrev) if length == 1.0 else (jax.jacfwd,):
        slopes, values = with_slopes(motion, differentiate)(parameters)
        for found, closed in zip(values, ball(parameters, times), strict=True):
            np.testing.assert_allclose(found, closed, rtol=0.0, atol=1e-10)
        for found, closed in zip(slopes, expected, strict=True):
            np.testing.assert_allclose(found, closed, rtol=1e-8, atol=1e-8)


def test_a_heater_switches_at_its_levels_in_every_lane():
    """Between events the temperature is an exponential, so that its periods are known."""

    def switched(loss, power):
        args = {"loss": loss, "power": power, "levels": (18.0, 22.0)}
        solution = integrate(Room(), 0.0, 10.0, 20.0, args, mode=1, max_steps=FEW, max_events=4, throw=False)
        return solution.events.ts, solution.modes[-1]

    def closed(loss, power):
        level = power / loss
        first = jnp.log((level - 20.0) / (level - 22.0)) / loss
        down, up = jnp.log(22.0 / 18.0) / loss, jnp.log((level - 18.0) / (level - 22.0)) / loss
        return first + jnp.stack([0.0 * down, down, down + up, 2 * down + up])

    lanes = jnp.array([0.2, 0.25]), jnp.array([8.0, 9.0])
    both = lambda loss, power: (switched(loss, power), jax.jacrev(lambda lost: switched(lost, power)[0])(loss))
    (times, modes), slopes = jax.jit(jax.vmap(both))(*lanes)
    np.testing.assert_allclose(times, jax.vmap(closed)(*lanes), rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(slopes, jax.vmap(jax.jacfwd(closed))(*lanes), rtol=1e-7)
    assert set(np.asarray(modes).tolist()) <= {0, 1}


def test_a_polynomial_through_a_guard_is_right_to_rounding():
    points = basis(16)
    fitted = points.powers(np.cos(2.0 * points.nodes)[:, None])[:, 0]
    between = np.linspace(0.0, 1.0, 101)
    np.testing.assert_allclose(np.polynomial.polynomial.polyval(between, fitted), np.cos(2.0 * between), atol=2e-15)
