"""Declares the physical quantities of a model: nominal value, SI unit, sign.

A model is an equinox Module whose fields are its parameters in SI units.  Each is
declared with `quantity`, so that studies, fits and reports learn the unit and the sign
of a parameter from the one place where it is defined.
"""

import dataclasses
import math
from typing import Any, TypeAlias

import equinox as eqx
import numpy as np
from jax.core import Tracer

from .arrays import ScalarLike
from .errors import InputError
from .units import unit_given

Declared: TypeAlias = Any
"""What declares a field of a model; its type is that of the field, as a dataclass has it."""


Choice: TypeAlias = Any
"""A field declared with `choice`: given one of its words, or that number, it holds the number."""


@dataclasses.dataclass(frozen=True)
class Quantity:
    """What is known of a parameter before any data: one entry per field of a model."""

    nominal: float
    """Cited value, in `unit`."""
    unit: str
    """SI unit, in pint's spelling; "" for a pure number."""
    positive: bool
    """Strictly positive: fitted on a logarithmic scale."""
    low: float
    """Lower end of the legal range, itself legal unless `positive`; -inf if signed."""
    high: float
    """Upper end of the legal range, itself not legal (`math.nextafter` of one that is); inf where there is none."""
    optional: bool
    """A study may leave it out, and then it is fixed at `nominal`."""
    linear: bool = False
    """The platform's motion without friction feedback is linear in it and all others of which this is said."""


def quantity(
    nominal: float,
    unit: str,
    *,
    positive: bool = True,
    low: float | None = None,
    high: float = math.inf,
    optional: bool = False,
    linear: bool = False,
) -> Declared:
    """A model field holding a number in `unit`.

    **Arguments:** `nominal` is the cited value, used when the field is left out.  With
    `positive` (the default) the value must exceed 0; otherwise `low` (default -inf)
    bounds it from below.  `high` bounds it from above.  `optional` lets a study leave
    it out.  `linear` says of a stack's parameters that a platform moves in proportion.
    """
    if low is None:
        low = 0.0 if positive else -math.inf
    declared = Quantity(nominal, unit, positive, low, high, optional, linear)
    return eqx.field(default=nominal, metadata={"quantity": declared})


def quantities(model: type) -> dict[str, Quantity]:
    """The declared quantities of a model class, by field name, in the order of its fields."""
    fields = dataclasses.fields(model)
    return {f.name: f.metadata["quantity"] for f in fields if "quantity" in f.metadata}


def choice(options: dict[str, float]) -> Choice:
    """A model field that takes one of the named `options`, the first by default.

    The field holds the option's number, an array leaf rather than a static string, so
    that records which differ only in a choice share one compiled function.
    """

    def number(given: str | ScalarLike) -> ScalarLike:
        if not isinstance(given, str):
            return given
        if given not in options:
            raise ValueError(f"Expected one of {', '.join(options)}, but got {given!r}.")
        return options[given]

    return eqx.field(default=next(iter(options)), converter=number, metadata={"choice": options})


def choices(model: type) -> dict[str, dict[str, float]]:
    """The declared choices of a model class: field name to its options."""
    fields = dataclasses.fields(model)
    return {f.name: f.metadata["choice"] for f in fields if "choice" in f.metadata}


def check_quantities(model: eqx.Module, where: str) -> None:
    """**Raises** `InputError` that begins with `where` for a quantity of `model`, or of a part of it, out of its range.

    Numbers that JAX traces are not known, and pass.
    """
    for field in dataclasses.fields(model):
        value, declared = getattr(model, field.name), field.metadata.get("quantity")
        if isinstance(value, eqx.Module):
            check_quantities(value, where)
        elif declared is not None and not isinstance(value, Tracer) and np.ndim(value) == 0:
            check_range(float(value), declared, f"{where}: {type(model).__name__}.{field.name}")


def described(model: eqx.Module) -> str:
    """A model as text, its numbers with their units: `Effector(mass=0.086 kg, load=0 N, tilt=0 rad)`."""
    told = []
    for field in dataclasses.fields(model):
        value, declared = getattr(model, field.name), field.metadata.get("quantity")
        words = {number: word for word, number in field.metadata.get("choice", {}).items()}
        try:
            number = float(value)
        except Exception:  # an array, a traced number, another model
            shown = repr(value) if isinstance(value, eqx.Module) or value is None else eqx.tree_pformat(value)
        else:
            known = isinstance(value, bool) or (declared is None and number not in words)
            shown = repr(value) if known else words.get(number, f"{number:.6g}")
            shown += f" {declared.unit}" if declared is not None and declared.unit else ""
        told.append(f"{field.name}={shown}")
    return f"{type(model).__name__}({', '.join(told)})"


def check_range(value: float, declared: Quantity, where: str, given: object = None) -> None:
    """Raises `InputError` that begins with `where` if `value` is outside the legal range.

    It names both in the unit of what the user has `given`, where that is a text with one.
    """
    low_ok = value > declared.low if declared.positive else value >= declared.low
    if low_ok and value < declared.high:
        return
    unit, size = unit_given(given, declared.unit)
    shown = lambda number: f"{number / size:g} {unit}".rstrip()
    expected = []
    if math.isfinite(declared.low):
        expected.append(f"{'above' if declared.positive else 'of at least'} {shown(declared.low)}")
    if math.isfinite(declared.high):
        # An end that is legal itself is declared as the float next to it.
        last = math.nextafter(declared.high, -math.inf)
        is_legal = len(repr(last)) < len(repr(declared.high))
        expected.append(f"at most {shown(last)}" if is_legal else f"below {shown(declared.high)}")
    raise InputError(f"{where}: found {shown(value)}, expected a value {' and '.join(expected)}.")
