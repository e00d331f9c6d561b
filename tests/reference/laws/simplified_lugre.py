"""Simplified LuGre friction (5.20, 5.21), from its equations alone."""

import dataclasses

from tests.reference.independent_friction import Law


@dataclasses.dataclass(frozen=True)
class SimplifiedLuGre(Law):
    sigma0: float = 1e6
    sigma1: float = 45.0
    f_ss: float = 0.65
    atol = (1e-19,)

    def flow(self, z, form, d, v, way):
        return [v - self.sigma0 * way * v * z[0] / self.f_ss]

    def force(self, z, form, d, v, way):
        return self.sigma0 * z[0] + self.sigma1 * self.flow(z, form, d, v, way)[0]

    def resting(self, force):
        return [force / self.sigma0], self.born()


CASES = {"": SimplifiedLuGre()}
