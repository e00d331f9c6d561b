"""LuGre friction, from its equations alone."""

import dataclasses

from tests.reference.independent_friction import Law, curve


@dataclasses.dataclass(frozen=True)
class LuGre(Law):
    sigma0: float = 1e6
    sigma1: float = 45.0
    sigma2: float = 2.0
    f_c: float = 0.55
    f_s: float = 0.65
    v_s: float = 1e-3
    atol = (1e-19,)

    def flow(self, z, form, d, v, way):
        # Smooth beyond the end of a slide, too, where a step runs on before the event is found: not |v|.
        return [v - self.sigma0 * way * v * z[0] / curve(v, self.f_c, self.f_s, self.v_s)]

    def force(self, z, form, d, v, way):
        return self.sigma0 * z[0] + self.sigma1 * self.flow(z, form, d, v, way)[0] + self.sigma2 * v

    def resting(self, force):
        return [force / self.sigma0], self.born()


CASES = {"": LuGre(), "wide curve": LuGre(v_s=5e-3, f_s=0.75, sigma2=0.0)}
