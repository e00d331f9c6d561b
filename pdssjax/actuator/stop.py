"""The end-effector: a mass that rides on the platform, held by friction alone (5.23).

m_e x_e'' = F + load + m_e g sin(tilt) [ - what it meets in front of it ]
"""

import equinox as eqx
import jax.numpy as jnp

from .quantity import quantity

GRAVITY = 9.80665
"""Standard gravity g [m/s2]."""


class Effector(eqx.Module):
    """Mass, external force, and the tilt of the platform on which it rides."""

    mass: float = quantity(0.086, "kg")
    """Moving mass m_e [kg]."""
    load: float = quantity(0.0, "N", positive=False, optional=True)
    """Constant force on the end-effector, positive forward [N]."""
    tilt: float = quantity(0.0, "rad", positive=False, low=-1.5, high=1.5, optional=True)
    """Angle by which the forward direction points downhill [rad]."""

    def pull(self):
        """All constant force on the end-effector, positive forward [N]."""
        return self.load + self.mass * GRAVITY * jnp.sin(jnp.asarray(self.tilt, float))


class Stop(eqx.Module):
    """A force sensor in the way: it can be pushed, but does not pull.

    P = k depth (1 + d depth'), which loses energy and yet begins and ends at zero force
    (K. H. Hunt and F. R. E. Crossley, J. Applied Mechanics 42(2), 1975).
    """

    stiffness: float = quantity(1e5, "N/m")
    """Contact stiffness k of the sensor with its mount [N/m]."""
    dissipation: float = quantity(10.0, "s/m", positive=False, low=0.0, optional=True)
    """Share d of the force that a unit of speed adds [s/m]; below the reciprocal of the fastest withdrawal."""
    gap: float = quantity(0.0, "m", positive=False, low=0.0, optional=True)
    """How far the end-effector goes before it meets the sensor [m]."""

    def push(self, x, speed):
        """Force [N] on the sensor where the end-effector touches it, at `x` [m] and `speed` [m/s]."""
        return self.depth(x) * self.stiffness * (speed * self.dissipation + 1.0)

    def depth(self, x):
        """How far [m] the end-effector at `x` [m] has pushed the sensor; negative before it touches."""
        return x - self.gap
