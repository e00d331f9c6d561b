"""Dahl friction, from its equations alone."""

import dataclasses
import math

from tests.reference.independent_friction import Law


@dataclasses.dataclass(frozen=True)
class Dahl(Law):
    """Form: displacement and force [N] at the last reversal."""

    undamped = True

    sigma0: float = 1e6
    f_c: float = 0.65
    exponent: float = 1.0

    def born(self):
        return 0.0, 0.0, 1

    def turned(self, z, form, d, way, v=0.0):
        return d, self.force(z, form, d, 0.0, form[2]), way

    def force(self, z, form, d, v, way):
        begin, force, _ = form
        left, path = 1.0 - way * force / self.f_c, way * (d - begin) * self.sigma0 / self.f_c
        if self.exponent == 1.0:
            left *= math.exp(-path)
        else:
            rest = 1.0 - self.exponent
            left = max(max(left, 1e-300) ** rest - rest * path, 0.0) ** (1.0 / rest)
        return way * self.f_c * (1.0 - left)


CASES = {"": Dahl(), "brittle": Dahl(exponent=0.5), "more brittle": Dahl(exponent=0.3), "ductile": Dahl(exponent=2.0)}
