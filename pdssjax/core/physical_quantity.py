"""Declares the physical quantities of a model: nominal value, SI unit, sign.

A model is an equinox Module whose fields are its parameters in SI units.  Each is
declared with `quantity`, so that studies, fits and reports learn the unit and the sign
of a parameter from the one place where it is defined.

A number given for a field becomes `numpy.float64`, which equinox takes for an array: `filter_grad` differentiates by
it and `filter_jit` compiles once for all numbers.  Unlike JAX's arrays it is in double precision whenever it is made,
and needs no JAX to be made, compared and kept in a file.
"""

import dataclasses
import math
import numbers
from typing import Any, TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .arrays import Given, ScalarLike
from .errors import InputError
from .units import unit_given

Declared: TypeAlias = Any
"""What declares a field of a model; its type is that of the field, as a dataclass has it."""


Choice: TypeAlias = Any
"""A field declared with `choice`: given one of its words, or that number, it holds the number."""


@dataclasses.dataclass(frozen=True)
class Quantity:
    """Declaration of a parameter: nominal value, unit, sign and range; one entry per field of a model."""

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
    may_vanish: bool = False
    """A model may hold 0 as well, a limit that a fit on a logarithmic scale cannot reach."""


def quantity(
    nominal: float,
    unit: str,
    *,
    positive: bool = True,
    low: float | None = None,
    high: float = math.inf,
    optional: bool = False,
    linear: bool = False,
    may_vanish: bool = False,
) -> Declared:
    """A model field holding a number in `unit`.

    **Arguments:** `nominal` is the cited value, used when the field is left out.  With
    `positive` (the default) the value must exceed 0; otherwise `low` (default -inf)
    bounds it from below.  `high` bounds it from above.  `optional` lets a study leave
    it out.  `linear` says of a stack's parameters that a platform moves in proportion.
    With `may_vanish` a model that is made in Python may have 0 for it, too: a law without damping.
    """
    if low is None:
        low = 0.0 if positive else -math.inf
    declared = Quantity(nominal, unit, positive, low, high, optional, linear, may_vanish)
    return eqx.field(default=nominal, converter=as_number, metadata={"quantity": declared})


def as_number(given: Given) -> Given:
    """What a field declared with `quantity` holds of what is `given`: a float64, or an array of floating point.

    Python's and NumPy's numbers become `numpy.float64`, arrays of them and of JAX, traced or not, keep their shape.
    What is no number is left as it is, for `AbstractModel` to refuse.
    """
    if isinstance(given, np.float64):
        return given
    if isinstance(given, jax.Array):
        if not (jnp.issubdtype(given.dtype, jnp.floating) or jnp.issubdtype(given.dtype, jnp.integer)):
            return given
        # A weak type would compile another function.
        return given.astype(float) if given.weak_type or given.dtype != jnp.result_type(float) else given
    if isinstance(given, np.ndarray | np.generic):
        return np.asarray(given, float)[()] if given.dtype.kind in "iuf" else given
    if isinstance(given, bool) or not isinstance(given, numbers.Real):
        return given
    return np.float64(given)


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
            return as_number(given)
        if given not in options:
            raise ValueError(f"Expected one of {', '.join(options)}, but got {given!r}.")
        return np.float64(options[given])

    return eqx.field(default=next(iter(options)), converter=number, metadata={"choice": options})


def choices(model: type) -> dict[str, dict[str, float]]:
    """The declared choices of a model class: field name to its options."""
    fields = dataclasses.fields(model)
    return {f.name: f.metadata["choice"] for f in fields if "choice" in f.metadata}


class AbstractModel(eqx.Module):
    """A model whose fields are declared with `quantity` and `choice`: shows them with units, and checks their numbers.

    **Raises:** `InputError` that names the field, where it is made with a number outside the legal range or with what
    is no number.  Traced numbers are not checked.
    """

    def __check_init__(self) -> None:
        for field, declared in quantities(type(self)).items():
            if getattr(self, field) is not None:
                _check_number(getattr(self, field), declared, f"{type(self).__name__}.{field}")
        for field, options in choices(type(self)).items():
            _check_choice(getattr(self, field), options, f"{type(self).__name__}.{field}")

    def __repr__(self) -> str:
        return described(self)


Model = TypeVar("Model", bound=eqx.Module)


def as_single(model: Model, name: str) -> Model:
    """`model` as one simulation takes it: each of its quantities one number, in double precision and legal.

    Numbers that were put in after the model was made (`equinox.tree_at`) are converted and checked, those of models
    within it too.

    **Raises:** `InputError` that names the quantity, as "actuator.effector.mass" where the model's `name` is
    "actuator": for one outside its legal range, and for an array of several numbers.
    """
    changed = {}
    for field in dataclasses.fields(model):
        value, where = getattr(model, field.name), f"{name}.{field.name}"
        if "quantity" in field.metadata:
            single = single_number(value, field.metadata["quantity"], where)
        elif "choice" in field.metadata:
            single = _of_no_shape(as_number(value), where)
            _check_choice(single, field.metadata["choice"], where)
        elif isinstance(value, eqx.Module) and not field.metadata.get("static", False):
            single = as_single(value, where)
        else:
            continue
        if single is not value:
            changed[field.name] = single
    if not changed:
        return model
    return eqx.tree_at(lambda model: [getattr(model, field) for field in changed], model, list(changed.values()))


def single_number(given: Given, declared: Quantity, where: str) -> Given:
    """The number `given` for a `declared` quantity as `as_number` has it, of shape ().

    **Raises:** `InputError` that begins with `where` for several numbers, for what is no number, and for one outside
    the legal range, which of traced numbers is not known.
    """
    single = _of_no_shape(as_number(given), where)
    _check_number(single, declared, where)
    return single


def _of_no_shape(value: Any, where: str) -> Any:
    if np.shape(value) and isinstance(value, jax.Array | np.ndarray):
        raise InputError(
            f"{where}: found an array of shape {np.shape(value)}, expected one number; jax.vmap runs several."
        )
    return value


def _check_number(value: Any, declared: Quantity, where: str) -> None:
    """**Raises** `InputError` that begins with `where` for a `value` that is no number, or none in the range."""
    if isinstance(value, Tracer):
        return
    numeric = isinstance(value, jax.Array | np.ndarray | np.generic) and jnp.issubdtype(value.dtype, jnp.floating)
    if not numeric:
        unit = f" in {declared.unit}" if declared.unit else ""
        raise InputError(f"{where}: found {value!r:.80}, expected a number{unit}.")
    if declared.may_vanish:
        declared = dataclasses.replace(declared, positive=False, low=0.0)
    for number in (value,) if isinstance(value, np.float64) else np.ravel(np.asarray(value)):
        check_range(float(number), declared, where)


def _check_choice(value: Any, options: dict[str, float], where: str) -> None:
    """**Raises** `InputError` that begins with `where` for a `value` that is no number of an option."""
    if isinstance(value, Tracer):
        return
    numeric = isinstance(value, jax.Array | np.ndarray | np.generic) and jnp.issubdtype(value.dtype, jnp.floating)
    if not numeric or not np.isin(np.asarray(value), list(options.values())).all():
        words = ", ".join(f'"{word}" ({number:g})' for word, number in options.items())
        raise InputError(f"{where}: found {value!s:.80}, expected one of {words}.")


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
    expected = [] if math.isfinite(value) else ["that is finite"]
    if math.isfinite(declared.low):
        expected.append(f"{'above' if declared.positive else 'of at least'} {shown(declared.low)}")
    if math.isfinite(declared.high):
        # An end that is legal itself is declared as the float next to it.
        last = math.nextafter(declared.high, -math.inf)
        is_legal = len(repr(last)) < len(repr(declared.high))
        expected.append(f"at most {shown(last)}" if is_legal else f"below {shown(declared.high)}")
    raise InputError(f"{where}: found {shown(value)}, expected a value {' and '.join(expected)}.")
