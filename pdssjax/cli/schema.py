"""`pdssjax schema`: prints the JSON schema of the study file."""

import argparse

from .console import say


def schema(options: argparse.Namespace) -> int:
    from ..files import schema_text

    say(schema_text(), end="")
    return 0


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.set_defaults(run=schema)
