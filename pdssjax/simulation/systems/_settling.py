"""When an actuator has settled: nothing is left but the steady creep of the platform, and the contact rides along."""

import jax
import jax.numpy as jnp

from ...actuator import Actuator, DrivenPlatformState, chosen
from ...core import Scalar, ScalarLike, Truth
from ...drive.base import Segment
from ...friction.base import AbstractFriction
from ...integration import ROUNDING, constant
from ._sensed_motion import SensedMotion
from ._stick_slip_state import ADVANCING, RETREATING, STUCK, State
from ._sticking import sticking_margins

_CARRIED = 1e-9
"""Part of a constant force by which rounding may miss it."""
_SHAKEN = 8.0
"""Speed that a ringing platform cannot turn round, in units of its own."""
_ANGLE = 150.0
"""Angle [rad] from which on the derivative of a phase is what is left the longest."""


def is_settled(
    sensed: SensedMotion, segment: Segment, t_local: ScalarLike, x: State, mode: Scalar, tolerance: ScalarLike
) -> Truth:
    """Whether the deviations from the steady solution are together below `tolerance` [m].

    A sliding contact has settled once that holds; a stuck one already when the ringing that is
    left in the platform can no longer free it, and an elastic one in equilibrium once nothing rings: at once where the
    drive waits.
    """
    actuator = sensed.actuator
    if segment.wave is not None or not actuator.piezo.has_steady_state:
        return jnp.zeros((), bool)
    ringing = actuator.driven_platform.ringing(segment, t_local, x.driven, _settled_friction(actuator))
    contact, displacement = _equilibrium_state(actuator, x, mode)
    lengths = actuator.friction.error_scale()
    of_contact = [jnp.abs(a - b) * c for a, b, c in zip(x.contact_state, contact, lengths, strict=True)]
    steady_lag, metres = _steady_lag(sensed, segment, t_local, x), sensed.state_scale()
    of_sensor = [jnp.abs(a - b) * metres for a, b in zip(x.sensor_lag, steady_lag, strict=True)]
    left, of_derivatives = _remaining_motion(actuator, t_local, x.v, ringing, [*of_contact, *of_sensor])
    still = (of_derivatives < tolerance) | (left < ROUNDING)
    still &= _holds(actuator, contact, mode) | _creeps_in(actuator, contact, displacement, x.v, mode, ringing)
    upper, lower = (constant(margin) for margin in sticking_margins(actuator, segment, t_local, x))
    shake = 4.0 * actuator.effector.mass * actuator.piezo.frequency_scale() ** 2 * ringing
    safe = jnp.minimum(upper, lower) > shake
    if x.sensor_lag or not _may_ring_on(actuator):
        safe &= ringing < tolerance
    for distance in of_sensor:
        safe &= distance < tolerance
    # An elastic contact in equilibrium has no margin, and any ringing would free it.
    safe |= left < ROUNDING
    # While in contact with a platform that creeps on, the stop's force keeps rising: never settled.
    for in_contact in x.in_contact:
        still, safe = still & (in_contact == 0.0), safe & (in_contact == 0.0)
    return jnp.where(jnp.abs(mode) == 1.0, still, (mode == STUCK) & safe)


def _holds(actuator: Actuator, contact: tuple[Scalar, ...], mode: Scalar) -> Truth:
    """Whether a `contact` that carries the constant force in this mode drives a reversal back, or lets it be.

    Where the force of the deflection reading jumps the other way the motion is driven on, ever faster.
    """
    pull = jnp.asarray(actuator.effector.pull(), float)
    reversed_force = jnp.asarray(actuator.friction.force(contact, jnp.zeros_like(pull), -mode), float)
    return (reversed_force + pull) * mode <= _CARRIED * jnp.abs(pull)


def _creeps_in(
    actuator: Actuator, contact: tuple[Scalar, ...], displacement: Scalar, v: Scalar, mode: Scalar, ringing: Scalar
) -> Truth:
    """Whether the contact comes to rest without a reversal: overdamped, slowly, faster than it is shaken.

    **Arguments:** the `contact` state at rest, the `displacement` [m] to there and the velocity [m/s].
    """
    law, mass = actuator.friction, actuator.effector.mass
    resisting = lambda v: jnp.asarray(law.force(contact, v, mode), float)
    _, damping = jax.jvp(resisting, (jnp.zeros_like(v),), (jnp.ones_like(v),))
    half, squared = damping / (2.0 * mass), _stiffness(law, contact, mode) / mass
    fast = half + jnp.sqrt(jnp.maximum(half**2 - squared, 0.0))
    slowly = (half**2 > squared) & (fast * displacement * v > v**2)
    return slowly & (jnp.abs(v) > _SHAKEN * actuator.piezo.frequency_scale() * ringing)


def project_to_steady(sensed: SensedMotion, segment: Segment, t_local: ScalarLike, x: State, mode: Scalar) -> State:
    """The state projected onto the steady solution; a contact that slid recovers its elastic displacement.

    One that is in equilibrium stays so, whatever the constant force: of a force of zero it has the derivative.
    """
    actuator = sensed.actuator
    contact, displacement = _equilibrium_state(actuator, x, mode)
    recovers = (jnp.abs(mode) == 1.0) | (jnp.abs(displacement) < ROUNDING)
    return x._replace(
        d=jnp.where(recovers, x.d + displacement, x.d),
        v=jnp.zeros_like(x.v),
        driven=x.driven if _may_ring_on(actuator) else _steady_platform(actuator, segment, t_local, x),
        contact_state=chosen(recovers, contact, x.contact_state),
        sensor_lag=_steady_lag(sensed, segment, t_local, x),
    )


def _may_ring_on(actuator: Actuator) -> bool:
    """The platform may ring on once the contact has settled: it is known in closed form, and meets nothing.

    What is stepped of it then is a straight line, which would tell a stop in front too early or too late.
    """
    return actuator.platform_closed and actuator.stop is None


def slowest_frequency(actuator: Actuator) -> Scalar:
    """The slowest of the platform's and the contact's frequencies [rad/s]: velocity times 1/it is displacement."""
    slowest = jnp.asarray(actuator.piezo.frequency_scale(), float)
    for of_contact in _contact_frequencies(actuator):
        slowest = jnp.where(of_contact > 0.0, jnp.minimum(slowest, of_contact), slowest)
    return slowest


def _contact_frequencies(actuator: Actuator) -> tuple[Scalar, Scalar]:
    """Natural frequency of the end-effector on the contact [rad/s], advancing and retreating; 0 if not elastic."""
    unstretched, mass = actuator.friction.initial(), actuator.effector.mass
    of = lambda sign: jnp.sqrt(jnp.abs(_stiffness(actuator.friction, unstretched, jnp.asarray(sign))) / mass)
    return of(ADVANCING), of(RETREATING)


def _stiffness(law: AbstractFriction, contact: tuple[Scalar, ...], sign: Scalar) -> Scalar:
    """Derivative of the force at rest by the displacement [N/m]."""
    still = jnp.zeros(())
    if not contact:
        return still
    stretched = lambda v: tuple(jnp.asarray(rate, float) for rate in law.rate(contact, v, sign))
    elastic = lambda contact: jnp.asarray(law.force(contact, still, sign), float)
    _, rates = jax.jvp(stretched, (still,), (jnp.ones(()),))
    return jax.jvp(elastic, (contact,), (rates,))[1]


def _remaining_motion(
    actuator: Actuator, t_local: ScalarLike, v: Scalar, ringing: Scalar, of_contact_and_sensor: list[Scalar]
) -> tuple[Scalar, Scalar]:
    """What is left of a sliding contact's motion in a segment [m], and what of its derivatives, as a motion [m].

    What rings has a phase, and the derivative of that by the logarithm of the frequency is the angle it has turned.
    """
    platform, slowest = jnp.asarray(actuator.piezo.frequency_scale(), float), slowest_frequency(actuator)
    of_contact = sum([2.0 * jnp.abs(v) / slowest, *of_contact_and_sensor])
    # A contact slower than the platform is displaced by more than it rings: by inertia over stiffness.
    of_platform = (platform / slowest) ** 2 * ringing
    phase = lambda frequency: jnp.maximum(1.0, frequency * t_local / _ANGLE)
    fastest = jnp.maximum(*_contact_frequencies(actuator))
    return of_contact + of_platform, of_contact * phase(fastest) + of_platform * phase(platform)


def _steady_platform(
    actuator: Actuator, segment: Segment, t_local: ScalarLike, x: State
) -> DrivenPlatformState[Scalar]:
    return actuator.driven_platform.steady(segment, t_local, x.driven, _settled_friction(actuator))


def _steady_lag(sensed: SensedMotion, segment: Segment, t_local: ScalarLike, x: State) -> tuple[Scalar, ...]:
    if not x.sensor_lag:
        return ()
    # With a stop it is the force shown: none is left once nothing touches.
    if sensed.actuator.stop is not None:
        return tuple(jnp.zeros_like(shown) for shown in x.sensor_lag)
    steady = _steady_platform(sensed.actuator, segment, t_local, x)
    return sensed.sensor.steady(x.sensor_lag, sensed.actuator.driven_platform.platform(steady)[1])


def _settled_friction(actuator: Actuator) -> ScalarLike:
    """The friction force [N] on the platform once all is settled, with feedback."""
    return actuator.effector.pull() - actuator.initial_pull if actuator.feedback else 0.0


def _equilibrium_state(actuator: Actuator, x: State, mode: Scalar) -> tuple[tuple[Scalar, ...], Scalar]:
    """The state in which the contact at rest carries the constant force, and the displacement [m] on the way there."""
    force = -1.0 * jnp.asarray(actuator.effector.pull(), float)
    return actuator.friction.equilibrium_after(x.contact_state, force, mode)
