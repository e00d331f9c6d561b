"""`pdssjax report`: results as one HTML page for a colleague."""

import argparse
from pathlib import Path

from ..core import InputError
from .console import note, progress
from .results import NOT_WRITTEN, say_where


def report(options: argparse.Namespace) -> int:
    from ..files import own_page

    own = own_page(options.folder)
    if own is not None and options.out is None:
        return say_where(True, f"The page is in {own}")
    file = options.folder / "report.html" if options.out is None else options.out
    if file.exists() and not options.overwrite:
        raise InputError(f"{file}: found a file there already; expected another --out, or --overwrite.")
    with progress() as tell:
        tell("drawing")
        from ..files import read_page
        from ..report.page import write_page

        page = None if own is not None else read_page(options.folder)
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            if own is not None:
                file.write_bytes(own.read_bytes())
            elif page is not None:
                write_page(file, page, overwrite=options.overwrite)
        except OSError as error:
            note(f"error: {file}: cannot be written to ({error.strerror or error})")
            return NOT_WRITTEN
    return say_where(True, f"The page is in {file}")


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.set_defaults(run=report)
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder of results, such as that of identify")
    text = "HTML file to write (default: report.html in DIR)"
    parser.add_argument("--out", type=Path, metavar="FILE", help=text)
    parser.add_argument("--overwrite", action="store_true", help="replace a file that is there already")
