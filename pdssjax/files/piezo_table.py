"""The piezo of a study: a member by name, or one put together of dynamics, hysteresis and creep."""

from ..core import InputError, member, members
from ..piezo import DYNAMICS, HYSTERESES, MOST, Composition
from ..piezo.base import AbstractPiezo
from .toml_table import Table

_EXPECTED = 'a name such as "second-order", or a table such as { dynamics = "static", hysteresis = { law = "play" } }'

_ELEMENTS = 8
"""Of play or Maxwell slip, where a study does not say."""

_CREEP = 3


def read_piezo(actuator: Table) -> type[AbstractPiezo]:
    """The class that the key "piezo" of the table [actuator] describes.

    **Raises:** `InputError` for what is unknown, missing or out of range.
    """
    if not isinstance(actuator.entries.get("piezo"), dict):
        actuator.get("piezo", str, _EXPECTED)
        return member("piezo", actuator.option("piezo", members("piezo")))
    table = actuator.table("piezo", _EXPECTED)
    table.only(["dynamics", "hysteresis", "creep", "modes"])
    dynamics = table.option("dynamics", DYNAMICS)
    if "modes" in table.entries and dynamics != "rod":
        raise InputError(f'{table.at("modes")}: found modes of "{dynamics}" dynamics, expected them of a "rod" only.')
    made = Composition(dynamics, "none", 0, 1, 0, _count(table, "modes", 1))
    made = _with_hysteresis(table, made) if "hysteresis" in table.entries else made
    if "creep" in table.entries:
        creep = table.table("creep", "a table such as { elements = 3 }")
        creep.only(["elements"])
        made = made._replace(creep=_count(creep, "elements", _CREEP, "creep"))
    return member("piezo", f"composed:{made.text}")


def _with_hysteresis(table: Table, made: Composition) -> Composition:
    if isinstance(table.entries["hysteresis"], str):
        table = Table({"law": table.entries["hysteresis"]}, f"{table.where}: hysteresis")
    else:
        table = table.table("hysteresis", 'a table such as { law = "play", elements = 8, asymmetry = 3 }')
    law = table.option("law", HYSTERESES)
    elements = ["elements"] if law in ("play", "maxwell-slip") else []
    if "elements" in table.entries and not elements:
        raise InputError(f'{table.at("elements")}: found elements of "{law}", expected them of play or maxwell-slip.')
    table.only(["law", "elements", "asymmetry"])
    many = _count(table, "elements", _ELEMENTS) if elements else 0
    return made._replace(hysteresis=law, elements=many, asymmetry=_count(table, "asymmetry", 1))


def _count(table: Table, key: str, default: int, what: str = "") -> int:
    most = MOST[what or key]
    expected = f"a whole number from 1 to {most}"
    found = table.get(key, int, expected, default)
    if isinstance(found, bool) or not 1 <= found <= most:
        raise InputError(f"{table.at(key)}: found {str(found).lower()}, expected {expected}.")
    return found
