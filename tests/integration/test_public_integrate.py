"""Systems written from docs/integration.md alone, beside closed forms and SciPy: values and derivatives both ways."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bouncing_ball import BouncingBall, free_fall
from marks import slow
from scipy.integrate import solve_ivp

from pdssjax.integration import HybridSystem, integrate

FEW = 128
"""Steps for which there is room: less to compile for and to expand."""


class Room(HybridSystem):
    """A temperature that a heater in mode 1 raises; it is switched at two levels."""

    def vector_field(self, t, y, args, mode):
        return -args["loss"] * y + jnp.where(mode == 1, args["power"], 0.0)

    def guards(self, t, y, args, mode):
        low, high = args["levels"]
        return jnp.where(mode == 1, high - y, y - low)

    def after_event(self, t, y, args, mode, which):
        return y, 1 - mode


class Oscillator(HybridSystem):
    """A driven pendulum that strikes a wall: a vector state, and functions that no series passes."""

    restitution: float

    def vector_field(self, t, y, args, mode):
        return jnp.array([y[1], -jnp.sin(y[0]) - 0.1 * y[1] + args["force"] * jnp.cos(1.3 * t)])

    def guards(self, t, y, args, mode):
        return (args["wall"] - jnp.tanh(y[0]),)

    def after_event(self, t, y, args, mode, which):
        return y.at[1].multiply(-self.restitution), mode


class Pulse(HybridSystem):
    """Charges until a corner that is an argument, and then goes down: a field with a jump in time."""

    def vector_field(self, t, y, args, mode):
        return jnp.where(t < args, 1.0 - y, -y)

    def corners(self, args):
        return args[None]


def with_slopes(function, differentiate=jax.jacfwd):
    """Derivatives and values of `function`, compiled together."""
    return jax.jit(differentiate(lambda p: (function(p),) * 2, has_aux=True))


# A micrometre and a microsecond, and a kilometre and an hour: no constant of the integrator has a unit.
@pytest.mark.parametrize(("length", "time"), [slow(1.0, 1.0), (1e-6, 1e-6), slow(1e3, 3.6e3)])
def test_a_ball_bounces_as_the_law_of_free_fall_has_it_in_any_units(length, time):
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
    expected, closed_values = with_slopes(lambda p: free_fall(p, times))(parameters)
    for differentiate in (jax.jacfwd, jax.jacrev) if length == 1.0 else (jax.jacfwd,):
        slopes, values = with_slopes(motion, differentiate)(parameters)
        for found, closed in zip(values, closed_values, strict=True):
            np.testing.assert_allclose(found, closed, rtol=0.0, atol=1e-10)
        for found, closed in zip(slopes, expected, strict=True):
            np.testing.assert_allclose(found, closed, rtol=1e-8, atol=1e-8)


# By default `test_system` has a mixed second derivative.
@pytest.mark.slow
@pytest.mark.parametrize("outer", [jax.jacfwd, jax.jacrev])
def test_a_reverse_derivative_is_differentiated_again_in_both_modes(outer):
    def height(restitution):
        args = {"gravity": 9.81, "restitution": restitution}
        solution = integrate(BouncingBall(), 0.0, 1.5, (0.8, 0.0), args, saveat=jnp.array([0.3, 1.2]), max_steps=FEW)
        return solution.ys[0][-1]

    closed = lambda restitution: free_fall(jnp.stack([0.8, 9.81, restitution]), jnp.array([0.3, 1.2]))[0][0, -1]
    expected = jax.jit(jax.hessian(closed))(0.7)
    np.testing.assert_allclose(jax.jit(outer(jax.jacrev(height)))(0.7), expected, rtol=1e-9)


def broken_off(restitution, throw):
    """A run whose steps are used up, after the fifth impact, at 1.84 s."""
    args, at = {"gravity": 9.81, "restitution": restitution}, jnp.array([0.5, 2.4])
    return integrate(BouncingBall(), 0.0, 2.5, (0.8, 0.0), args, saveat=at, max_steps=30, throw=throw)


def test_derivatives_are_right_up_to_where_a_run_breaks_off_and_unknown_from_there():
    """Under `jit` an error of values that nobody asks for is dropped, and a derivative of 0 would pass for one."""
    fall = lambda e: free_fall(jnp.stack([0.8, 9.81, e]), jnp.array([0.5]))[0][0, 0]
    slope = jax.jit(jax.jacfwd(lambda e: broken_off(e, False).ys[0][0]))(0.7)
    assert float(slope) == pytest.approx(float(jax.jit(jax.grad(fall))(0.7)), rel=1e-9)
    assert np.isnan(jax.jit(jax.grad(lambda e: broken_off(e, True).ys[0][1]))(0.7))


def test_corners_may_come_in_any_order():
    class Steps(HybridSystem):
        def vector_field(self, t, y, args, mode):
            return jnp.where(t < 0.2, 1.0, jnp.where(t < 0.5, 2.0, 3.0))

        def corners(self, args):
            return jnp.array([0.5, 0.2])

        def after_corner(self, t, y, args, mode, which):
            return y + 10.0 * jnp.where(which == 0, 1.0, 3.0), mode

    run = integrate(Steps(), 0.0, 1.0, 0.0, saveat=jnp.array([0.1, 0.3, 1.0]), max_steps=FEW)
    np.testing.assert_allclose(run.ys, [0.1, 30.4, 42.3], atol=1e-12)


def test_a_heater_switches_at_its_levels_in_every_lane():
    """Between events the temperature is an exponential, so that its periods are known.

    Where one kernel rounds a root's sign otherwise than another, no switch may be lost: of 400 such heaters 53 lost one
    at LLVM's level 0, and 126 with jaxlib 0.12 at any level.
    """

    def switched(loss, power):
        args = {"loss": loss, "power": power, "levels": (18.0, 22.0)}
        solution = integrate(Room(), 0.0, 10.0, 20.0, args, mode=1, max_steps=FEW, max_events=4, throw=False)
        return solution.events.ts, (solution.events.ts, solution.modes[-1])

    def closed(loss, power):
        level = power / loss
        first = jnp.log((level - 20.0) / (level - 22.0)) / loss
        down, up = jnp.log(22.0 / 18.0) / loss, jnp.log((level - 18.0) / (level - 22.0)) / loss
        return first + jnp.stack([0.0 * down, down, down + up, 2 * down + up])

    random = np.random.default_rng(1)
    losses = random.uniform(0.2, 0.5, 100)
    lanes = jnp.asarray(losses), jnp.asarray(losses * random.uniform(25.0, 60.0, losses.size))
    slopes, (times, modes) = jax.jit(jax.vmap(jax.jacrev(switched, has_aux=True)))(*lanes)
    expected = jax.jit(jax.vmap(lambda *lane: (closed(*lane), jax.jacfwd(closed)(*lane))))(*lanes)
    np.testing.assert_allclose(times, expected[0], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(slopes, expected[1], rtol=1e-7)
    assert set(np.asarray(modes).tolist()) <= {0, 1}


def scipy_oscillator(force, wall, restitution, times):
    """The pendulum with SciPy, from event to event."""
    field = lambda t, y: [y[1], -np.sin(y[0]) - 0.1 * y[1] + force * np.cos(1.3 * t)]

    def strikes(t, y):
        return wall - np.tanh(y[0])

    strikes.terminal, strikes.direction = True, -1
    t, y, states, struck = 0.0, [0.1, 0.0], [], []
    while True:
        run = solve_ivp(field, (t, times[-1]), y, "DOP853", rtol=2.3e-14, atol=1e-14, events=strikes, dense_output=True)
        inside = times[(times >= t) & (times <= run.t[-1])]
        states.append(run.sol(inside))
        if run.status != 1:
            return np.concatenate(states, axis=1), np.array(struck)
        t, y = run.t[-1], [run.y[0, -1], -restitution * run.y[1, -1]]
        struck.append(t)


# By default a ball and a heater are held against closed forms.
@pytest.mark.slow
def test_a_pendulum_strikes_a_wall_as_scipy_has_it():
    times = np.linspace(0.0, 8.0, 25)

    def motion(p):
        solution = integrate(
            Oscillator(p[2]), 0.0, 8.0, jnp.array([0.1, 0.0]), {"force": p[0], "wall": p[1]}, saveat=times
        )
        return solution.ys, solution.events.ts[:2]

    parameters = np.array([0.9, 0.4, 0.8])
    values, struck = scipy_oscillator(*parameters, times)
    assert len(struck) >= 2
    slopes, (found, at) = with_slopes(motion)(parameters)
    reverse = jax.jit(jax.vmap(jax.jacrev(lambda p: motion(p)[0])))(parameters[None])[0]
    np.testing.assert_allclose(reverse, slopes[0], rtol=0.0, atol=1e-9 * np.abs(slopes[0]).max())
    np.testing.assert_allclose(found, values.T, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(at, struck[:2], rtol=0.0, atol=1e-9)
    for i in range(3):
        step = 1e-4 * np.eye(3)[i]
        two, one = ((scipy_oscillator(*(parameters + k * step), times)[0]) for k in (2, 1))
        back, further = ((scipy_oscillator(*(parameters - k * step), times)[0]) for k in (1, 2))
        difference = (8.0 * (one - back) - (two - further)) / (12.0 * 1e-4)
        np.testing.assert_allclose(slopes[0][..., i], difference.T, rtol=0.0, atol=1e-7 * np.abs(difference).max())


def test_a_field_may_jump_at_a_corner_that_moves():
    times = jnp.array([0.5, 1.0, 1.5])
    charge = lambda corner: integrate(Pulse(), 0.0, 1.5, 0.0, corner, saveat=times, max_steps=FEW).ys
    corner = jnp.asarray(0.7)
    slopes, values = with_slopes(charge)(corner)
    closed = lambda corner: jnp.where(
        times < corner, 1.0 - jnp.exp(-times), (1.0 - jnp.exp(-corner)) * jnp.exp(corner - times)
    )
    np.testing.assert_allclose(values, closed(corner), rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(slopes, jax.jacfwd(closed)(corner), rtol=1e-8, atol=1e-10)


class ImpactOscillator(HybridSystem):
    """A mass on a spring beside a wall that it hits, touches or misses."""

    def vector_field(self, t, y, args, mode):
        return y[1], -y[0]

    def guards(self, t, y, args, mode):
        return args["wall"] - y[0]

    def after_event(self, t, y, args, mode, which):
        return (args["wall"], -args["restitution"] * y[1]), mode


class Block(HybridSystem):
    """A block on a belt, held back by a spring: it sticks in mode 0 and slips in mode 1."""

    def vector_field(self, t, y, args, mode):
        pull = args["kinetic"] - args["stiffness"] * y["x"]
        return {"x": y["v"], "v": jnp.where(mode == 1, pull / args["mass"], 0.0)}

    def guards(self, t, y, args, mode):
        return jnp.where(mode == 1, args["belt"] - y["v"][0], args["static"] - args["stiffness"] * y["x"][0])

    def after_event(self, t, y, args, mode, which):
        return {"x": y["x"], "v": args["belt"][None]}, 1 - mode


def impact(p):
    """State after an impact and its time: of the speed at the start, the wall and the restitution."""
    args = {"wall": p[1], "restitution": p[2]}
    run = integrate(ImpactOscillator(), 0.0, 3.0, (0.0, p[0]), args, max_steps=FEW, max_events=1)
    return jnp.stack([*(part[0] for part in run.ys), run.events.ts[0]])


def closed_impact(p):
    speed, wall, restitution = p
    at, back = jnp.arcsin(wall / speed), restitution * jnp.sqrt(speed**2 - wall**2)
    cosine, sine = jnp.cos(3.0 - at), jnp.sin(3.0 - at)
    return jnp.stack([wall * cosine - back * sine, -wall * sine - back * cosine, at])


def slips(p):
    """Place at the end and the times of the first four events: of mass, stiffness, static and kinetic friction."""
    args = dict(zip(("mass", "stiffness", "static", "kinetic"), p, strict=True)) | {"belt": jnp.asarray(0.5)}
    start = {"x": jnp.zeros(1), "v": jnp.full(1, 0.5)}
    run = integrate(Block(), 0.0, 14.0, start, args, max_steps=FEW, max_events=4)
    return jnp.append(run.ys["x"].ravel(), run.events.ts)


def closed_slips(p):
    """Slipping it swings about kinetic/stiffness until it is as fast as the belt again, as far behind as ahead."""
    mass, stiffness, static, kinetic = p
    rate, ahead = jnp.sqrt(stiffness / mass), (static - kinetic) / stiffness
    slip = (jnp.pi + 2.0 * jnp.arctan2(0.5 / rate, ahead)) / rate
    stick = 2.0 * ahead / 0.5
    first = static / stiffness / 0.5
    times = jnp.stack([first, first + slip, first + slip + stick, first + 2.0 * slip + stick])
    return jnp.append(kinetic / stiffness - ahead + 0.5 * (14.0 - times[3]), times)


BOTH_WAYS = {
    "impact oscillator": (impact, closed_impact, [[1.3, 1.0, 0.8], [1.01, 1.0, 0.9]]),
    "block": (slips, closed_slips, [[1.0, 1.2, 1.5, 0.6], [0.9, 1.1, 1.4, 0.7]]),
}
"""Of numbers alone: by the integrator, in closed form, and two lanes of the numbers."""


@pytest.mark.slow
@pytest.mark.parametrize("name", BOTH_WAYS)
def test_a_system_has_right_values_and_derivatives_both_ways_in_every_lane(name):
    found, closed, lanes = BOTH_WAYS[name]
    lanes = np.array(lanes)

    @jax.jit
    @jax.vmap
    def run(p):
        forward, values = jax.jacfwd(lambda p: (found(p),) * 2, has_aux=True)(p)
        return values, forward, jax.jacrev(found)(p)

    for p, values, *slopes in zip(lanes, *map(np.asarray, run(lanes)), strict=True):
        np.testing.assert_allclose(values, closed(p), rtol=0.0, atol=1e-9)
        by = jax.jacfwd(closed)(p)
        for slope in slopes:
            np.testing.assert_allclose(slope, by, rtol=0.0, atol=1e-7 * max(1.0, np.abs(by).max()))


@pytest.mark.slow
def test_towards_grazing_values_stay_right_and_the_derivative_grows_without_bound():
    """Of the speed at the start: below the wall nothing happens, just above it the slope is -1.78 over a root."""
    place = lambda speed: impact(jnp.array([speed, 1.0, 0.8]))[0]
    speeds = jnp.array([0.99, 1.0 + 1e-8, 1.0001, 1.1])
    values, slopes = jax.jit(jax.vmap(jax.value_and_grad(place)))(speeds)
    closed = lambda speed: closed_impact(jnp.stack([speed, jnp.ones(()), 0.8 * jnp.ones(())]))[0]
    np.testing.assert_allclose(values[0], 0.99 * np.sin(3.0), atol=1e-11)
    np.testing.assert_allclose(slopes[0], np.sin(3.0), atol=1e-10)
    np.testing.assert_allclose(values[1:], jax.vmap(closed)(speeds[1:]), atol=1e-8)
    np.testing.assert_allclose(slopes[1:], jax.vmap(jax.grad(closed))(speeds[1:]), rtol=1e-4)
    assert slopes[1] < -1e4
