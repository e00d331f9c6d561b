"""Friction laws written from their equations alone, for `independent_laws` to simulate: plain floats."""

import dataclasses
import math
from typing import Any


class Law:
    """A contact: `z` its continuous memory, `form` all else it remembers, `d` the relative displacement [m].

    `way` is the sign of the relative velocity `v` [m/s].
    """

    atol: tuple[float, ...] = ()
    """Absolute tolerance of each continuous memory."""

    def born(self) -> Any:
        """The form before anything has moved."""
        return None

    def turned(self, z, form, d, way) -> Any:
        """The form with which a motion in the direction `way` begins at d."""
        return form

    def force(self, z, form, d, v, way) -> float:
        """Friction force on the end-effector [N]."""
        raise NotImplementedError

    def flow(self, z, form, d, v, way) -> list[float]:
        """Rates of the memory."""
        return []

    def room(self, z, form, d, v, way) -> list[float]:
        """Positive while the form lasts."""
        return []

    def next(self, z, form, d, way, which) -> Any:
        """The form after room number `which` is used up."""
        return form


def curve(v, f_c, f_s, v_s, delta=2.0):
    """The Stribeck curve [N]."""
    return f_c + (f_s - f_c) * math.exp(-(abs(v / v_s) ** delta))


@dataclasses.dataclass(frozen=True)
class Coulomb(Law):
    f_c: float = 0.65

    def force(self, z, form, d, v, way):
        return self.f_c * way


@dataclasses.dataclass(frozen=True)
class Stribeck(Law):
    f_c: float = 0.55
    f_s: float = 0.65
    v_s: float = 1e-3
    sigma2: float = 2.0
    delta: float = 2.0

    def force(self, z, form, d, v, way):
        return way * curve(v, self.f_c, self.f_s, self.v_s, self.delta) + self.sigma2 * v


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
        return [v - self.sigma0 * abs(v) * z[0] / curve(v, self.f_c, self.f_s, self.v_s)]

    def force(self, z, form, d, v, way):
        return self.sigma0 * z[0] + self.sigma1 * self.flow(z, form, d, v, way)[0] + self.sigma2 * v


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


@dataclasses.dataclass(frozen=True)
class Dahl(Law):
    """Form: displacement and force [N] at the last reversal."""

    sigma0: float = 1e6
    f_c: float = 0.65
    exponent: float = 1.0

    def born(self):
        return 0.0, 0.0, 1

    def turned(self, z, form, d, way):
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


@dataclasses.dataclass(frozen=True)
class BlimanSorine(Law):
    """Form: displacement at the last reversal, both parts of the force [N] there, and the direction since."""

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

    def turned(self, z, form, d, way):
        return d, *self.parts(form, d), way

    def force(self, z, form, d, v, way):
        first, second = self.parts((*form[:3], way), d)
        return first - second


@dataclasses.dataclass(frozen=True)
class ResetIntegrator(Law):
    """Form: the displacement at which the bond is loose, or the way that it is dragged; and whether it is."""

    sigma0: float = 1e6
    f_c: float = 0.55
    a: float = 0.2
    beta: float = 45.0

    def born(self):
        return 0.0, False

    def turned(self, z, form, d, way):
        loose, dragged = form
        # At the end of a slide in the other direction the bond begins to let up.
        return (d + way * self.f_c / self.sigma0, False) if dragged and loose != way else form

    def force(self, z, form, d, v, way):
        if form[1]:
            return way * self.f_c
        return (1.0 + self.a) * self.sigma0 * (d - form[0]) + self.beta * v

    def room(self, z, form, d, v, way):
        return [1.0] if form[1] else [self.f_c / self.sigma0 - way * (d - form[0])]

    def next(self, z, form, d, way, which):
        return way, True


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

    def born(self):
        return (False,) * 4

    def turned(self, z, form, d, way):
        springs = zip(z, self._springs(), self._limits(), strict=True)
        return tuple(bool(way * k * x >= w * (1 - 1e-12)) for x, k, w in springs)

    def force(self, z, form, d, v, way):
        return sum(k * x for k, x in zip(self._springs(), z, strict=True)) + self.sigma2 * v

    def flow(self, z, form, d, v, way):
        whole = sum(self._limits())
        level = curve(v, self.weakened * whole, whole, self.v_s)
        rates = []
        for x, k, w, slips in zip(z, self._springs(), self._limits(), form, strict=True):
            rates.append(self.attraction * (way * w / whole - k * x / level) / k if slips else v)
        return rates

    def room(self, z, form, d, v, way):
        left = curve(v, self.weakened, 1.0, self.v_s)
        springs = zip(z, self._springs(), self._limits(), form, strict=True)
        return [1.0 if slips else left * w - way * k * x for x, k, w, slips in springs]

    def next(self, z, form, d, way, which):
        return tuple(slips or i == which for i, slips in enumerate(form))
