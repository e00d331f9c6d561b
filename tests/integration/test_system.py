"""Systems that are no actuators, with the motion, the event times and all derivatives in closed form."""

import dataclasses
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bouncing_ball import free_fall
from marks import slow

from pdssjax import AbstractHybridSystem, Accuracy, Taylor
from pdssjax.integration import SETTLED, integrate_steps, sample_run, states_at

USUAL = Accuracy(method=Taylor(6), max_steps=64)


class Stretch(NamedTuple):
    duration: Any
    number: Any = 0.0


class Ball(AbstractHybridSystem):
    """A ball that falls from a height [m] and bounces: only what the contract demands."""

    height: Any
    gravity: Any
    restitution: Any

    def initial(self):
        return (jnp.asarray(self.height, float), jnp.zeros(()))

    def segment(self, index):
        return Stretch(jnp.asarray(jnp.inf))

    def field(self, segment, t_local, x, mode):
        return (x[1], -self.gravity)

    def guards(self, segment, t_local, x, mode):
        return (x[0],)

    def after_event(self, segment, t_local, x, mode, which):
        return (x[0], -self.restitution * x[1]), mode

    def state_scale(self):
        return (jnp.ones(()), jnp.ones(()))


class SmallBall(Ball):
    """Whose bounces are said to be small, so that derivatives are carried back to a fixed time at each of them."""

    def is_carried_back(self, slope, mode, which, amplitude):
        return jnp.ones((), bool)


class Ringing(AbstractHybridSystem):
    """A damped oscillator on a ramp, y'' = w^2 (c t - y) - 2 zeta w y'; it turns against the ramp, again and again."""

    creep: Any
    frequency: Any
    damping_ratio: Any

    def initial(self):
        return (jnp.zeros(()), jnp.zeros(()))

    def segment(self, index):
        return Stretch(jnp.asarray(jnp.inf))

    def field(self, segment, t_local, x, mode):
        y, rate = x
        return rate, self.frequency**2 * (self.creep * t_local - y) - 2.0 * self.damping_ratio * self.frequency * rate

    def guards(self, segment, t_local, x, mode):
        return ((x[1] - self.creep) * (2.0 * mode - 1.0),)

    def after_event(self, segment, t_local, x, mode, which):
        return x, 1.0 - mode

    def is_carried_back(self, slope, mode, which, amplitude):
        return jnp.abs(slope) < amplitude * self.frequency**2

    def state_scale(self):
        return (jnp.ones(()), 1e-4 * jnp.ones(()))


class Ramp(AbstractHybridSystem):
    """x' = slope until a corner at `turn` [s], where x jumps, then x' = 2 slope; no guards."""

    slope: Any
    turn: Any
    jump: Any

    @property
    def resets_at_corners(self):
        return True

    def initial(self):
        return (jnp.zeros(()),)

    def segment(self, index):
        return Stretch(jnp.where(index == 0, self.turn, jnp.inf), index)

    def field(self, segment, t_local, x, mode):
        return (self.slope * (1.0 + segment.number),)

    def guards(self, segment, t_local, x, mode):
        return ()

    def after_event(self, segment, t_local, x, mode, which):
        raise AssertionError("there is no event")

    def on_segment_start(self, segment, x, mode):
        return (x[0] + self.jump * segment.number,), mode

    def state_scale(self):
        return (jnp.ones(()),)


def ball(parameters, times, impacts=3):
    return free_fall(parameters, times, impacts)[0]


def shown(system, times):
    run = integrate_steps(system, times[-1], USUAL)
    return jnp.stack(states_at(system, run, times)[0]), run


def seen(system, times, accuracy=USUAL):
    run = sample_run(system, times, accuracy)
    return jnp.stack(run.states.x), run


def with_slopes(function, differentiate=jax.jacfwd):
    """Derivatives and values of `function`, compiled together."""
    return jax.jit(differentiate(lambda p: (function(p),) * 2, has_aux=True))


@pytest.mark.parametrize(
    ("states", "kind"), [slow(shown, Ball), (seen, Ball), (shown, SmallBall), slow(seen, SmallBall)]
)
def test_a_ball_bounces_as_the_law_of_free_fall_has_it_with_every_derivative_both_ways(states, kind):
    parameters, times = jnp.array([0.8, 9.81, 0.7]), jnp.linspace(0.01, 1.5, 40)
    simulated = lambda p: states(kind(*p), times)[0]
    slopes, values = with_slopes(simulated)(parameters)
    np.testing.assert_allclose(values, ball(parameters, times), rtol=0.0, atol=1e-12)
    expected = jax.jit(jax.jacfwd(ball))(parameters, times)
    np.testing.assert_allclose(slopes, expected, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(with_slopes(simulated, jax.jacrev)(parameters)[0], expected, rtol=1e-10, atol=1e-10)
    assert np.abs(expected).max() > 1.0


both_ways = pytest.mark.parametrize("differentiate", [jax.jacfwd, slow(jax.jacrev)])


@pytest.mark.slow
@both_ways
def test_what_is_left_of_a_ringing_keeps_its_derivatives(differentiate):
    """Left at the moving times of its last reversals, that by the ramp was 7e-8 off, all of it rounding."""
    times = jnp.linspace(1e-3, 0.045, 60)

    def response(parameters):
        creep, frequency, ratio = parameters
        turned, behind = frequency * jnp.sqrt(1.0 - ratio**2) * times, 2.0 * ratio / frequency
        rest = behind * jnp.cos(turned) + (2.0 * ratio**2 - 1.0) * jnp.sin(turned) * times / turned
        return creep * (times - behind + jnp.exp(-ratio * frequency * times) * rest)

    parameters = jnp.array([1.3e-4, 6000.0, 0.1])
    ringing = lambda p: seen(Ringing(*p), times, Accuracy(max_steps=512))[0][0]
    closed = jax.jit(jax.jacfwd(response))(parameters)
    slopes, values = with_slopes(ringing, differentiate)(parameters)
    np.testing.assert_allclose(values, response(parameters), rtol=0.0, atol=1e-17)
    assert (np.abs(slopes - closed).max(axis=0) < 1e-9 * np.abs(closed).max(axis=0)).all()


@both_ways
def test_states_are_read_off_a_long_run_block_by_block(monkeypatch, differentiate):
    """Blocks of 32 steps, of which the run fills more than two and the last of the room none."""
    monkeypatch.setattr("pdssjax.integration.tiles.BLOCK", 32)
    parameters, times = jnp.array([0.8, 9.81, 0.98]), jnp.linspace(0.3, 36.0, 70)
    roomy = dataclasses.replace(USUAL, max_steps=512)
    height = lambda p: seen(Ball(*p), times, roomy)[0]
    slopes, values = with_slopes(height, differentiate)(parameters)
    assert 64 < int(jax.jit(lambda: seen(Ball(*parameters), times, roomy)[1].count)()) < 480
    expected = partial(ball, times=times, impacts=160)
    np.testing.assert_allclose(values, expected(parameters), rtol=0.0, atol=1e-11)
    closed = jax.jit(jax.jacfwd(expected))(parameters)
    np.testing.assert_allclose(slopes, closed, rtol=1e-9, atol=1e-9 * np.abs(closed).max())


# By default a mixed derivative is held against its closed form.
@pytest.mark.slow
def test_second_derivatives_are_right_through_loops_and_lanes():
    """Forward over reverse mode of a loop, mapped: what a Hessian of a misfit of several records is made of."""
    parameters, times = jnp.array([0.8, 9.81, 0.7]), jnp.linspace(0.01, 1.5, 40)
    weights = jnp.cos(jnp.arange(40.0))

    def score(motion, delay):
        both = lambda p: jnp.sum(motion(p, times - delay * p[0]) * weights) ** 2
        return lambda p: jnp.sum(jax.lax.map(lambda factor: both(p * factor), jnp.array([1.0, 1.1])))

    balls = lambda p, times: seen(Ball(*p), times)[0] + seen(SmallBall(*p), times)[0]
    lanes = parameters * jnp.array([[1.0], [0.9]])
    found = jax.jit(jax.vmap(jax.hessian(score(balls, 1e-3))))(lanes)
    closed = jax.jit(jax.vmap(jax.hessian(score(lambda p, times: 2.0 * ball(p, times), 1e-3))))(lanes)
    np.testing.assert_allclose(found, closed, rtol=1e-11, atol=1e-11 * np.abs(closed).max())
    np.testing.assert_allclose(found, jnp.swapaxes(found, 1, 2), rtol=1e-13)


def test_a_third_derivative_is_refused():
    with pytest.raises(NotImplementedError, match=r"order 3 .* at most 2"):
        jax.eval_shape(jax.grad(jax.grad(jax.grad(lambda h: seen(Ball(h, 9.81, 0.7), jnp.array([0.1]))[0][0, 0]))), 0.8)


def test_the_derivative_by_what_moves_only_later_is_mixed_in():
    """The height moves in the inner derivative, gravity in the outer: their mixed derivative needs both."""
    times = jnp.linspace(0.01, 1.5, 40)
    mixed = lambda motion: jax.jit(jax.grad(jax.grad(lambda h, g: jnp.sum(motion(h, g)), 0), 1))(0.8, 9.81)
    found = mixed(lambda h, g: seen(Ball(h, g, 0.7), times)[0])
    assert float(found) == pytest.approx(float(mixed(lambda h, g: ball((h, g, 0.7), times))), rel=1e-12)


def test_states_move_with_the_times_at_which_they_are_seen():
    parameters, times = jnp.array([0.8, 9.81, 0.7]), jnp.linspace(0.01, 1.5, 40)
    late = lambda delay: seen(Ball(*parameters), times - delay)[0]
    slopes, values = with_slopes(late)(jnp.asarray(0.002))
    height, speed = np.asarray(values)
    np.testing.assert_allclose(slopes, [-speed, np.full_like(height, parameters[1])], rtol=1e-12, atol=1e-12)


def test_the_end_of_a_run_of_which_no_states_are_asked_moves_with_the_parameters():
    parameters, horizon = jnp.array([0.8, 9.81, 0.7]), jnp.asarray(1.3)

    def at_horizon(p):
        """The last step keeps its length and ends later where it begins later."""
        end = sample_run(Ball(*p), jnp.zeros(0), USUAL, (0,), horizon).end
        rate = jnp.stack([end.x[1], -parameters[1]])
        return end.x + jax.lax.stop_gradient(rate) * (horizon - end.time)

    slopes, values = with_slopes(at_horizon)(parameters)
    closed = lambda p: ball(p, horizon[None])[:, 0]
    np.testing.assert_allclose(values, closed(parameters), rtol=1e-12)
    np.testing.assert_allclose(slopes, jax.jit(jax.jacfwd(closed))(parameters), rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("states", [shown, seen])
def test_a_corner_that_moves_moves_the_jump_and_the_slope_behind_it(states):
    times = jnp.array([0.1, 0.29, 0.31, 0.6])
    ramp = lambda p: states(Ramp(*p), times)[0][0]
    slope, turn, jump = parameters = jnp.array([2.0, 0.3, 0.05])
    late = times > turn
    closed = jnp.where(late, slope * turn + jump + 2.0 * slope * (times - turn), slope * times)
    slopes, values = with_slopes(ramp)(parameters)
    np.testing.assert_allclose(values, closed, rtol=1e-14)
    expected = jnp.stack([closed / slope - late * jump / slope, -slope * late, 1.0 * late], axis=-1)
    np.testing.assert_allclose(slopes, expected, rtol=1e-12, atol=1e-13)


def test_what_a_system_does_not_tell_is_never_used_against_it():
    system = Ball(0.8, 9.81, 0.7)
    x, later = (jnp.asarray(0.3), jnp.asarray(-1.0)), (jnp.asarray(0.3), jnp.asarray(-1.0 + 1e-6))
    assert system.period() is None
    assert not system.is_settled(system.segment(0.0), 0.0, x, 1.0, np.inf)
    assert system.same_state(x, later, 2e-6)
    assert not system.same_state(x, later, 5e-7)
    run = jax.jit(lambda times: shown(system, times)[1])(jnp.array([0.2]))
    assert not (run.steps.mode == SETTLED).any()
    assert not run.repeats
