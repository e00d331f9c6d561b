"""The end-effector: a mass that rides on the platform, held by friction alone (5.23).

m_e x_e'' = F + load + m_e g sin(tilt) [ - what it meets in front of it ]

Load and tilt set in at t = 0: until then the contact carries nothing, and an elastic one yields and rings then.
With `rests_under_load` of the actuator they acted before, and it has come to rest under them.
"""

import jax.numpy as jnp

from ..core import AbstractModel, Scalar, quantity

GRAVITY = 9.80665
"""Standard gravity g [m/s2]."""


class Effector(AbstractModel):
    """Mass, external force, and the tilt of the platform on which it rides."""

    mass: float = quantity(0.086, "kg")
    """Moving mass m_e [kg]."""
    load: float = quantity(0.0, "N", positive=False, optional=True)
    """Constant force on the end-effector, positive forward [N]."""
    tilt: float = quantity(0.0, "rad", positive=False, low=-1.5, high=1.5, optional=True)
    """Angle by which the forward direction points downhill [rad]."""

    def pull(self) -> Scalar:
        """All constant force on the end-effector, positive forward [N]."""
        return self.load + self.mass * GRAVITY * jnp.sin(jnp.asarray(self.tilt, float))
