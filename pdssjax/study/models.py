"""The chosen family members, and the actuator that they make of numbers: "friction.sigma0" is the law's `sigma0`."""

import json
from collections.abc import Collection, Mapping
from typing import Any, TypeAlias

import equinox as eqx
import numpy as np
from jaxtyping import Float

from ..actuator import PARTS, Actuator, Sensor
from ..core import InputError, Quantity, ScalarLike, member_name, quantities
from ..friction.base import AbstractFriction
from ..piezo.base import AbstractPiezo

Values: TypeAlias = Mapping[str, ScalarLike | Float[np.ndarray, ""]]
"""Parameter paths to numbers in SI."""

Fields: TypeAlias = dict[str, Any]
"""Numbers and words by the fields of a model, which say what they are."""


class Models(eqx.Module):
    """The chosen family members, without their parameters."""

    piezo: type[AbstractPiezo] = eqx.field(static=True)
    friction: type[AbstractFriction] = eqx.field(static=True)
    friction_state: str = eqx.field(static=True)
    feedback: bool = eqx.field(static=True)
    parts: frozenset[str] = eqx.field(static=True, default=frozenset())
    """Further parts of the rig: "amplifier", "low-pass" (of the sensor)."""
    rests_under_load: bool = eqx.field(static=True, default=False)
    """Load and tilt acted before t = 0."""

    @property
    def law(self) -> Fields:
        """The reading of a direction-dependent law."""
        return {"state": self.friction_state} if hasattr(self.friction, "state") else {}

    @property
    def chosen(self) -> dict[str, str | bool]:
        """The chosen members by key, as [actuator] of a study's file has them."""
        return {
            "piezo": member_name(self.piezo),
            "friction": member_name(self.friction),
            "friction_state": self.friction_state,
            "feedback": bool(self.feedback),
            # Left out where it is not so: a sweep's store and a fit kept by an earlier version have no such key.
            **({"rests_under_load": True} if self.rests_under_load else {}),
        }

    def check_same(self, told: Mapping[str, object], where: str) -> None:
        """**Raises** `InputError` where what is `told` of an estimate's actuator, as in `chosen`, is another one.

        What is not told, as by older versions, is not compared, nor a reading where the law has none.
        """
        kept = {key: value for key, value in self.chosen.items() if key != "friction_state" or self.law}
        other = {key: value for key, value in kept.items() if told.get(key, value) != value}
        if other:
            listed = lambda models: ", ".join(f"{key} = {json.dumps(models[key])}" for key in other)
            found, expected = listed(told), listed(other)
            raise InputError(f"{where}: found an estimate with {found}, expected one with {expected}, as in the study.")

    def declared(self) -> dict[str, Quantity]:
        """The declared quantities of the members and of the parts of a rig, by path."""
        chosen = {"piezo": self.piezo, "friction": self.friction, **PARTS}
        return {f"{name}.{field}": q for name, model in chosen.items() for field, q in quantities(model).items()}

    def contact(self, values: Values) -> AbstractFriction:
        """The friction law with the given `values`."""
        return self.friction(**given_fields("friction", self.friction, values), **self.law)

    def actuator(self, values: Values, blocked: bool = False) -> Actuator:
        """The actuator with the given `values`; what is left out keeps its nominal value."""
        return Actuator(
            self.piezo(**given_fields("piezo", self.piezo, values)),
            self.contact(values),
            _part("effector", values),
            self.feedback,
            _part("amplifier", values) if "amplifier" in self.parts else None,
            _part("stop", values) if blocked else None,
            self.rests_under_load,
        )

    def sensor(self, values: Values) -> Sensor:
        """The displacement sensor with the given `values`."""
        return _part("sensor", values, filters="low-pass" in self.parts)


def parts_told_by(paths: Collection[str]) -> frozenset[str]:
    """Further parts of a rig that parameters of these `paths` imply: "amplifier", "low-pass" (of the sensor)."""
    has_amplifier = any(path.startswith("amplifier.") for path in paths)
    return frozenset(["amplifier"] * has_amplifier + ["low-pass"] * ("sensor.bandwidth" in paths))


def _part(name: str, values: Values, **more: Any) -> Any:
    """The part `name` of a rig with the given `values`."""
    return PARTS[name](**given_fields(name, PARTS[name], values), **more)


def given_fields(family: str, model: type, values: Values) -> Fields:
    named = {field: values.get(f"{family}.{field}") for field in quantities(model)}
    return {field: value for field, value in named.items() if value is not None}
