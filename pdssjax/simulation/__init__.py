"""Hybrid systems made of an actuator, and the trajectories that integration makes of them.

`systems` holds one system a file.  Imports `actuator` and the rooms below it.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .flat_vector_field import vector_field as vector_field
    from .grazing_reversals import grazing as grazing, turns as turns
    from .sensor_output import (
        ACCELERATION as ACCELERATION,
        DISPLACEMENT as DISPLACEMENT,
        FRICTION_FORCE as FRICTION_FORCE,
        STOP_FORCE as STOP_FORCE,
        VELOCITY as VELOCITY,
        Inside as Inside,
        Observation as Observation,
        Output as Output,
        Scratch as Scratch,
        observe as observe,
        samples_and_slopes as samples_and_slopes,
        scratch as scratch,
        sensor_samples as sensor_samples,
        why_failed as why_failed,
    )
    from .steady_cycles import steady_cycle as steady_cycle
    from .systems._stick_slip_state import StickSlipState as StickSlipState
    from .systems.platform_only import PlatformOnly as PlatformOnly
    from .systems.prescribed_motion import PrescribedMotion as PrescribedMotion
    from .systems.stick_slip import StickSlip as StickSlip
    from .trajectory import (
        TRAJECTORY_UNITS as TRAJECTORY_UNITS,
        Trajectory as Trajectory,
        displacements as displacements,
        platform as platform,
        simulate as simulate,
    )
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(__name__)
