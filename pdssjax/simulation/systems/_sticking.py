"""Forces on an end-effector besides friction, and a contact at v = 0: what keeps it there, and the mode that follows.

The state has a flag for a stop in front of the end-effector, 1 while they touch; without a stop there is no flag.

F* is the friction force that keeps v = 0, and F(-), F(+) are the forces beyond which the contact lets go.
While F(-) <= F* <= F(+) it sticks, else v takes the sign that its acceleration has on the side it moves to
(A. F. Filippov, Differential Equations with Discontinuous Righthand Sides, Kluwer 1988).
"""

from typing import cast

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...actuator import Actuator, DrivenPlatformState
from ...core import Scalar, ScalarLike
from ...drive.base import Segment
from ...integration import LOOK_AHEAD, Term, constant
from ._stick_slip_state import ADVANCING, RETREATING, STUCK, State, StickSlipState


def push_on_stop(actuator: Actuator, x: StickSlipState[Term]) -> Term:
    """Force [N] on the stop of an actuator that has one; 0 while the end-effector does not touch it."""
    assert actuator.stop is not None
    y, w = actuator.driven_platform.platform(x.driven)
    return x.in_contact[0] * actuator.stop.push(y - x.d, w - x.v)


def stop_guards(actuator: Actuator, x: StickSlipState[Term]) -> tuple[Term, ...]:
    """Positive while the end-effector goes on touching the stop, or not touching it [m]; none without a stop."""
    if actuator.stop is None:
        return ()
    y, _ = actuator.driven_platform.platform(x.driven)
    return (actuator.stop.depth(y - x.d) * (x.in_contact[0] * 2.0 - 1.0),)


def external_force(actuator: Actuator, x: StickSlipState[Term]) -> Term:
    """Every force on the end-effector but friction [N]: its load, gravity, and the stop."""
    pull = actuator.effector.pull()
    return pull if actuator.stop is None else push_on_stop(actuator, x) * (-1.0) + pull


def sticking_force(actuator: Actuator, free_acceleration: Term, x: StickSlipState[Term]) -> Term:
    """F* [N] where the platform would accelerate by `free_acceleration` [m/s2] without friction."""
    if actuator.feedback and actuator.rests_under_load:
        free_acceleration = free_acceleration + actuator.reaction(0.0) * (1.0 / actuator.piezo.mass)
    inertial = free_acceleration * actuator.effector.mass - external_force(actuator, x)
    if not actuator.feedback:
        return inertial
    # So written that a stack of infinite mass, which no force moves, has its limit.
    return inertial * (1.0 / (1.0 + actuator.effector.mass / actuator.piezo.mass))


def sticking_margins(actuator: Actuator, segment: Segment, t_local: Term, x: StickSlipState[Term]) -> tuple[Term, Term]:
    """How far F* is below F(+) and above F(-) [N]: both positive while the contact sticks."""
    sticking = sticking_force(actuator, actuator.driven_platform.acceleration(segment, t_local, x.driven), x)
    contact = tuple(cast("Scalar", constant(m)) for m in x.contact_state)  # as it is while v = 0
    upper = actuator.friction.breakaway_force(contact, ADVANCING) - sticking
    return upper, sticking - actuator.friction.breakaway_force(contact, RETREATING)


def mode_from_rest(actuator: Actuator, segment: Segment, t_local: ScalarLike, x: State, ended: ScalarLike) -> Scalar:
    """The mode that begins at v = 0, ties broken by looking ahead; `ended` is the one that ended there, 0 for none."""
    driven_platform, zero, unit = actuator.driven_platform, jnp.zeros_like(x.v), jnp.ones_like(x.v)
    sticking = sticking_force(actuator, driven_platform.acceleration(segment, t_local, x.driven), x)
    reaction = actuator.reaction(sticking) if actuator.feedback else 0.0
    rates = driven_platform.rate(segment, t_local, x.driven, reaction, 1.0)
    along = lambda elapsed: jax.tree.map(lambda a, b: a + elapsed * b, x.driven, rates)

    def margins(elapsed: Scalar, bends: DrivenPlatformState[Scalar] | None = None) -> Float[Array, " 2"]:
        driven = along(elapsed)
        if bends is not None:
            driven = jax.tree.map(lambda a, b: a + 0.5 * elapsed**2 * b, driven, bends)
        found = sticking_margins(actuator, segment, t_local + elapsed, x._replace(driven=driven))
        return jnp.stack([constant(m) for m in found])

    now, rate = jax.jvp(margins, (zero,), (unit,))
    ahead = now + LOOK_AHEAD * rate
    if actuator.amplifier is not None:
        # Behind an amplifier a corner of the drive shows in the bend of the margins first.
        numbers = lambda tree: jax.tree.map(lambda number: jnp.asarray(number, float), tree)
        rates_along = lambda e: numbers(driven_platform.rate(segment, t_local + e, along(e), reaction, 1.0))
        _, bends = jax.jvp(rates_along, (zero,), (unit,))
        margins_rate = lambda e: jax.jvp(lambda e: margins(e, bends), (e,), (unit,))[1]
        ahead = ahead + 0.5 * LOOK_AHEAD**2 * jax.jvp(margins_rate, (zero,), (unit,))[1]
    upper, lower = ahead
    # An unstable equilibrium (of the deflection reading under some loads) is entered and left in the sliding mode in
    # which the friction balances the load.
    pull = jnp.asarray(actuator.effector.pull(), float)
    missing = lambda sign: jnp.abs(actuator.friction.breakaway_force(x.contact_state, sign) + pull)
    crept_in = jnp.where(missing(ADVANCING) <= missing(RETREATING), ADVANCING, RETREATING)
    unstable_branch = jnp.where(ended == 0.0, crept_in, -ended)
    freed = jnp.where(upper < 0, ADVANCING, RETREATING)
    # What came to v = 0 from one side cannot leave on it: then rounding alone decides, and it goes through.
    freed = jnp.where(freed == ended, -freed, freed)
    sticks = (upper >= 0) & (lower >= 0)
    return jnp.where(sticks, STUCK, jnp.where((upper < 0) & (lower < 0), unstable_branch, freed))
