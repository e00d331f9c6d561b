"""The actuator: amplifier, piezo with platform, friction, end-effector and stop."""

import equinox as eqx

from ..core import AbstractModel, ScalarLike, check_kind
from ..friction.base import AbstractFriction
from ..integration import Term
from ..piezo.base import AbstractPiezo
from .driven_platform import DrivenPlatform
from .parts import Amplifier, Effector, Stop


class Actuator(AbstractModel):
    """A piezo stack with platform, and an end-effector held on it by friction."""

    piezo: AbstractPiezo
    friction: AbstractFriction
    effector: Effector = Effector()
    feedback: bool = eqx.field(static=True, default=False)
    """Friction acts back on the platform (5.25); else the platform ignores it (5.27)."""
    amplifier: Amplifier | None = None
    """None: the command reaches the piezo as it is."""
    stop: Stop | None = None
    """The stop that the end-effector runs against; None: it moves freely."""
    rests_under_load: bool = eqx.field(static=True, default=False)
    """Load and tilt acted before t = 0, and all motion is counted from rest under them; else they set in at t = 0."""

    def __check_init__(self) -> None:
        check_kind("Actuator.piezo", self.piezo, AbstractPiezo)
        check_kind("Actuator.friction", self.friction, AbstractFriction)
        check_kind("Actuator.effector", self.effector, Effector, "pdssjax.Effector(mass=0.086)")

    @property
    def driven_platform(self) -> DrivenPlatform:
        """Amplifier and piezo."""
        return DrivenPlatform(self.piezo, self.amplifier)

    @property
    def initial_pull(self) -> ScalarLike:
        """The constant force on the end-effector that acted before t = 0, positive forward [N]."""
        return self.effector.pull() if self.rests_under_load else 0.0

    def reaction(self, force: Term) -> Term:
        """Force of the friction `force` on the platform, less that before t = 0 [N]; with feedback only."""
        return (force + self.initial_pull if self.rests_under_load else force) * (-1.0)

    @property
    def platform_closed(self) -> bool:
        """Whether the motion of the platform is known in closed form and friction does not act on it."""
        return self.driven_platform.closed and not self.feedback
