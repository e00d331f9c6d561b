"""Elastoplastic friction, from its equations alone."""

import dataclasses
import math

from tests.reference.independent_friction import curve
from tests.reference.laws.lugre import LuGre


@dataclasses.dataclass(frozen=True)
class Elastoplastic(LuGre):
    elastic_part: float = 0.6

    def flow(self, z, form, d, v, way):
        most = curve(v, self.f_c, self.f_s, self.v_s) / self.sigma0
        least = self.elastic_part * min(self.f_c, self.f_s) / self.sigma0
        size = abs(z[0])
        if z[0] * way <= 0.0 or size <= least:
            return [v]
        alpha = 1.0
        if size < most:
            alpha = 0.5 + 0.5 * math.sin(math.pi * (size - 0.5 * (most + least)) / (most - least))
        return [v * (1.0 - alpha * size / most)]


CASES = {"": Elastoplastic()}
