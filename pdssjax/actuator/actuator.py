"""The actuator: what drives the platform, what it rides on, and what holds the two together."""

import equinox as eqx

from .amplifier import Amplifier
from .effector import Effector, Stop
from .friction.base import AbstractFriction
from .piezo.base import AbstractPiezo
from .stage import Stage


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
    """What the end-effector runs against; None: it walks freely."""

    @property
    def stage(self) -> Stage:
        """Amplifier and piezo."""
        return Stage(self.piezo, self.amplifier)
