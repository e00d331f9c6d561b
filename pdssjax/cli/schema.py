"""`pdssjax schema`: prints the JSON schema of the study file."""

import argparse

from .subcommands import Subcommands


def schema(options: argparse.Namespace) -> int:
    from ..files import schema_text

    print(schema_text(), end="")
    return 0


def add_parser(subcommands: Subcommands) -> None:
    """Adds the command `schema`, which has no options."""
    text = "print the JSON schema of the study file, with which editors complete and check it"
    parser = subcommands.add_parser("schema", help=text, description=text)
    parser.set_defaults(run=schema)
