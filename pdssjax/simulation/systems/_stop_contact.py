"""The stop in front of the end-effector: what pushes it, and when the two touch.

The state has a flag for it, 1 while they touch; without a stop there is no flag, and no force.
"""

from ...actuator import Actuator
from ...integration import Term
from ._stick_slip_state import StickSlipState


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
