"""One-sentence summaries of everything that a study may name, read from the files without importing them."""

from ..core import docstring_of, members

FAMILIES = {"drive": "drive", "piezo": "piezo", "friction": "friction", "measurement": "study.measurement"}
"""The families that a study chooses from: drives by `waveform`, measurements by `measures`, others in [actuator]."""

PARTS_OF_A_RIG = ("effector", "stop", "amplifier", "sensor")
"""The keys of `pdssjax.actuator.PARTS`, told without loading it."""


def entry_names() -> list[str]:
    """Names of all members and parts, family by family: "friction/lugre", "sensor"."""
    return [*(f"{said}/{name}" for said, family in FAMILIES.items() for name in members(family)), *PARTS_OF_A_RIG]


def first_sentence(docstring: str) -> str:
    """The first sentence of a docstring, on one line."""
    return " ".join(docstring.split("\n\n")[0].split())


def entry_summaries() -> dict[str, str]:
    """The first sentence of each member's module, or of a part's class, by name."""
    found = {name: docstring_of("actuator.parts", name.capitalize()) for name in PARTS_OF_A_RIG}
    for said, family in FAMILIES.items():
        found |= {f"{said}/{name}": docstring_of(f"{family}.{name.replace('-', '_')}") for name in members(family)}
    return {name: first_sentence(found[name]) for name in entry_names()}
