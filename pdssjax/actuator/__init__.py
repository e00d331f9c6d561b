"""The parts of a rig: amplifier, driven platform, end-effector, stop, sensor, and what they make together.

Imports the families `drive`, `piezo` and `friction` by their interfaces, and the rooms below them.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .actuator import Actuator as Actuator
    from .driven_platform import (
        DrivenPlatform as DrivenPlatform,
        DrivenPlatformState as DrivenPlatformState,
        chosen as chosen,
    )
    from .parts import (
        GRAVITY as GRAVITY,
        IDEAL as IDEAL,
        PARTS as PARTS,
        Amplifier as Amplifier,
        Effector as Effector,
        Sensor as Sensor,
        Stop as Stop,
        ZeroOrderHold as ZeroOrderHold,
    )
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(__name__)
