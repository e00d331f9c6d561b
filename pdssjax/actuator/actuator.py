"""The actuator: what drives the platform, what it rides on, and what holds the two together."""

import equinox as eqx

from ..core import described
from ..friction.base import AbstractFriction
from ..piezo.base import AbstractPiezo
from .amplifier import Amplifier
from .driven_platform import DrivenPlatform
from .effector import Effector
from .stop import Stop


class Actuator(eqx.Module):
    """A piezo stack with platform, and an end-effector held on it by friction."""

    piezo: AbstractPiezo
    friction: AbstractFriction
    effector: Effector = Effector()
    feedback: bool = eqx.field(static=True, default=False)
    """Friction acts back on the platform (5.25); else the platform ignores it (5.27)."""
    amplifier: Amplifier | None = None
    """None: the command reaches the piezo as it is."""
    stop: Stop | None = None
    """What the end-effector runs against; None: it moves freely."""

    def __repr__(self) -> str:
        return described(self)

    @property
    def driven_platform(self) -> DrivenPlatform:
        """Amplifier and piezo."""
        return DrivenPlatform(self.piezo, self.amplifier)

    @property
    def platform_closed(self) -> bool:
        """The motion of the platform is known in closed form, and friction leaves it alone."""
        return self.driven_platform.closed and not self.feedback
