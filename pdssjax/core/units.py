"""Numbers and texts with units, such as "0.1007 um/V", as SI floats.

A number stands for SI already.  pint is loaded when the first text is met, since loading
it takes longer than everything else done with a study file.
"""

import functools
import math
import re
import unicodedata
from decimal import Decimal
from typing import Any

from .errors import InputError

_NUMBER_AND_UNIT = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")

_AFTER_COMMA = re.compile(r",\d")
"""How what follows a number begins where it has a decimal comma."""

_HERTZ = re.compile(r"hz\b|hertz\b", re.IGNORECASE)

_GRAM = ', a gram (standard gravity is written "g_0", of a column in [record.units])'

_LONGEST = 80
"""Characters of what was given that a message quotes."""

_MOST = 200
"""Characters of a number with its unit, or of a unit, that are read."""

_POWER = re.compile(r"\*\*|\^")

_SMALL_POWER = re.compile(
    r"(?:\*\*|\^)\s*(?:[+-]?\d{1,2}(?:\.\d+)?|\(\s*[+-]?\d{1,2}(?:\.\d+|\s*/\s*\d{1,2})?\s*\))(?![\d.]|\s*(?:\*\*|\^))"
)
"""A power of one or two digits or a fraction, which is no power itself: pint computes it at once."""

_COMMON = {
    **{name: (name, 1.0) for name in ("m", "s", "V", "N", "Hz", "kg")},
    **{name: ("m", size) for name, size in (("mm", 1e-3), ("um", 1e-6), ("µm", 1e-6), ("nm", 1e-9))},
    **{name: ("s", size) for name, size in (("ms", 1e-3), ("us", 1e-6))},
    **{"g": ("kg", 1e-3), "mV": ("V", 1e-3), "kHz": ("Hz", 1e3), "mN": ("N", 1e-3)},
    **{"um/V": ("m/V", 1e-6), "N/um": ("N/m", 1e6), "um/s": ("m/s", 1e-6), "mm/s": ("m/s", 1e-3)},
}
"""Units of most studies, each with its SI unit: pint takes most of a second to load."""

_SUPERSCRIPTS = re.compile("[\u2070\u00b9\u00b2\u00b3\u2074-\u2079]+")

_LARGEST_POWER = 100.0
"""Product of all the powers in a unit at most: a power of powers of powers is a number that never ends."""

_NOT_FINITE = re.compile(r"\s*[+-]?(nan|inf(inity)?)\b", re.IGNORECASE)


def to_si(given: object, unit: str, where: str, shown: str = "") -> float:
    """`given`, a number in SI or a text "number unit", as a float in the SI unit `unit`.

    Of an angular frequency [rad/s] cycles a second are understood, too: "200 Hz" is 200 * 2 pi rad/s.  Where the user
    gives numbers in another unit than `unit`, `shown` is that which messages name.

    **Raises:** `InputError` that begins with `where` if `given` is neither, if its unit is
    unknown or of another dimension than `unit` ("" for a pure number), or if it is not
    finite.
    """
    if isinstance(given, str):
        value = _text_to_si(given, unit, where, shown)
    elif isinstance(given, int | float) and not isinstance(given, bool):
        try:
            value = float(given)
        except OverflowError:  # an integer beyond all floats
            value = math.inf
    else:
        raise InputError(f"{where}: found {_shown(given)}, expected {_example(shown or unit)}.")
    if not math.isfinite(value):
        raise InputError(f"{where}: found {_shown(given)}, expected a finite number.")
    return value


def factor(name: str, unit: str, where: str) -> float:
    """How many of the SI unit `unit` make one of the unit called `name`.

    Radians count as a dimension here, though not in SI: Hz and rad/s do not convert to each other, instead of
    being wrong by 2 pi.

    **Raises:** `InputError` that begins with `where` if `name` is not a unit or is one of
    another dimension.
    """
    if name == unit and name:
        return 1.0
    if name in _COMMON and _COMMON[name][0] == unit:
        return _COMMON[name][1]
    registry = _registry()
    try:
        unit_amount = registry.Quantity(1.0, _parsed(name))
        given = unit_amount.to_root_units()
    except Exception:  # pint's parser lets errors of many types through
        raise InputError(f"{where}: found the unknown unit {_shown(name)}, expected {_of(unit)}.") from None
    expected = registry.Quantity(1.0, registry.parse_units(unit))
    if given.units != expected.to_root_units().units:
        found = f"the unit {_shown(name)}" if name else "no unit"
        hint = _GRAM if name == "g" and expected.check("[acceleration]") else ""
        raise InputError(f"{where}: found {found}{hint}, expected {_of(unit)}.")
    return float(unit_amount.to(expected.units).magnitude)


def split_text(given: str, where: str) -> tuple[float, str]:
    """The number and the unit of a text such as "0.5 um/V"; the unit is "" where there is none.

    **Raises:** `InputError` that begins with `where` if it does not begin with a number.
    """
    number, name = _split(given, where, "a number and a unit")
    return float(number), name


def unit_given(given: object, unit: str) -> tuple[str, float]:
    """The unit that a legal text `given` has, and what one of it is in the SI unit `unit`; that unit of a number."""
    name = split_text(given, "")[1] if isinstance(given, str) else ""
    return (name, to_si(f"1 {name}", unit, "")) if name else (unit, 1.0)


@functools.cache
def unit_named(text: str) -> str:
    """The unit that an instrument writes as `text` ("Volt", "[um]", "(ms)"), for `factor`; "" where it is none."""
    name = text.strip().strip("()[]{}<>").strip().replace("\u03bc", "\u00b5")
    if name in _COMMON or not name or name[0].isdigit():
        return name if name in _COMMON else ""
    for spelled in (name, name.lower()) if len(name) > 3 else (name,):
        try:
            if _parsed(spelled).dimensionality:
                return spelled
        except Exception:  # pint's parser lets errors of many types through
            continue
    return ""


def column_unit(column: str) -> str:
    """The unit at the end of a column's name: "um" of "displacement_um"; "" if none is there."""
    return column.rpartition("_")[2] if "_" in column else ""


@functools.cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry()


def _parsed(name: str) -> Any:
    """The unit called `name`, by pint; **raises** `ValueError` where computing its powers would not end."""
    spelled = _SUPERSCRIPTS.sub(lambda digits: f"**{unicodedata.normalize('NFKC', digits[0])}", name)
    powers = _SMALL_POWER.findall(spelled)
    largest = math.prod(max(1.0, *map(float, re.findall(r"\d+", power))) for power in powers)
    if len(name) > _MOST or len(powers) < len(_POWER.findall(spelled)) or largest > _LARGEST_POWER:
        raise ValueError(name)
    return _registry().parse_units(name)


def _text_to_si(given: str, unit: str, where: str, shown: str) -> float:
    expected = "a finite number" if _NOT_FINITE.match(given) else _example(shown or unit)
    number, name = _split(given, where, expected)
    if unit == "rad/s" and _HERTZ.search(name):
        return float(number) * factor(name, "Hz", where) * 2.0 * math.pi
    scale = factor(name, unit, where)
    try:
        # In decimals, since "86 g" is to be 0.086 kg and not 0.08600000000000001 kg.
        return float(Decimal(number) * Decimal(repr(scale)))
    except ArithmeticError:  # an exponent that decimals do not hold
        return float(number) * scale


def _split(given: str, where: str, expected: str) -> tuple[str, str]:
    """The number and the unit in a text, as they are written."""
    split = _NUMBER_AND_UNIT.fullmatch(given) if len(given) <= _MOST else None
    if split is None:
        raise InputError(f"{where}: found {_shown(given)}, expected {expected}.")
    number, name = split.groups()
    if _AFTER_COMMA.match(name):
        raise InputError(f'{where}: found {_shown(given)}, expected a decimal point: "{given.replace(",", ".", 1)}".')
    return number, name


def _shown(given: object) -> str:
    try:
        text = f'"{given}"' if isinstance(given, str) else str(given)
    except ValueError:  # more digits than Python writes
        return "an integer of thousands of digits"
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def _of(unit: str) -> str:
    return f"a unit that converts to {unit}" if unit else "a pure number"


def _example(unit: str) -> str:
    return f'a number [{unit}] or a text such as "1 {unit}"' if unit else "a pure number"
