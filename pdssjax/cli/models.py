"""`pdssjax models`: lists what a study may name, or explains one of them."""

import argparse

from .console import say


def models(options: argparse.Namespace) -> int:
    say(_explained(options.name) if options.name else _listed(), end="")
    return 0


def _listed() -> str:
    """All of them; none is loaded for it, nor JAX."""
    from ..report.text import format_catalogue
    from ..study import entry_summaries

    return format_catalogue(entry_summaries())


def _explained(name: str) -> str:
    from ..report.text import format_entry
    from ..study import find_entry

    return format_entry(find_entry(name))


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `models`."""
    parser.set_defaults(run=models)
    parser.add_argument(
        "name", nargs="?", metavar="NAME", help='one of them, such as "lugre": equations and parameters'
    )
