"""`pdssjax example`: copies the packaged study."""

import argparse
from pathlib import Path

from .console import say


def example(options: argparse.Namespace) -> int:
    from ..files import copy_example

    folder = options.folder
    copy_example(folder)
    say(f"Edit {folder / 'study.toml'}, then run: pdssjax identify {folder / 'study.toml'} --out {folder / 'out'}")
    return 0


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.set_defaults(run=example)
    parser.add_argument("folder", type=Path, metavar="DIR", help="new or empty folder")
