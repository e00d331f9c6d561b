"""Bliman and Sorine's friction, from its equations alone."""

import dataclasses
import math

from tests.reference.independent_friction import Law


@dataclasses.dataclass(frozen=True)
class BlimanSorine(Law):
    """Form: displacement at the last reversal, both parts of the force [N] there, and the direction since."""

    undamped = True

    f_c: float = 0.55
    f_2: float = 0.3
    epsilon: float = 3e-6
    eta: float = 0.2

    def born(self):
        return 0.0, 0.0, 0.0, 1

    def parts(self, form, d):
        begin, first, second, way = form
        path, f_1 = way * (d - begin) / self.epsilon, self.f_c + self.f_2
        first = way * f_1 + (first - way * f_1) * math.exp(-path / self.eta)
        return first, way * self.f_2 + (second - way * self.f_2) * math.exp(-path)

    def turned(self, z, form, d, way, v=0.0):
        return d, *self.parts(form, d), way

    def force(self, z, form, d, v, way):
        first, second = self.parts((*form[:3], way), d)
        return first - second


CASES = {"": BlimanSorine()}
