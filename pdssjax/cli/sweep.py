"""`pdssjax sweep`: net step, speed and step efficiency over a grid of drive quantities and parameters."""

import argparse
import json
from pathlib import Path

from ..core import InputError
from .console import counter, say
from .numbers import add_numbers, study_of
from .results import add_out, keep_results, say_where
from .subcommands import Subcommands


def sweep(options: argparse.Namespace) -> int:
    from ..core import prepare_jax
    from ..files import check_free, check_store, write_sweep
    from ..report.text import format_numbers, format_sweep

    check_free(options.out, options.overwrite)
    check_store(options.store)
    prepare_jax()
    import pdssjax

    from .axis import read_axis

    study = study_of(options)
    legal = study.legal()
    given = [(f"drive.{name}", getattr(options, name)) for name in ("voltage", "frequency")]
    given += [_axis(text) for text in options.vary]
    over = {path: read_axis(path, text, legal) for path, text in given if text is not None}
    with counter("points") as count:
        data = pdssjax.sweep(study, over, record=options.record, cycles=options.cycles, progress=count)
    say(format_numbers(json.loads(data.attrs["parameters"])))
    say(format_sweep(data), end="")
    written = keep_results(lambda place: write_sweep(data, place, options.store), options.out)
    return say_where(written, f"Results are in {options.out}")


def _axis(text: str) -> tuple[str, str]:
    path, equals, values = text.partition("=")
    if not equals:
        raise InputError(
            f'option --vary: found "{text}", expected a path and a range such as "drive.fall_time=0 ms:2 ms:20".'
        )
    return path.strip(), values


def add_parser(subcommands: Subcommands) -> None:
    """Adds the command `sweep` with its options."""
    text = "net step, speed and step efficiency over a grid of drive quantities and parameters"
    parser = subcommands.add_parser("sweep", help=text, description=text)
    parser.set_defaults(run=sweep)
    parser.add_argument("study", type=Path, metavar="STUDY", help="study file (TOML)")
    add_numbers(parser)
    parser.add_argument(
        "--voltage", metavar="FROM:TO:COUNT", help='axis of the drive, such as 20:80:40 or "20 V:80 V:40"'
    )
    parser.add_argument("--frequency", metavar="FROM:TO:COUNT", help="axis of the drive; 2:50:25:log for equal ratios")
    parser.add_argument(
        "--vary",
        action="append",
        default=[],
        metavar="PATH=FROM:TO:COUNT",
        help='any other axis, such as "drive.fall_time=0 ms:2 ms:20"; may be repeated',
    )
    parser.add_argument("--record", metavar="NAME", help="the effector record whose drive to vary (default: the first)")
    parser.add_argument("--cycles", type=int, default=4, help="the cycle that is measured (default 4)")
    parser.add_argument("--store", choices=["netcdf", "zarr"], default="netcdf", help="format (default netcdf)")
    add_out(parser)
