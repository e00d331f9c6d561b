"""The field for diffrax: the motion of `simulate` within one mode, the drive's corners, and what is refused."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from parts import AnisotropicLuGre, Dahl, LuGre, MaxwellSlip, ResetIntegrator, Sawtooth, SecondOrder, Static

import pdssjax
from pdssjax import Accuracy, Actuator, Taylor
from pdssjax.simulation.flat_vector_field import drive_clock

ACTUATOR, DRIVE = Actuator(SecondOrder(), AnisotropicLuGre()), Sawtooth(64.0, 5.0, 1e-3)
_RATES = eqx.filter_jit(lambda f, y: f(0.01, y))
TIMES = np.linspace(0.0, 1e-4, 300)
"""The platform's first way up, where the relative motion has not turned yet; as many as in `test_velocity_jumps`."""


def test_diffrax_solves_it_as_simulate_does_within_a_mode():
    f = pdssjax.vector_field(ACTUATOR, DRIVE, "advancing")
    control = diffrax.PIDController(rtol=1e-11, atol=1e-16)
    term, saved = diffrax.ODETerm(f), diffrax.SaveAt(ts=jnp.asarray(TIMES))
    found = diffrax.diffeqsolve(
        term, diffrax.Tsit5(), 0.0, TIMES[-1], 1e-7, f.initial, stepsize_controller=control, saveat=saved
    )
    expected = pdssjax.simulate(ACTUATOR, DRIVE, TIMES, Accuracy(method=Taylor(8)))
    assert int(expected.events) == 0
    platform, effector = jax.vmap(f.displacements)(found.ys)
    scale = np.abs(expected.platform).max()
    np.testing.assert_allclose(platform, expected.platform, atol=1e-7 * scale)
    np.testing.assert_allclose(effector, expected.effector, atol=1e-7 * scale)


def test_components_have_names_and_the_mode_follows_the_velocity():
    f = pdssjax.vector_field(ACTUATOR, DRIVE)
    assert f.names[:2] == ("d", "v") and len(f.names) == f.initial.size
    for velocity, mode in ((1e-3, "advancing"), (-1e-3, "retreating")):
        y = f.initial.at[1].set(velocity)
        held = pdssjax.vector_field(ACTUATOR, DRIVE, mode)
        rates = _RATES(f, y)
        np.testing.assert_array_equal(rates, _RATES(held, y))
        np.testing.assert_allclose(rates[0], velocity)
    stuck = pdssjax.vector_field(ACTUATOR, DRIVE, "stuck")
    np.testing.assert_array_equal(_RATES(stuck, f.initial)[:2], 0.0)


def test_the_segment_is_that_of_the_voltage():
    times = np.array([0.0, 0.05, 0.2003, 0.21, 0.39, 0.4004, 0.7])
    level = lambda segment, t_local: segment.voltage(t_local).level
    found = jax.jit(jax.vmap(lambda time: level(*drive_clock(DRIVE).at(time))))(times)
    np.testing.assert_allclose(found, DRIVE.sampled_at(times), atol=1e-9)
    corners = pdssjax.vector_field(ACTUATOR, DRIVE).corners(0.5)
    np.testing.assert_allclose(corners, [0.2, 0.201, 0.4, 0.401])


@pytest.mark.parametrize(
    ("part", "actuator"),
    [
        ("ResetIntegrator", Actuator(SecondOrder(), ResetIntegrator())),
        ("Dahl", Actuator(SecondOrder(), Dahl())),
        ("Static", Actuator(Static(), AnisotropicLuGre())),
        ("MaxwellSlip", Actuator(MaxwellSlip(), AnisotropicLuGre())),
    ],
)
def test_a_part_with_events_of_its_own_is_refused_but_within_a_mode(part, actuator):
    with pytest.raises(pdssjax.InputError, match=f"vector_field: found .*{part}.* whose state changes at events"):
        pdssjax.vector_field(actuator, DRIVE)
    assert pdssjax.vector_field(actuator, DRIVE, "advancing").mode == "advancing"


def test_flags_that_only_end_a_step_are_no_events():
    assert pdssjax.vector_field(Actuator(SecondOrder(), LuGre()), DRIVE).mode is None


def test_a_mode_that_is_none_is_refused():
    with pytest.raises(pdssjax.InputError, match="mode: found 'sliding', expected None, or one of advancing, stuck"):
        pdssjax.vector_field(ACTUATOR, DRIVE, "sliding")
