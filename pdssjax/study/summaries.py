"""One-sentence summaries of everything that a study may name, read from the files without importing them."""

from ..core import docstring_of, members

FAMILIES = {"drive": "drive", "piezo": "piezo", "friction": "friction", "measurement": "study.measurement"}
"""The families that a study chooses from: drives by `waveform`, measurements by `measures`, others in [actuator]."""

PARTS_OF_A_RIG = ("effector", "stop", "amplifier", "sensor")
"""The keys of `pdssjax.actuator.PARTS`, told without loading it."""


def entry_names() -> list[str]:
    """Names of all members and parts, family by family: "friction/lugre", "sensor"."""
    return [*(f"{said}/{name}" for said, family in FAMILIES.items() for name in members(family)), *PARTS_OF_A_RIG]


def first_sentence(told: str) -> str:
    """The first sentence of a docstring, on one line."""
    return " ".join(told.split("\n\n")[0].split())


def entry_summaries() -> dict[str, str]:
    """The first sentence of each member's module, or of a part's class, by name."""
    return {name: first_sentence(_module_text(name)) for name in entry_names()}


def _module_text(name: str) -> str:
    said, mark, short = name.partition("/")
    if mark:
        return docstring_of(f"{FAMILIES[said]}.{short.replace('-', '_')}")
    return docstring_of("actuator.parts", name.capitalize())
