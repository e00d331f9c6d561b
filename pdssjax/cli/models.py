"""`pdssjax models`: lists what a study may name, or explains one of them."""

import argparse


def models(options: argparse.Namespace) -> int:
    from ..report.text import format_catalogue, format_entry
    from ..study import catalogue_entries, find_entry

    print(format_entry(find_entry(options.name)) if options.name else format_catalogue(catalogue_entries()), end="")
    return 0


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `models`."""
    parser.set_defaults(run=models)
    parser.add_argument(
        "name", nargs="?", metavar="NAME", help='one of them, such as "lugre": equations and parameters'
    )
