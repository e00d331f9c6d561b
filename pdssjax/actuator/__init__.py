"""The parts of a rig: amplifier, driven platform, end-effector, stop, sensor, and what they make together.

Imports the families `drive`, `piezo` and `friction` by their interfaces, and the rooms below them.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .actuator import Actuator as Actuator
    from .amplifier import Amplifier as Amplifier
    from .driven_platform import (
        DrivenPlatform as DrivenPlatform,
        DrivenPlatformState as DrivenPlatformState,
        chosen as chosen,
    )
    from .effector import GRAVITY as GRAVITY, Effector as Effector
    from .part_names import PART_NAMES as PART_NAMES
    from .parts import PARTS as PARTS
    from .sensor import IDEAL as IDEAL, Sensor as Sensor
    from .stop import Stop as Stop
    from .zero_order_hold import ZeroOrderHold as ZeroOrderHold
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(__name__)
