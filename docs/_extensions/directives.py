"""What pages of the site say in a fence and GitHub shows as text: tables and objects made from the package.

- `{python-object} pdssjax.identify`: a public name; `{family} friction`: every member of a family;
- `{command-options} sweep`: the options of a command;
- `{study-keys} record`: the keys of a part of the study file;
- `mermaid`: a chart, as boxes.
"""

from collections.abc import Callable

from command_options import commands, rows
from docutils import nodes
from docutils.statemachine import StringList
from python_objects import family_lines, markdown
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective
from storeys import boxes
from study_keys import lines_of


class Made(SphinxDirective):
    """A directive with one argument, which becomes Markdown."""

    required_arguments = 1
    make: Callable[[str], list[str]]

    def run(self) -> list[nodes.Node]:
        holder = nodes.container()
        lines = type(self).make(self.arguments[0])
        self.state.nested_parse(StringList(lines, self.get_location()), 0, holder)
        return holder.children


class Mermaid(SphinxDirective):
    """A fence of Mermaid."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        return [nodes.raw("", boxes("\n".join(self.content)), format="html")]


MADE = {
    "python-object": markdown,
    "family": family_lines,
    "command-options": lambda name: rows(commands()[name]),
    "study-keys": lines_of,
}


def setup(app: Sphinx) -> dict[str, bool]:
    """Adds the directives."""
    for name, make in MADE.items():
        app.add_directive(name, type(name, (Made,), {"make": staticmethod(make)}))
    app.add_directive("mermaid", Mermaid)
    return {"parallel_read_safe": True}
