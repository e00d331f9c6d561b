"""`pdssjax sweep --border`: where a metric passes a level along one axis, at every point of the others."""

import argparse
from collections.abc import Mapping
from typing import TYPE_CHECKING

from ..core import InputError, nearest
from .console import progress, say
from .option_values import read_axis, read_number, read_range, read_whole, unit_of
from .results import keep_results, say_where

if TYPE_CHECKING:
    from ..core import Quantity
    from ..study import Study

_COARSE = 9
"""Values of the axis that are looked at first where its range has no count."""

_WITHOUT = ("sample", "bands", "metrics", "derivatives", "scheduler", "resume", "explain")
"""Options that say nothing to a border."""


def sweep_border(study: "Study", texts: Mapping[str, str], options: argparse.Namespace) -> int:
    """Find the border, write it and print it; `texts` are the axes as they were written, by path."""
    from ..files import write_border
    from ..report.text import format_border
    from ..sweeps import METRICS, driven_record, find_border, sweepable, sweepable_choices

    base = driven_record(study, options.record)
    legal, words = sweepable(study, base), sweepable_choices(base)
    path, tolerance = _named_number("--border", options.border, "drive.voltage=0.2 V")
    metric, level = _named_number("--border-at", options.border_at, "efficiency=0.01")
    if metric not in METRICS:
        raise InputError(f'option --border-at: found the unknown metric "{metric}"; {nearest(metric, METRICS)}')
    ends, coarse = _along(path, texts, legal)
    over = {other: read_axis(other, text, legal, words) for other, text in texts.items() if other != path}
    near = read_number(tolerance, unit_of(path, legal), "option --border", above=0.0)
    passed = read_number(level, METRICS[metric].unit.replace("1", ""), "option --border-at")
    with progress() as tell:
        tell(f"looking for the border along {path}")
        data = find_border(
            study,
            path,
            ends,
            over,
            tolerance=near,
            metric=metric,
            level=passed,
            coarse=coarse,
            record=options.record,
            cycles=options.cycles,
            workers=options.workers,
        )
    written = keep_results(lambda place: write_border(data, place, options.store), options.out)
    say(format_border(data), end="")
    return say_where(written, f"Results are in {options.out}")


def check_alone(options: argparse.Namespace) -> None:
    """**Raises** `InputError` for options that do not go with --border."""
    for name in _WITHOUT:
        if getattr(options, name) not in (None, "", False):
            raise InputError(f"option --border: found with --{name}, expected without: it is looked for by halving.")


def _along(path: str, texts: Mapping[str, str], legal: "Mapping[str, Quantity]") -> tuple[tuple[float, float], int]:
    """The ends [SI] of the range of `path`, and how many values of it are looked at first."""
    if path not in texts:
        raise InputError(f'option --border: found no range for "{path}", expected one such as --vary "{path}=FROM:TO".')
    low, _, high_and_count = texts[path].partition(":")
    high, colon, count = high_and_count.partition(":")
    where = f'sweep: path "{path}": "{texts[path]}" as FROM:TO or FROM:TO:COUNT: COUNT'
    number = read_whole(count.strip(), where, 2) if colon else _COARSE
    return read_range(path, f"{low}:{high}" if high else low, legal), number


def _named_number(option: str, text: str, example: str) -> tuple[str, str]:
    name, equals, number = text.partition("=")
    if not equals or not number.strip():
        raise InputError(f'option {option}: found "{text}", expected a name and a number such as "{example}".')
    return name.strip(), number.strip()


def add_border(parser: argparse.ArgumentParser) -> None:
    """Add the options for the border."""
    parser.add_argument(
        "--border",
        metavar="PATH=TOLERANCE",
        help='in place of a map find by halving where the dead zone ends along an axis, such as "drive.voltage=0.2 V"; '
        "its range is FROM:TO, or FROM:TO:COUNT with so many values to look at first (default 9)",
    )
    parser.add_argument(
        "--border-at",
        default="efficiency=0.01",
        metavar="METRIC=LEVEL",
        help='what is passed at the border (default "efficiency=0.01": the dead zone); "speed=0": the motion reverses',
    )
