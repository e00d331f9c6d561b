"""`pdssjax example`: copies the packaged study."""

import argparse
from pathlib import Path

from ..files import EXAMPLE
from .console import say


def example(options: argparse.Namespace) -> int:
    import shutil

    from ..files import check_empty

    folder = options.folder
    check_empty(folder)
    shutil.copytree(EXAMPLE, folder, dirs_exist_ok=True)
    say(f"Edit {folder / 'study.toml'}, then run: pdssjax identify {folder / 'study.toml'} --out {folder / 'out'}")
    return 0


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `example`."""
    parser.set_defaults(run=example)
    parser.add_argument("folder", type=Path, metavar="DIR", help="new or empty folder")
