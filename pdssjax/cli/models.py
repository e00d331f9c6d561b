"""`pdssjax models`: lists what a study may name, or explains one of them."""

import argparse

from .console import say


def models(options: argparse.Namespace) -> int:
    from ..report.text import format_catalogue, format_entry

    if options.name:
        from ..study import find_entry

        say(format_entry(find_entry(options.name)), end="")
    else:
        # All of them are listed from their files: none is loaded for it, nor JAX.
        from ..study import entry_summaries

        say(format_catalogue(entry_summaries()), end="")
    return 0


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.set_defaults(run=models)
    text = 'a member, such as "lugre", of which to show equations and parameters (default: list all)'
    parser.add_argument("name", nargs="?", metavar="NAME", help=text)
