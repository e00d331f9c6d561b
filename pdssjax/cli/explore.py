"""`pdssjax explore`: a page in the browser with a slider for every number of a study."""

import argparse
import importlib.util
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from ..core import InputError
from .console import progress, say
from .numbers import add_numbers, with_numbers
from .option_values import whole

if TYPE_CHECKING:
    from ..study import Study


def explore(options: argparse.Namespace) -> int:
    from ..core import prepare_jax

    for library in ("panel", "tomlkit"):
        if importlib.util.find_spec(library) is None:
            raise InputError(f'explore: found no {library}, expected it installed: pip install "pdssjax[explore]"')
    prepare_jax(dedicated=True)
    from ..explore import Workbench, serve, settings_of
    from ..files import read_estimate_folder, read_sweep

    study, numbered = _study(options)
    estimate = None if options.estimate is None else read_estimate_folder(options.estimate)
    sweep = None if options.sweep is None else read_sweep(options.sweep)
    bench = Workbench(study, settings_of(numbered), estimate, sweep)
    with progress() as tell:
        tell("compiling for the first record")
        bench.warm()
    # Ends by Ctrl-C, which is no interruption here.
    if not serve(bench, options.port, not options.no_browser, say):
        # What compiles still would abort Python's orderly end; nothing of it is wanted.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)
    return 0


def _study(options: argparse.Namespace) -> tuple["Study", "Study"]:
    """The study with starts for its free parameters, and the study with the numbers that the page shows first."""
    import dataclasses

    import pdssjax

    study = pdssjax.load_study(options.study)
    if not study.records:
        raise InputError(f"{study.path}: found no record, expected one at least to be shown.")
    numbered = with_numbers(study, options)
    free = {path: p for path, p in study.parameters.items() if p.free}
    begun = dataclasses.replace(numbered, parameters=numbered.parameters | free)
    return begun.with_starts({path: numbered.values()[path] for path in free}), numbered


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.set_defaults(run=explore)
    parser.add_argument("study", type=Path, metavar="STUDY", help="study file (TOML)")
    add_numbers(parser)
    text = "show the map in the results of pdssjax sweep, to click points in"
    parser.add_argument("--sweep", type=Path, metavar="DIR", help=text)
    text = "port of the page (default: a free one)"
    parser.add_argument("--port", type=whole(0, 65535), default=0, metavar="N", help=text)
    parser.add_argument("--no-browser", action="store_true", help="say where the page is, and open no browser")
