"""`pdssjax sweep`: net step, speed and step efficiency over a grid of drive quantities and parameters."""

import argparse
import contextlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core import MOST_POINTS, MOST_WORKERS, InputError, nearest
from .console import counter, note, progress, say
from .numbers import add_numbers, study_of
from .option_values import SEED, read_axis, read_number, read_range, read_whole, unit_of, whole
from .results import NOT_WRITTEN, NOTHING_FOUND, add_out, keep_results, reserved, say_where

if TYPE_CHECKING:
    import xarray

    from ..files import SweepStore
    from ..study import Record, Study
    from ..sweeps import AbstractPoints


def sweep(options: argparse.Namespace) -> int:
    if options.border is not None:
        for name in ("sample", "bands", "metrics", "derivatives", "scheduler", "resume", "explain"):
            if getattr(options, name) not in (None, "", False):
                raise InputError(
                    f"option --border: found with --{name}, expected without: it is looked for by halving."
                )
    with contextlib.nullcontext() if options.explain else reserved(options):
        return _sweep(options)


def _sweep(options: argparse.Namespace) -> int:
    import json

    from ..core import prepare_jax
    from ..files import bytes_needed, check_room, check_store, write_sweep
    from ..report.text import format_numbers, format_plan, format_sweep

    check_store(options.store)
    prepare_jax(dedicated=True)

    from ..sweeps import POINT_FAILURES, driven_record, plan_sweep, with_bands

    whole = study_of(options)
    base = driven_record(whole, options.record)
    study = whole.for_record(base)
    texts = _axis_texts(base, options)
    if options.border is not None:
        return _sweep_border(study, base, texts, options)
    points, errors = _points(study, base, texts, options), ""
    if options.bands is not None:
        points, errors = _about_the_estimate(whole, base, points, options)
    request: dict[str, Any] = {
        "record": options.record,
        "cycles": options.cycles,
        **_further_columns(study, base, points, options),
    }
    if options.explain:
        planned = plan_sweep(study, points, **request)
        check_room(planned.document, planned.plan, options.out)
        say(format_plan(planned, bytes_needed(planned.document, planned.plan)), end="")
        return 0
    data = _compute(study, points, request, options)
    if data is None:
        return NOT_WRITTEN
    if options.bands is not None:
        data = with_bands(data).assign_attrs(errors=errors)
    written = keep_results(lambda place: write_sweep(data, place, options.store), options.out)
    say(format_numbers(json.loads(data.attrs["parameters"])))
    say(format_sweep(data), end="")
    status = say_where(written, f"Results are in {options.out}")
    if status or bool(data.speed.notnull().any()):
        return status
    codes = data.failure.values.ravel().tolist()
    often = POINT_FAILURES[max(set(codes), key=codes.count)]
    note(f"error: none of the {len(codes)} points has a value; of most the failure is: {often}")
    return NOTHING_FOUND


def _compute(
    study: "Study", points: "AbstractPoints", request: dict[str, Any], options: argparse.Namespace
) -> "xarray.Dataset | None":
    """Run the sweep, and keep finished blocks on disk; None, and a line, where the disk takes no more."""
    import pdssjax

    from ..sweeps import cluster_executor

    store, address = _store(options), options.scheduler
    cluster = contextlib.nullcontext((None, None)) if address is None else cluster_executor(address)
    with cluster as (executor, workers), counter("points") as count:
        try:
            return pdssjax.sweep(
                study,
                points,
                **request,
                progress=count,
                workers=options.workers,
                executor=executor,
                in_flight=None if workers is None else 2 * workers,
                store=store,
            )
        except KeyboardInterrupt:
            if store is not None:
                note(f"the points that were done are in {store.place}; go on with --resume")
            raise
        except OSError as error:
            if store is None:
                raise
            kept = "; the points that were done are there: make room and go on with --resume"
            there = kept if store.place.exists() else ""
            note(f"error: {store.place}: cannot be written ({error.strerror or error}){there}.")
            return None


def _axis_texts(base: "Record", options: argparse.Namespace) -> dict[str, str]:
    """The axes that the options ask for, by path, as they were written."""
    from ..sweeps import sweepable_choices

    given = {f"drive.{name}": getattr(options, name) for name in ("voltage", "frequency")}
    texts = {path: text for path, text in given.items() if text is not None}
    for axis in options.vary:
        path, equals, values = axis.partition("=")
        if not equals:
            raise InputError(
                f'option --vary: found "{axis}", expected a path and a range such as "drive.fall_time=0 ms:2 ms:20".'
            )
        texts[path.strip()] = values
    if options.both_directions:
        if "drive.direction" not in sweepable_choices(base):
            raise InputError(
                'option --both-directions: found a drive without a direction, expected one such as "sawtooth".'
            )
        texts["drive.direction"] = "forward,backward"
    return texts


def _points(study: "Study", base: "Record", texts: Mapping[str, str], options: argparse.Namespace) -> "AbstractPoints":
    """The points that the options ask for; `texts` are the axes as they were written, by path."""
    from ..sweeps import Grid, LatinHypercube, Sobol, sweepable, sweepable_choices

    legal, words = sweepable(study, base), sweepable_choices(base)
    if options.sample is None:
        return Grid({path: read_axis(path, text, legal, words) for path, text in texts.items()})
    kind, _, count = options.sample.partition(":")
    kinds = {"sobol": Sobol, "latin-hypercube": LatinHypercube}
    if kind not in kinds or not count:
        raise InputError(f'option --sample: found "{options.sample}", expected sobol:COUNT or latin-hypercube:COUNT.')
    number = read_whole(count, "option --sample", 1, MOST_POINTS)
    ranges = {path: read_range(path, text, legal) for path, text in texts.items()}
    return kinds[kind](ranges, number, options.seed)


def _further_columns(
    study: "Study", base: "Record", points: "AbstractPoints", options: argparse.Namespace
) -> dict[str, tuple[str, ...]]:
    """The further metrics and the derivatives that the options ask for, as `sweep` takes them."""
    from ..sweeps import FURTHER, changes_a_sweep, sweepable

    named = lambda text: tuple(part.strip() for part in text.split(",") if part.strip())
    metrics = named(options.metrics)
    if metrics == ("all",):
        # All that can be had: a multiplier needs a steady cycle, a force something to push.
        known = {*study.parameters, *points.paths}
        lacks = {"multiplier": options.cycles != "steady", "output_force": "stop.stiffness" not in known}
        metrics = tuple(name for name in FURTHER if not lacks.get(name, False))
    legal = sweepable(study, base)
    every = tuple(path for path in study.parameters if path in legal and changes_a_sweep(path, study, metrics))
    derivatives = () if options.derivatives is None else named(options.derivatives) or every
    return {"metrics": metrics, "derivatives": derivatives}


def _about_the_estimate(
    study: "Study", base: "Record", points: "AbstractPoints", options: argparse.Namespace
) -> "tuple[AbstractPoints, str]":
    """The points crossed with draws about the estimate, or with its sigma points; and the error model of these."""
    import numpy as np

    from ..files import read_covariance, read_draws
    from ..study import paths_in
    from ..sweeps import CovarianceDraws, Crossed, GivenDraws, SigmaPoints, sweepable

    if options.estimate is None:
        raise InputError("option --bands: found no --estimate, expected the estimate.json that says what is known.")
    kept = options.bands in ("bootstrap", "posterior")
    here = study.for_record(base)
    legal, values = sweepable(here, base), here.values()
    if kept:
        (names, known), errors = read_draws(options.estimate, options.bands), options.bands
    else:
        names, known, errors = read_covariance(options.estimate)
    # Of the parameters that hold in the record; the others have no part in a sweep.
    in_force = {path: name for path, name in paths_in(study.parameters, base.conditions).items() if path in legal}
    told_otherwise = {*points.paths, *(f"drive.{field}" for field in base.overrides)}
    varied = [path for path, name in in_force.items() if name in names and path not in told_otherwise]
    rows = [names.index(in_force[path]) for path in varied]
    if kept:
        return Crossed(points, GivenDraws(varied, known[:, rows], options.draws)), errors
    means, positive = np.array([values[n] for n in varied]), np.array([legal[n].positive for n in varied])
    about = CovarianceDraws(varied, means, known[np.ix_(rows, rows)], positive, options.draws, options.seed)
    return Crossed(points, about if options.bands == "draws" else SigmaPoints(about)), errors


def _store(options: argparse.Namespace) -> "SweepStore | None":
    """Where the points are kept while they are computed; nowhere where Zarr is not installed."""
    from ..files import SWEEP_STORE, SweepStore, check_zarr

    try:
        check_zarr()
    except InputError:
        if options.resume:
            raise
        return None
    return SweepStore(options.out / SWEEP_STORE, options.resume, options.overwrite)


def _sweep_border(study: "Study", base: "Record", texts: Mapping[str, str], options: argparse.Namespace) -> int:
    """Find the border, write it and print it; `texts` are the axes as they were written, by path."""
    from ..files import write_border
    from ..report.text import format_border
    from ..sweeps import METRICS, find_border, sweepable, sweepable_choices

    legal, words = sweepable(study, base), sweepable_choices(base)
    path, tolerance = _named_number("--border", options.border, "drive.voltage=0.2 V")
    metric, level = _named_number("--border-at", options.border_at, "efficiency=0.01")
    if metric not in METRICS:
        raise InputError(f'option --border-at: found the unknown metric "{metric}"; {nearest(metric, METRICS)}')
    if path not in texts:
        raise InputError(f'option --border: found no range for "{path}", expected one such as --vary "{path}=FROM:TO".')
    low, _, high_and_count = texts[path].partition(":")
    high, colon, count = high_and_count.partition(":")
    where = f'sweep: path "{path}": "{texts[path]}" as FROM:TO or FROM:TO:COUNT: COUNT'
    coarse = read_whole(count.strip(), where, 2) if colon else 9
    ends = read_range(path, f"{low}:{high}" if high else low, legal)
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


def _named_number(option: str, text: str, example: str) -> tuple[str, str]:
    name, equals, number = text.partition("=")
    if not equals or not number.strip():
        raise InputError(f'option {option}: found "{text}", expected a name and a number such as "{example}".')
    return name.strip(), number.strip()


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.set_defaults(run=sweep)
    parser.add_argument("study", type=Path, metavar="STUDY", help="study file (TOML)")
    add_numbers(parser)
    text = 'axis of the drive, such as 20:80:40, "20 V:80 V:40" or 20,35,80'
    parser.add_argument("--voltage", metavar="FROM:TO:COUNT", help=text)
    parser.add_argument("--frequency", metavar="FROM:TO:COUNT", help="axis of the drive; 2:50:25:log for equal ratios")
    text = 'any other axis, such as "drive.fall_time=0 ms:2 ms:20"; may be repeated'
    parser.add_argument("--vary", action="append", default=[], metavar="PATH=FROM:TO:COUNT", help=text)
    parser.add_argument("--both-directions", action="store_true", help="drive forward and backward, as one more axis")
    text = "sobol:COUNT or latin-hypercube:COUNT points of the ranges, written FROM:TO, in place of a grid"
    parser.add_argument("--sample", metavar="KIND:COUNT", help=text)
    parser.add_argument("--seed", type=SEED, default=0, help="seed of the sample (default 0)")
    parser.add_argument(
        "--bands",
        nargs="?",
        const="linear",
        choices=["linear", "draws", "bootstrap", "posterior"],
        help="95 %% bands by what --estimate says of the parameters: to first order (default), or from draws of its "
        "covariance, or of the bootstrap or posterior that lies beside it",
    )
    parser.add_argument("--draws", type=whole(1), default=200, help="draws at each point (default 200)")
    parser.add_argument("--record", metavar="NAME", help="the effector record whose drive to vary (default: the first)")
    text = 'the cycle that is measured (default 4), or "steady": that after the transient'
    parser.add_argument("--cycles", type=whole(1, word="steady"), default=4, metavar="N", help=text)
    text = "further metrics, with commas between them: peak_friction, output_force, reversals, settled, grazing, "
    text += 'multiplier; or "all" that can be had'
    parser.add_argument("--metrics", default="", metavar="NAMES", help=text)
    text = "derivatives of all metrics that are smooth, by parameters and quantities of the drive with commas "
    text += "between them (default: by every parameter of the study)"
    parser.add_argument("--derivatives", nargs="?", const="", metavar="PATHS", help=text)
    text = 'in place of a map find by halving where the dead zone ends along an axis, such as "drive.voltage=0.2 V"; '
    text += "its range is FROM:TO, or FROM:TO:COUNT with so many values to look at first (default 9)"
    parser.add_argument("--border", metavar="PATH=TOLERANCE", help=text)
    text = 'what is passed at the border (default "efficiency=0.01": the dead zone); "speed=0": the motion reverses'
    parser.add_argument("--border-at", default="efficiency=0.01", metavar="METRIC=LEVEL", help=text)
    text = "format of the results (default netcdf)"
    parser.add_argument("--store", choices=["netcdf", "zarr"], default="netcdf", help=text)
    text = "threads on this machine (default: one a core)"
    parser.add_argument("--workers", type=whole(1, MOST_WORKERS), metavar="N", help=text)
    text = "run on the workers of a Dask scheduler, such as tcp://10.0.0.1:8786"
    parser.add_argument("--scheduler", metavar="ADDRESS", help=text)
    parser.add_argument("--resume", action="store_true", help="go on with a sweep of DIR that was interrupted")
    text = "say how many points and how much room it takes, and do nothing"
    parser.add_argument("--explain", action="store_true", help=text)
    add_out(parser)
