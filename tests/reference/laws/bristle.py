"""Bristle friction, from its equations alone: where each bond is rooted, and how many have snapped."""

import dataclasses
import math

from tests.reference.independent_friction import Law


@dataclasses.dataclass(frozen=True)
class Bristle(Law):
    """Form: the number of bonds that have snapped, and for each bond the displacement at which it is loose."""

    sigma0: float = 1e6
    f_c: float = 0.55
    sigma2: float = 30.0
    bonds = 20  # no field: it is no number that the package could be handed

    def most(self):
        return 1.5 * self.f_c / self.sigma0

    def born(self):
        return 0, tuple(self.most() * (0.5 - (i + 0.5) / self.bonds) for i in range(self.bonds))

    def force(self, z, form, d, v, way):
        return self.sigma0 * (d - sum(form[1]) / self.bonds) + self.sigma2 * v

    def room(self, z, form, d, v, way):
        return [self.most() - way * (d - root) for root in form[1]]

    def next(self, z, form, d, way, which):
        snapped = form[0] + 1
        stretch = way * self.most() * math.modf(snapped * 0.5 * (math.sqrt(5.0) - 1.0))[0]
        return snapped, tuple(d - stretch if i == which else root for i, root in enumerate(form[1]))


CASES = {"": Bristle()}
