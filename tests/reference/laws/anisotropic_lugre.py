"""Direction-dependent simplified LuGre friction (5.20-5.22) in both readings, from its equations alone."""

import dataclasses

from tests.reference.independent_friction import Law


@dataclasses.dataclass(frozen=True)
class AnisotropicLuGre(Law):
    """The state is the deflection z [m], or the elastic force [N]; indices a for v >= 0, b for v < 0.

    In the first reading the force jumps at v = 0, so that it may stick.
    """

    sticks = True

    sigma0_a: float = 1.1484e6
    sigma0_b: float = 0.953789e6
    sigma1_a: float = 54.4
    sigma1_b: float = 38.9
    f_ss_a: float = 0.7964
    f_ss_b: float = 0.5458
    state: str = "deflection"

    @property
    def atol(self):
        return (1e-19,) if self.state == "deflection" else (1e-13,)

    def branch(self, way):
        """s0, s1 and F_SS of a direction."""
        if way > 0:
            return self.sigma0_a, self.sigma1_a, self.f_ss_a
        return self.sigma0_b, self.sigma1_b, self.f_ss_b

    def flow(self, z, form, d, v, way):
        s0, _, f_ss = self.branch(way)
        if self.state == "deflection":
            return [v - s0 * way * v * z[0] / f_ss]
        return [s0 * (v - way * v * z[0] / f_ss)]

    def force(self, z, form, d, v, way):
        s0, s1, f_ss = self.branch(way)
        elastic = s0 * z[0] if self.state == "deflection" else z[0]
        return elastic + s1 * (v - way * v * elastic / f_ss)
