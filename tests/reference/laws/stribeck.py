"""Coulomb, Stribeck and viscous friction, from its equations alone."""

import dataclasses

from tests.reference.independent_friction import Law, curve


@dataclasses.dataclass(frozen=True)
class Stribeck(Law):
    sticks = True

    f_c: float = 0.55
    f_s: float = 0.65
    v_s: float = 1e-3
    sigma2: float = 2.0
    delta: float = 2.0

    def level(self, v):
        """The force against a slide without its viscous part [N]."""
        return curve(v, self.f_c, self.f_s, self.v_s, self.delta)

    def force(self, z, form, d, v, way):
        return way * self.level(v) + self.sigma2 * v


CASES = {"": Stribeck(), "tustin": Stribeck(delta=1.0)}
