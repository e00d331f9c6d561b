"""A contract that every member of every family keeps, and the physics of those that are there."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from parts import AnisotropicLuGre, Bristle, LuGre, SimplifiedLuGre
from scipy.integrate import solve_ivp
from sliding import Contact, slid

from pdssjax import AbstractDrive, AbstractFriction, AbstractPiezo, Accuracy
from pdssjax.core import member, members, quantities
from pdssjax.drive.base import Segment, Wave
from pdssjax.integration.polynomials import horner
from pdssjax.integration.step_methods.taylor import resolved_radius
from pdssjax.integration.taylor_series import Series, polynomial, unknown

INTERFACES = {"drive": AbstractDrive, "piezo": AbstractPiezo, "friction": AbstractFriction}
EVERYONE = [(family, name) for family in INTERFACES for name in members(family)]
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


def moved(piezo: AbstractPiezo, segment: Segment, after: float, elapsed: float, begin) -> np.ndarray:
    """The state a time `elapsed` later, by an integrator that knows only the rate."""
    rates = lambda time, state: piezo.rate(tuple(state), segment.voltage(after + time), 0.0)
    rate = jax.jit(lambda time, state: jnp.stack([jnp.asarray(x, float) for x in rates(time, state)]))
    return solve_ivp(rate, (0.0, elapsed), begin, method="DOP853", rtol=1e-12, atol=1e-16).y[:, -1]


SEGMENTS = {
    "constant": (Segment(jnp.inf, 64.2, 0.0), 0.0),
    "slow flank": (Segment(jnp.inf, 64.2, 321.0), 0.002),
    "drop": (Segment(jnp.inf, 64.2, -5e4), 0.0),
    "wave": (Segment(jnp.inf, 64.2, 321.0, Wave(30.0, 900.0, 0.4)), 0.002),
}


@pytest.mark.parametrize("piezo", [piezo for piezo in PIEZOS if piezo.closed], ids=str)
@pytest.mark.parametrize("name", SEGMENTS)
def test_a_platform_known_in_closed_form_moves_as_its_rate_says(piezo, name):
    segment, after = SEGMENTS[name]
    begin = piezo.motion(piezo.on_segment_start(piezo.initial(), segment), segment, 0.0, after)
    end = piezo.motion(begin, segment, after, 0.0021)
    np.testing.assert_allclose(end, moved(piezo, segment, after, 0.0021, begin), rtol=1e-9, atol=1e-18)


@pytest.mark.parametrize("piezo", PIEZOS, ids=str)
def test_the_acceleration_of_the_platform_is_the_rate_of_its_velocity(piezo):
    segment, after = SEGMENTS["wave"]
    state = tuple(moved(piezo, Segment(jnp.inf, 40.0, 0.0), 0.0, 3e-4, piezo.initial()))
    for force in (0.0, 0.3):
        rates = piezo.rate(state, segment.voltage(after), force)
        rates = tuple(jnp.asarray(x, float) for x in rates)
        (_, speed), (gained, bend) = jax.jvp(piezo.platform, (state,), (rates,))
        assert float(gained) == pytest.approx(float(speed), rel=1e-9)
        free = float(piezo.acceleration(state, segment.voltage(after)))
        assert float(bend) == pytest.approx(free + force / float(piezo.mass), rel=1e-9)


@pytest.mark.parametrize("piezo", [piezo for piezo in PIEZOS if piezo.has_steady_state], ids=str)
@pytest.mark.parametrize("name", ["constant", "slow flank"])
def test_the_platform_stays_where_it_is_steady(piezo, name):
    segment, after = SEGMENTS[name]
    steady = lambda time: piezo.steady(piezo.initial(), segment, time, 0.0)
    scales = np.array([float(x) for x in piezo.error_scale()])
    away = moved(piezo, segment, after, 0.003, steady(after)) - np.array(steady(after + 0.003), float)
    assert np.abs(away * scales).max() < 1e-9 * abs(float(piezo.static_gain())) * 64.2


@pytest.mark.parametrize("law", LAWS, ids=str)
@pytest.mark.parametrize("sign", SIGNS)
def test_the_undisturbed_contact_is_in_equilibrium(law, sign):
    state, rest = law.on_reversal(law.initial(), jnp.asarray(sign)), jnp.zeros(())
    rates = law.rate(state, rest, sign)
    assert jax.tree.structure(rates) == jax.tree.structure(state) == jax.tree.structure(law.error_scale())
    assert all(jnp.shape(x) == () for x in (*state, *rates, *law.error_scale(), law.force(state, rest, sign)))
    assert all(float(length) > 0 for length in law.error_scale())
    assert all(float(rate) == 0.0 for rate in rates)
    assert all(float(guard) > 0.0 for guard in law.guards(state, rest, sign))
    ends = [float(law.breakaway_force(law.initial(), jnp.asarray(s))) for s in SIGNS]
    if law.at_rest == "set-valued":  # it holds whatever is between
        assert ends[0] > 0.0 > ends[1]
    else:
        assert ends == pytest.approx([0.0, 0.0], abs=1e-15)


@pytest.mark.parametrize("law", LAWS, ids=str)
@pytest.mark.parametrize("v", [1e-3, -1e-3])
def test_sliding_becomes_steady_and_drags_the_effector_along(law, v):
    state = slid(law, 2e-6 if isinstance(law, Bristle) else 4e-5, v)
    guards, rates = (hook(state, jnp.asarray(v), np.sign(v)) for hook in (law.guards, law.rate))
    assert all(float(guard) >= 0.0 for guard in guards)
    assert float(law.force(state, jnp.asarray(v), np.sign(v))) * v > 0
    if not isinstance(law, Bristle):  # whose bonds stretch and snap for ever
        assert all(abs(float(r * length)) < 1e-5 * abs(v) for r, length in zip(rates, law.error_scale(), strict=True))


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_the_actuator_may_ask_a_contact_at_rest_for_anything_and_gets_numbers(law):
    for state in (law.initial(), *(slid(law, 1e-6, v) for v in (1e-3, -1e-3))):
        for sign in (0.0, 2.0, *SIGNS):
            hooks = (law.rate, law.guards)
            given = [x for hook in hooks for x in hook(state, jnp.zeros(()), sign)]
            given += [law.force(state, jnp.zeros(()), sign), law.breakaway_force(state, jnp.asarray(sign))]
            assert np.isfinite(np.array(given, float)).all()


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_a_step_resolves_what_a_law_makes_of_the_velocity(law):
    """As the reason says: a curve in v needs `extra_error_terms` and a guard that no step can pass unseen."""
    found = misfit(law)
    reason = f"steps do not resolve the law's curve in v: see AbstractStribeckBristle; {found}"
    assert found.force < 2e-6, reason
    assert found.rate < 4e-6, reason


class NoCurve(LuGre):
    """LuGre that does not tell of its curve."""

    def extra_error_terms(self, state, v, sign):
        return ()


class NoGuard(LuGre):
    """LuGre that lets a step that brakes run past the curve."""

    def guards(self, state, v, sign):
        return ()


@pytest.mark.parametrize("law", [NoCurve(), NoGuard()], ids=str)
def test_a_step_that_passes_a_curve_unseen_is_found(law):
    found = misfit(law)
    assert found.force > 2e-6 or found.rate > 4e-6


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_plausible_ranges_are_legal_and_name_parameters(law):
    declared = quantities(type(law))
    ranges = law.search_ranges(0.086, 100.0, 6736.0)
    assert set(ranges) == set(declared)
    for name, (low, high) in ranges.items():
        assert max(declared[name].low, 0.0) < low < high <= declared[name].high


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
def test_a_contact_in_equilibrium_carries_the_force_asked_for_as_it_says(law, force):
    state, _ = law.equilibrium_state(law.initial(), jnp.asarray(force))
    if law.at_rest == "set-valued":
        assert float(law.breakaway_force(state, -1.0)) < force < float(law.breakaway_force(state, 1.0))
    else:
        carried = {"elastic": force, "viscous": 0.0}[law.at_rest]
        assert float(law.force(state, jnp.zeros(()), np.sign(force))) == pytest.approx(carried, rel=1e-12)
    again, displacement = law.equilibrium_state(state, jnp.asarray(force))
    np.testing.assert_allclose(again, state, rtol=1e-12, atol=1e-18)
    assert float(displacement) == pytest.approx(0.0, abs=1e-18)


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


SPEEDS = np.array([0.0, 1e-5, 3e-4, 2e-3, 9e-3, 4e-2, 0.1])
"""Velocities [m/s] at which steps begin, in either direction; far above 0 a contact slides steadily there."""
SPEED_CHANGES = np.array([-300.0, -20.0, -1.0, 1.0, 20.0, 300.0])
"""By how much the speed changes [m/s2]."""
LONGEST = 2e-3
"""Of a step [s]."""
PARTS = np.linspace(0.0, 1.0, 41)
"""Where in a step its guards, its force and its rates are looked at."""


class Misfit(NamedTuple):
    """How far series are from the law where it is worst."""

    force: float
    """[N]"""
    rate: float
    """Of a state, as a displacement a unit of the way that is slid [1]."""
    where: str
    """Velocity and slope of that step."""


def misfit(law: AbstractFriction) -> Misfit:
    """The worst of all steps that begin at `SPEEDS` and `SPEED_CHANGES`, in both directions."""
    order = Accuracy().method.order  # pyright: ignore[reportAttributeAccessIssue]
    v, slope, sign, state = _begins(law)
    room = np.where(slope * sign < 0.0, np.minimum(np.abs(v / slope), LONGEST), LONGEST)
    series = _expanded(law, v, slope, sign, state, order)
    contact_state, motion = [polynomial(c) for c in series], polynomial([v, slope])
    extra = law.extra_error_terms(tuple(contact_state), motion, sign)
    radius = np.minimum(room, _resolved(law, series, [[e[k] for k in range(order + 1)] for e in extra]))
    time = PARTS * radius[:, None]
    at = lambda given: _values(given, time, order)
    open_until = np.full(v.shape, PARTS.size)
    for guard in law.guards(tuple(contact_state), motion, sign):
        # At its begin a guard may be zero: there the last event was.
        falls = (at(guard)[:, 1:] < 0.0) if isinstance(guard, Series) else np.zeros(time[:, 1:].shape, bool)
        open_until = np.where(falls.any(axis=1), np.minimum(open_until, 1 + falls.argmax(axis=1)), open_until)
    inside = np.arange(PARTS.size) < open_until[:, None]
    speed = v[:, None] + slope[:, None] * time
    then, way = tuple(at(m) for m in contact_state), sign[:, None]
    off = np.abs(at(law.force(tuple(contact_state), motion, sign)) - np.asarray(law.force(then, speed, way))) * inside
    drift = np.zeros(())
    for given, exact, unit in zip(
        law.rate(tuple(contact_state), motion, sign), law.rate(then, speed, way), law.error_scale(), strict=True
    ):
        rate_error = np.abs(at(given) - np.asarray(exact)) * float(unit) * inside
        drift = np.maximum(drift, rate_error / np.abs(speed).max(axis=1, keepdims=True))
    worst = int(off.max(axis=1).argmax())
    return Misfit(float(off.max()), float(np.max(drift)), f"{v[worst]:g} m/s, {slope[worst]:g} m/s2")


def _begins(law):
    """Velocity, its slope, sign and state of the contact of every step, side by side."""
    contact, lanes = Contact(law), []
    for sign in (1.0, -1.0):
        for speed in SPEEDS:
            v = sign * speed
            m = contact.on_reversal(contact.initial, sign)
            if speed >= 3e-4 and not isinstance(law, Bristle):  # whose bonds stretch and snap for ever
                m = np.asarray(slid(law, 1e-5, v), float)
            m = contact.begun(m, v, sign)
            lanes += [(v, sign * slope, sign, m) for slope in SPEED_CHANGES if speed > 0.0 or slope > 0.0]
    v, slope, sign = (np.array([lane[i] for lane in lanes]) for i in range(3))
    return v, slope, sign, list(np.array([lane[3] for lane in lanes]).T) if contact.initial.size else []


def _expanded(law, v, slope, sign, state, order):
    """The coefficients of every state, in time [s], each with all steps side by side."""
    known = [unknown(np.asarray(x)) for x in state]
    rates = law.rate(tuple(known), polynomial([v, slope]), sign)
    for k in range(order):
        for series, rate in zip(known, rates, strict=True):
            given = rate[k] if isinstance(rate, Series) else rate if k == 0 else 0
            series.append(np.asarray(given) / (k + 1.0) + np.zeros(v.shape))
    return [[series[k] for k in range(order + 1)] for series in known]


def _resolved(law, series, extra):
    """How long the steps may be [s] so that the last coefficients stay below the tolerance."""
    tolerance, units = Accuracy().tolerance, [float(unit) for unit in law.error_scale()]
    length = np.asarray(LONGEST)
    for rows, scales in ((series, units), (extra, [1.0] * len(extra))):
        if rows:
            found = np.asarray(resolved_radius(rows, [scale / tolerance for scale in scales]))
            length = np.minimum(length, found)
    return length


def _values(given, time, order) -> np.ndarray:
    """A series, or numbers, at `time` [s], shape (steps, parts)."""
    if not isinstance(given, Series):
        return np.zeros(time.shape) + np.reshape(np.asarray(given, float), (-1, 1) if np.ndim(given) else ())
    column = lambda c: np.reshape(np.asarray(c, float), (-1, 1) if np.ndim(c) else ())
    return np.asarray(horner([column(given[k]) for k in range(order + 1)], time))
