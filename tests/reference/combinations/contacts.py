"""The laws of `laws` as contacts of a combination: by the package's name and numbers."""

import dataclasses
import importlib
import math
from typing import Any

from tests.reference.independent_friction import Law
from tests.reference.laws.stribeck import Stribeck

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


def law_class(name: str) -> Any:
    """The law that a file of `laws` defines, such as "elastoplastic"."""
    if name == "stribeck":
        return RoundedStribeck
    module = importlib.import_module(f"tests.reference.laws.{name.replace('-', '_')}")
    classes = [thing for thing in vars(module).values() if isinstance(thing, type) and issubclass(thing, Law)]
    (law,) = (thing for thing in classes if thing.__module__ == module.__name__)
    return law


def contact_of(name: str, numbers: dict[str, Any]) -> Law:
    """A law with all its numbers, which have to be given: the nominal ones of `laws` are others than the package's."""
    law = law_class(name)
    needed = {field.name for field in dataclasses.fields(law)} - {"state"}
    assert needed <= set(numbers), f"{name} needs {needed - set(numbers)}"
    return law(**numbers)
