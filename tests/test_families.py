"""A contract that every member of every family keeps, and the physics of those that are there."""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pdssjax.drive.base import AbstractDrive, Segment
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.drive.step import Step
from pdssjax.family import member, members
from pdssjax.friction.anisotropic_lugre import AnisotropicLuGre
from pdssjax.friction.base import AbstractFriction
from pdssjax.friction.simplified_lugre import SimplifiedLuGre
from pdssjax.piezo.base import AbstractPiezo
from pdssjax.quantity import quantities

INTERFACES = {"drive": AbstractDrive, "piezo": AbstractPiezo, "friction": AbstractFriction}
EVERYONE = [(family, name) for family in INTERFACES for name in members(family)]

DRIVES = [member("drive", name)() for name in members("drive")] + [
    *(Sawtooth(30.0, 20.0, fall, direction) for fall in (0.0, 1.3e-3) for direction in ("forward", "backward")),
    *(Step(48.2, rise) for rise in (0.0, 2e-3)),
]
PIEZOS = [member("piezo", name)() for name in members("piezo")]
LAWS = [member("friction", name)() for name in members("friction")] + [AnisotropicLuGre(state="force")]
SIGNS = (1.0, -1.0)


@pytest.mark.parametrize(("family", "name"), EVERYONE)
def test_members_are_pytrees_with_nominal_values_and_units(family, name):
    model = member(family, name)
    made = model()
    leaves, structure = jax.tree.flatten(made)
    assert isinstance(made, INTERFACES[family])
    assert eqx.tree_equal(jax.tree.unflatten(structure, leaves), made)
    assert eqx.tree_equal(jax.jit(lambda tree: tree)(made), jax.tree.map(jnp.asarray, made))
    for declared in quantities(model).values():
        assert declared.low <= declared.nominal < declared.high
        assert declared.nominal > 0 or not declared.positive


@pytest.mark.parametrize("name", ["sawtooths", "base"])
def test_what_is_no_member_is_not_found(name):
    with pytest.raises(KeyError):
        member("drive", name)


def corners(drive: AbstractDrive, count: int) -> list[tuple[float, Segment]]:
    """The first segments of a drive, each with the time at which it begins."""
    segments = [drive.segment(jnp.asarray(k)) for k in range(count)]
    return list(zip(itertools.accumulate((float(s.duration) for s in segments), initial=0.0), segments, strict=False))


@pytest.mark.parametrize("drive", DRIVES, ids=str)
def test_segments_of_a_drive_join_up_to_its_voltage(drive):
    assert drive.at(jnp.asarray([-1.0, -1e-9])) == pytest.approx(0.0)
    for begin, segment in corners(drive, 9):
        if not np.isfinite(begin) or segment.duration == 0.0:
            continue
        lapse = np.linspace(0.01, 0.99, 7) * min(float(segment.duration), 1.0)
        straight = segment.start + segment.slope * lapse
        np.testing.assert_allclose(drive.at(jnp.asarray(begin + lapse)), straight, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("drive", DRIVES, ids=str)
def test_segments_repeat_where_a_drive_says_so(drive):
    if drive.period() is None:
        return
    first, count = drive.period()
    for k in range(first, first + count):
        np.testing.assert_allclose(drive.segment(jnp.asarray(k)), drive.segment(jnp.asarray(k + 3 * count)))


def test_a_forward_sawtooth_rises_over_its_whole_first_cycle_then_falls_and_rises():
    drive = Sawtooth(30.0, 20.0, 1e-3, "forward")
    times = jnp.asarray([0.0, 0.025, 0.05 - 1e-9, 0.0505, 0.051, 0.0755, 0.1 - 1e-9])
    np.testing.assert_allclose(drive.at(times), [0.0, 15.0, 30.0, 15.0, 0.0, 15.0, 30.0], atol=1e-4)


def test_a_backward_sawtooth_jumps_up_in_every_cycle_then_falls():
    drive = Sawtooth(30.0, 20.0, 1e-3, "backward")
    times = jnp.asarray([0.0, 0.0005, 0.001, 0.0255, 0.05 - 1e-9, 0.0505])
    np.testing.assert_allclose(drive.at(times), [0.0, 15.0, 30.0, 15.0, 0.0, 15.0], atol=1e-4)


@pytest.mark.parametrize("direction", ["forward", "backward"])
def test_the_fall_time_can_be_differentiated_at_zero(direction):
    lengths = [Sawtooth(direction=direction).segment(jnp.asarray(k)).duration for k in (2, 3)]
    slopes = [jax.grad(lambda tf, k=k: Sawtooth(64.2, 5.0, tf, direction).segment(k).duration)(0.0) for k in (2, 3)]
    assert [float(x) for x in lengths] == pytest.approx([0.0, 0.2])
    assert [float(x) for x in slopes] == pytest.approx([1.0, -1.0])


def platform(piezo: AbstractPiezo, segment: Segment, after: float, lapse: float, begin) -> np.ndarray:
    """(y, y') a time `lapse` later, by an integrator that knows only the acceleration."""
    acceleration = jax.jit(piezo.acceleration)

    def field(time, state):
        return [state[1], acceleration(*state, segment.start + segment.slope * (after + time))]

    return solve_ivp(field, (0.0, lapse), begin, method="DOP853", rtol=1e-12, atol=1e-16).y[:, -1]


@pytest.mark.parametrize("piezo", PIEZOS, ids=str)
@pytest.mark.parametrize(("slope", "after"), [(0.0, 0.0), (321.0, 0.002), (-5e4, 0.0)])
def test_the_platform_moves_as_its_acceleration_says(piezo, slope, after):
    segment = Segment(jnp.inf, 64.2, slope)
    begin = (2e-6, -0.01)
    y, w = piezo.motion(*begin, segment, after, 0.0021)
    expected = platform(piezo, segment, after, 0.0021, begin)
    assert [float(y), float(w)] == pytest.approx(list(expected), rel=1e-9)


@pytest.mark.parametrize("piezo", PIEZOS, ids=str)
def test_the_platform_stays_where_it_is_steady(piezo):
    segment = Segment(jnp.inf, 10.0, 321.0)
    moved = piezo.motion(*piezo.steady(segment, 0.001), segment, 0.001, 0.003)
    np.testing.assert_allclose(moved, piezo.steady(segment, 0.004), rtol=1e-12)


@pytest.mark.parametrize("piezo", PIEZOS, ids=str)
def test_the_platform_at_rest_under_a_constant_voltage_is_not_accelerated(piezo):
    y, w = piezo.steady(Segment(jnp.inf, 64.2, 0.0), 0.0)
    assert float(w) == 0.0
    assert abs(float(piezo.acceleration(y, w, 64.2))) < 1e-9 * abs(float(piezo.acceleration(0.0, 0.0, 64.2)))


@pytest.mark.parametrize("law", LAWS, ids=str)
@pytest.mark.parametrize("sign", SIGNS)
def test_the_undisturbed_contact_is_in_equilibrium(law, sign):
    state, rest = law.initial(), jnp.zeros(())
    rates = law.rate(state, rest, sign)
    assert jax.tree.structure(rates) == jax.tree.structure(state) == jax.tree.structure(law.length())
    assert all(jnp.shape(x) == () for x in (*state, *rates, *law.length(), law.force(state, rest, sign)))
    assert all(float(length) > 0 for length in law.length())
    assert all(float(rate) == 0.0 for rate in rates)
    assert float(law.force(state, rest, sign)) == 0.0


def slid(law: AbstractFriction, path: float, v: float) -> tuple:
    """The state after sliding from the undisturbed one over `path` [m] at velocity `v` [m/s]."""
    sign = np.sign(v)
    rate = jax.jit(lambda state: jnp.stack(law.rate(tuple(state), jnp.asarray(v), sign)))
    begin = np.asarray(law.initial())
    return tuple(solve_ivp(lambda _, x: rate(x), (0.0, path / abs(v)), begin, rtol=1e-11, atol=1e-18).y[:, -1])


@pytest.mark.parametrize("law", LAWS, ids=str)
@pytest.mark.parametrize("v", [1e-3, -1e-3])
def test_sliding_becomes_steady_and_drags_the_effector_along(law, v):
    state = slid(law, 2e-5, v)
    rates = law.rate(state, jnp.asarray(v), np.sign(v))
    assert all(abs(float(r * length)) < 1e-7 * abs(v) for r, length in zip(rates, law.length(), strict=True))
    assert float(law.force(state, jnp.asarray(v), np.sign(v))) * v > 0


@pytest.mark.parametrize(
    ("law", "forward", "backward"),
    [
        (SimplifiedLuGre(), 0.65, 0.65),
        (AnisotropicLuGre(), 0.7964, 0.5458),
        (AnisotropicLuGre(state="force"), 0.7964, 0.5458),
    ],
    ids=str,
)
def test_steady_sliding_takes_the_breakaway_force_of_its_direction(law, forward, backward):
    for v, expected in ((1e-3, forward), (-1e-3, -backward)):
        assert float(law.force(slid(law, 2e-5, v), jnp.asarray(v), np.sign(v))) == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("law", LAWS, ids=str)
@pytest.mark.parametrize("force", [0.3, -0.3])
def test_a_relaxed_contact_carries_the_force_asked_for(law, force):
    state, _ = law.relaxed(law.initial(), jnp.asarray(force))
    assert float(law.force(state, jnp.zeros(()), np.sign(force))) == pytest.approx(force, rel=1e-12)
    again, yields = law.relaxed(state, jnp.asarray(force))
    np.testing.assert_allclose(again, state)
    assert float(yields) == pytest.approx(0.0, abs=1e-18)


def test_only_the_force_reading_is_continuous_where_the_velocity_changes_sign():
    rest = jnp.zeros(())
    deflection, force = AnisotropicLuGre(), AnisotropicLuGre(state="force")
    jump = [float(deflection.force((jnp.asarray(4e-7),), rest, sign)) for sign in SIGNS]
    same = [float(force.force((jnp.asarray(0.4),), rest, sign)) for sign in SIGNS]
    assert jump == pytest.approx([4e-7 * 1.1484e6, 4e-7 * 0.953789e6])
    assert same == pytest.approx([0.4, 0.4])


@pytest.mark.parametrize("v", [2e-3, -2e-3])
def test_the_direction_dependent_law_with_equal_sides_is_the_isotropic_one(v):
    isotropic = SimplifiedLuGre()
    s0, s1, f = isotropic.sigma0, isotropic.sigma1, isotropic.f_ss
    expected = isotropic.force(slid(isotropic, 4e-7, v), jnp.asarray(v), np.sign(v))
    for reading in ("deflection", "force"):
        law = AnisotropicLuGre(s0, s0, s1, s1, f, f, reading)
        actual = law.force(slid(law, 4e-7, v), jnp.asarray(v), np.sign(v))
        assert float(actual) == pytest.approx(float(expected), rel=1e-8)
