"""The laws of `laws` as contacts of a combination: by the package's name and numbers."""

import dataclasses
import math
from typing import Any

from independent_friction import Law
from laws.anisotropic_lugre import AnisotropicLuGre
from laws.bliman_sorine import BlimanSorine
from laws.coulomb import Coulomb
from laws.dahl import Dahl
from laws.elastoplastic import Elastoplastic
from laws.generalized_maxwell_slip import GeneralizedMaxwellSlip
from laws.lugre import LuGre
from laws.reset_integrator import ResetIntegrator
from laws.simplified_lugre import SimplifiedLuGre
from laws.stribeck import Stribeck

ROUNDING = 1e-3
"""e, the part of v_s below which the tip of a Stribeck curve is rounded."""


class RoundedStribeck(Stribeck):
    """x^2 (x^2 + e^2)^(delta/2 - 1) in place of |x|^delta.

    The rounded tip is part of the model as it is documented; to the accuracy of these comparisons it counts.
    """

    def level(self, v):
        square = (v / self.v_s) ** 2
        weakening = math.exp(-square * (square + ROUNDING**2) ** (0.5 * self.delta - 1.0))
        return self.f_c + (self.f_s - self.f_c) * weakening


LAWS: dict[str, type[Law]] = {
    "anisotropic-lugre": AnisotropicLuGre,
    "bliman-sorine": BlimanSorine,
    "coulomb": Coulomb,
    "dahl": Dahl,
    "elastoplastic": Elastoplastic,
    "generalized-maxwell-slip": GeneralizedMaxwellSlip,
    "lugre": LuGre,
    "reset-integrator": ResetIntegrator,
    "simplified-lugre": SimplifiedLuGre,
    "stribeck": RoundedStribeck,
}


def contact_of(name: str, numbers: dict[str, Any]) -> Law:
    """A law with all its numbers, which have to be given: the nominal ones of `laws` are others than the package's."""
    law: Any = LAWS[name]
    needed = {field.name for field in dataclasses.fields(law)} - {"state"}
    assert needed <= set(numbers), f"{name} has no number for {needed - set(numbers)}"
    return law(**numbers)
