"""Coulomb friction, from its equations alone."""

import dataclasses

from tests.reference.independent_friction import Law


@dataclasses.dataclass(frozen=True)
class Coulomb(Law):
    sticks = True

    f_c: float = 0.65

    def force(self, z, form, d, v, way):
        return self.f_c * way


CASES = {"": Coulomb()}
