"""`pdssjax example`: copies the packaged study."""

import argparse
from pathlib import Path

from ..core import InputError
from ..files import EXAMPLE
from .console import say


def example(options: argparse.Namespace) -> int:
    import shutil

    folder = options.folder
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: found something there already, expected an empty folder or nothing.")
    shutil.copytree(EXAMPLE, folder, dirs_exist_ok=True)
    say(f"Edit {folder / 'study.toml'}, then run: pdssjax identify {folder / 'study.toml'} --out {folder / 'out'}")
    return 0


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `example`."""
    parser.set_defaults(run=example)
    parser.add_argument("folder", type=Path, metavar="DIR", help="new or empty folder")
