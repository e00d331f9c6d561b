"""`pdssjax models`: lists what a study may name, or explains one of them."""

import argparse

from .subcommands import Subcommands


def models(options: argparse.Namespace) -> int:
    from ..report.text import format_catalogue, format_entry
    from ..study import catalogue_entries, find_entry

    print(format_entry(find_entry(options.name)) if options.name else format_catalogue(catalogue_entries()), end="")
    return 0


def add_parser(subcommands: Subcommands) -> None:
    """Adds the command `models` with its options."""
    text = (
        "list the drives, piezos, friction laws, measurements and parts of a rig that a study may name, or explain one"
    )
    parser = subcommands.add_parser("models", help=text, description=text)
    parser.set_defaults(run=models)
    parser.add_argument(
        "name", nargs="?", metavar="NAME", help='one of them, such as "lugre": equations and parameters'
    )
