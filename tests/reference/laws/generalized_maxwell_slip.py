"""Generalized Maxwell slip friction, from its equations alone."""

import dataclasses
import math

from scipy.optimize import brentq

from tests.reference.independent_friction import Law, curve


@dataclasses.dataclass(frozen=True)
class GeneralizedMaxwellSlip(Law):
    """Form: for each element whether it slips."""

    stiffness_1: float = 4e5
    stiffness_2: float = 3e5
    stiffness_3: float = 2e5
    stiffness_4: float = 1e5
    strength_1: float = 0.06
    strength_2: float = 0.14
    strength_3: float = 0.2
    strength_4: float = 0.25
    weakened: float = 0.85
    v_s: float = 1e-3
    attraction: float = 3e3
    sigma2: float = 2.0
    atol = (1e-19,) * 4

    def _springs(self):
        return self.stiffness_1, self.stiffness_2, self.stiffness_3, self.stiffness_4

    def _limits(self):
        return self.strength_1, self.strength_2, self.strength_3, self.strength_4

    def left(self, v):
        """The part of the breakaway force that is left at v."""
        return curve(v, self.weakened, 1.0, self.v_s)

    def born(self):
        return (False,) * 4

    def turned(self, z, form, d, way, v=0.0):
        left = self.left(v)
        springs = zip(z, self._springs(), self._limits(), strict=True)
        return tuple(bool(way * k * x >= left * w * (1 - 1e-12)) for x, k, w in springs)

    def jumped(self, z, form, d, v, way):
        # What slips goes on slipping up to the next turn, whatever its limit has become.
        return tuple(a or b for a, b in zip(form, self.turned(z, form, d, way, v), strict=True))

    def resting(self, force):
        """Stretched from rest by the one displacement under which the springs carry the force."""
        way, springs = math.copysign(1.0, force), list(zip(self._springs(), self._limits(), strict=True))
        missing = lambda d: sum(min(k * d, w) for k, w in springs) - abs(force)
        d = brentq(missing, 0.0, 1e-3, xtol=1e-22)
        return [way * min(d, w / k) for k, w in springs], self.born()

    def force(self, z, form, d, v, way):
        return sum(k * x for k, x in zip(self._springs(), z, strict=True)) + self.sigma2 * v

    def flow(self, z, form, d, v, way):
        whole = sum(self._limits())
        level = whole * self.left(v)
        rates = []
        for x, k, w, slips in zip(z, self._springs(), self._limits(), form, strict=True):
            rates.append(self.attraction * (way * w / whole - k * x / level) / k if slips else v)
        return rates

    def room(self, z, form, d, v, way):
        left = self.left(v)
        springs = zip(z, self._springs(), self._limits(), form, strict=True)
        return [1.0 if slips else left * w - way * k * x for x, k, w, slips in springs]

    def next(self, z, form, d, way, which):
        return tuple(slips or i == which for i, slips in enumerate(form))


CASES = {"": GeneralizedMaxwellSlip()}
