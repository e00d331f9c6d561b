"""What can be chosen in a study, as plain text."""

import textwrap
from collections.abc import Mapping
from typing import TYPE_CHECKING

from ._layout import aligned_table, heading

if TYPE_CHECKING:
    from ...study import Entry


def format_catalogue(summaries: Mapping[str, str]) -> str:
    """All members and parts, by name what each is, one line each."""
    return aligned_table("<<", [["", "what it is"], *map(list, summaries.items())])


def format_entry(entry: "Entry") -> str:
    """One member: its parameters, and its equations as its module tells them."""
    from ...core import display_unit

    head = ["", "unit", "nominal", "", "what it is"]
    rows = [
        [name, unit, f"{declared.nominal * scale:.6g}", "optional" if declared.optional else "", told]
        for name, (declared, told) in entry.parameters.items()
        for unit, scale in [display_unit(declared.unit)]
    ]
    rows += [[name, "", "", "one of", ", ".join(words)] for name, words in entry.choices.items()]
    text = textwrap.indent(entry.text, "    ")
    return heading(entry.name) + f"{text}\n\n" + (aligned_table("<<><<", [head, *rows]) if rows else "")
