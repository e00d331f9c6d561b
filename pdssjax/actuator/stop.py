"""A force sensor in the way of the end-effector."""

from ..core import AbstractModel, quantity
from ..integration import Term


class Stop(AbstractModel):
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

    def push(self, x: Term, speed: Term) -> Term:
        """Force [N] on the sensor where the end-effector touches it, at `x` [m] and `speed` [m/s]."""
        return self.depth(x) * self.stiffness * (speed * self.dissipation + 1.0)

    def depth(self, x: Term) -> Term:
        """How far [m] the end-effector at `x` [m] has pushed the sensor; negative before it touches."""
        return x - self.gap
