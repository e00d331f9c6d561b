"""The model of a composed stack, and its class, made of the text that names it: its parameters become its fields.

`composed` tells the equations.
"""

import copy
from collections.abc import Mapping
from functools import cache
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float

from ..core import Scalar, ScalarLike, quantities
from ._ceramic import AbstractHysteresis, BoucWen, Ceramic, Elements
from ._composition import (
    Composition,
    composed_guess,
    composition_of,
    determinable_ranges_of,
    fields_of,
    hysteretic_names,
    loop_columns,
    loop_numbers,
    mechanical_names,
)
from ._dynamics import AbstractDynamics, FirstOrder, Modal, Mode, Static
from ._rod import Rod, modes
from ._stack import AbstractStack, History, oscillator
from .base import DeterminableRange, Shown


class ComposedModel(AbstractStack):
    """The mechanics' states, the voltage [V], then the elements' and those of creep; then flags."""

    composition: ClassVar[Composition]
    """Parts of the stack."""
    meanings: ClassVar[dict[str, str]]
    """Meaning of each parameter."""

    @classmethod
    def first_guess(cls, shown: Shown, known: Mapping[str, float]) -> dict[str, float]:
        nominal = {name: declared.nominal for name, declared in quantities(cls).items()}
        return composed_guess(cls.composition, nominal, shown, known, super().first_guess(shown, known))

    @classmethod
    def loop_columns(
        cls, time: Float[np.ndarray, " n"], volts: Float[np.ndarray, " n"], numbers: Mapping[str, float]
    ) -> dict[str, Float[np.ndarray, " n"]]:
        return loop_columns(cls.composition, time, volts, numbers)

    @classmethod
    def determinable_ranges(cls, shown: Shown) -> dict[str, DeterminableRange]:
        return determinable_ranges_of(cls.composition, shown)

    def broken_conditions(self) -> tuple[str, ...]:
        if self.composition.hysteresis == "maxwell-slip":
            held, gain = sum(map(float, self._numbered("stop"))), float(self._get("gain"))
            if held > gain:
                last = self.composition.elements
                return (f"piezo.stop_1 to piezo.stop_{last} together are {held:.4g} m/V, above the gain",)
        if self.composition.hysteresis == "bouc-wen":
            beta, gamma = float(self._get("beta")), float(self._get("gamma"))
            if abs(gamma) > beta:
                return (f"piezo.gamma is {gamma:.4g} 1/V, beyond piezo.beta, {beta:.4g} 1/V",)
        return ()

    @property
    def dynamics(self) -> AbstractDynamics:
        """The mechanics, with their numbers."""
        if self.composition.dynamics == "static":
            return Static()
        if self.composition.dynamics == "first-order":
            return FirstOrder(self._get("time_constant"))
        if self.composition.dynamics == "second-order":
            return oscillator(self._get("natural_frequency"), self._get("damping_ratio"), self._get("mass"))
        names = ("modulus", "viscosity", "density", "area", "platform_mass")
        length = self._get("stack_length")
        kept = modes(
            Rod(**{n: self._get(n) for n in names}, length=length, strain=1.0 / length),  # pyright: ignore[reportArgumentType]
            self.composition.modes,
        )
        columns = (kept.gain, kept.natural_frequency, kept.damping_ratio, kept.mass)
        return Modal(tuple(Mode(*(column[j] for column in columns)) for j in range(self.composition.modes)))

    @property
    def ceramic(self) -> Ceramic:
        """Polynomial, hysteresis and creep, with their numbers."""
        gain, law = self._get("gain"), self._law()
        if self.composition.hysteresis == "maxwell-slip":
            gain = gain - sum(law.weights)
        curves = (self._get(f"asymmetry_{k}") for k in range(2, self.composition.asymmetry + 1))
        times = tuple(self._get("creep_time") * 10.0**j for j in range(self.composition.creep))
        return Ceramic((gain, *curves), law, self._numbered("creep"), times)

    def _law(self) -> AbstractHysteresis:
        """The law of hysteresis, with its numbers."""
        if self.composition.hysteresis == "bouc-wen":
            return BoucWen((self._get("hysteresis"),), self._get("beta"), self._get("gamma"))
        if not self.composition.has_elements:
            return Elements()
        word = "play" if self.composition.hysteresis == "play" else "stop"
        span, many = self._get(f"{word}_range"), self.composition.elements
        return Elements(self._numbered(word), tuple(span * (j / many) for j in range(1, many + 1)))

    @property
    def history(self) -> History:
        peak = self._get("initial_peak") if self.composition.hysteresis != "none" else 0.0
        return History(self._get("initial_voltage"), peak, self._numbered("initial_creep"))

    def _numbered(self, word: str) -> tuple[ScalarLike, ...]:
        many = self.composition.creep if word in ("creep", "initial_creep") else self.composition.elements
        return tuple(self._get(f"{word}_{j}") for j in range(1, many + 1))

    def _get(self, name: str) -> ScalarLike:
        number: ScalarLike = getattr(self, name)
        return number


HOME = "pdssjax.piezo.composed"
"""Where classes say that they come from: there another process finds them by name."""


@cache
def composed_class(composition: Composition) -> type[ComposedModel]:
    """The class of stacks with this `composition`: always the same one."""
    fields = fields_of(composition)
    compliant = composition.dynamics in ("second-order", "rod")
    name = "Composed" if composition == Composition() else f"Composed:{composition.text}"
    contents: dict[str, Any] = {
        "__module__": HOME,
        "__qualname__": name,
        "__doc__": ComposedModel.__doc__,
        "__annotations__": {field.name: float for field in fields},
        "composition": composition,
        "meanings": {field.name: field.text for field in fields},
        "variant_name": "" if composition == Composition() else composition.text,
        "variant": staticmethod(composed_variant),
        "is_compliant": compliant,
        "loop_numbers": loop_numbers(composition),
        "mechanical": mechanical_names(composition),
        "hysteretic": hysteretic_names(composition),
        "closed_on_lines": composition.closed_on_lines,
        # Copies: a declaration belongs to the one field that it is given to.
        **{field.name: copy.copy(field.declared) for field in fields},
    }
    if "mass" not in contents:
        contents["mass"] = property(_mass)
    metaclass: Any = type(ComposedModel)
    return metaclass(name, (ComposedModel,), contents)


def _mass(stack: ComposedModel) -> Scalar:
    """Effective mass that a force on the platform accelerates [kg]; infinite where no force moves it."""
    return stack.dynamics.mass()


def composed_variant(text: str) -> type[ComposedModel]:
    """The stack that `text` describes, such as "static+play-8+creep-3".

    **Raises:** `KeyError` for what is no such text.
    """
    return composed_class(composition_of(text))
