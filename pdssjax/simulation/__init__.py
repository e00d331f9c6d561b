"""Hybrid systems made of an actuator, and the trajectories that integration makes of them.

`systems` holds one system a file.  Imports `actuator` and the rooms below it.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .flat_vector_field import vector_field as vector_field
    from .grazing_reversals import grazing as grazing
    from .grazing_reversals import turns as turns
    from .observation import Inside as Inside
    from .observation import Observation as Observation
    from .observation import observe as observe
    from .sensor_output import ACCELERATION as ACCELERATION
    from .sensor_output import DISPLACEMENT as DISPLACEMENT
    from .sensor_output import FRICTION_FORCE as FRICTION_FORCE
    from .sensor_output import STOP_FORCE as STOP_FORCE
    from .sensor_output import VELOCITY as VELOCITY
    from .sensor_output import Output as Output
    from .sensor_output import sensor_samples as sensor_samples
    from .sensor_output import why_failed as why_failed
    from .steady_cycles import steady_cycle as steady_cycle
    from .systems._stick_slip_state import StickSlipState as StickSlipState
    from .systems.platform_only import PlatformOnly as PlatformOnly
    from .systems.prescribed_motion import PrescribedMotion as PrescribedMotion
    from .systems.stick_slip import StickSlip as StickSlip
    from .trajectory import TRAJECTORY_UNITS as TRAJECTORY_UNITS
    from .trajectory import Trajectory as Trajectory
    from .trajectory import displacements as displacements
    from .trajectory import platform as platform
    from .trajectory import simulate as simulate
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(
        __name__,
        {
            "grazing_reversals": ["grazing", "turns"],
            "observation": ["Inside", "Observation", "observe"],
            "sensor_output": [
                "ACCELERATION",
                "DISPLACEMENT",
                "FRICTION_FORCE",
                "Output",
                "STOP_FORCE",
                "VELOCITY",
                "sensor_samples",
                "why_failed",
            ],
            "steady_cycles": ["steady_cycle"],
            "systems._stick_slip_state": ["StickSlipState"],
            "systems.platform_only": ["PlatformOnly"],
            "systems.prescribed_motion": ["PrescribedMotion"],
            "systems.stick_slip": ["StickSlip"],
            "trajectory": ["TRAJECTORY_UNITS", "Trajectory", "displacements", "platform", "simulate"],
            "flat_vector_field": ["vector_field"],
        },
    )
