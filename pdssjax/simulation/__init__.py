"""Hybrid systems made of an actuator, and the trajectories that integration makes of them.

`systems` holds one system a file.  Imports `actuator` and the rooms below it.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .systems.platform_only import PlatformOnly as PlatformOnly
    from .systems.prescribed_motion import PrescribedMotion as PrescribedMotion
    from .systems.stick_slip import StickSlip as StickSlip
    from .trajectory import contact_force as contact_force
    from .trajectory import displacements as displacements
    from .trajectory import measured as measured
    from .trajectory import platform as platform
    from .trajectory import simulate as simulate
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(
        __name__,
        {
            "systems.platform_only": ["PlatformOnly"],
            "systems.prescribed_motion": ["PrescribedMotion"],
            "systems.stick_slip": ["StickSlip"],
            "trajectory": ["contact_force", "displacements", "measured", "platform", "simulate"],
        },
    )
