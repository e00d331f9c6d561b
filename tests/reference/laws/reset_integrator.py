"""Reset integrator friction, from its equations alone."""

import dataclasses

from tests.reference.independent_friction import Law


@dataclasses.dataclass(frozen=True)
class ResetIntegrator(Law):
    """Form: where the bond carries no force [m], or the way that it is dragged; and whether it is dragged."""

    sigma0: float = 1e6
    f_c: float = 0.55
    a: float = 0.2
    beta: float = 45.0

    def born(self):
        return 0.0, False

    def turned(self, z, form, d, way, v=0.0):
        zero_or_way, dragged = form
        # At the end of a slide in the other direction the bond begins to let up.
        return (d + way * self.f_c / self.sigma0, False) if dragged and zero_or_way != way else form

    def force(self, z, form, d, v, way):
        if form[1]:
            return way * self.f_c
        return (1.0 + self.a) * self.sigma0 * (d - form[0]) + self.beta * v

    def room(self, z, form, d, v, way):
        return [1.0] if form[1] else [self.f_c / self.sigma0 - way * (d - form[0])]

    def next(self, z, form, d, way, which):
        return way, True


CASES = {"": ResetIntegrator()}
