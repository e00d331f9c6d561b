"""What each command of `pdssjax` does; each takes the parsed options and returns the exit status.

What takes long to import is imported where it is used, so that help comes at once.
"""

import argparse
import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .console import counter, progress, say
from .errors import InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from .estimate import FittedRecord
    from .records import Record

EXAMPLE = Path(__file__).parent / "example"
"""Folder of the packaged study."""
NOT_WRITTEN = 4
"""Exit status where results could not be written to the folder asked for."""


def identify(options: argparse.Namespace) -> int:
    from .output import check_free
    from .report import format_comparison
    from .runtime import prepare_jax

    methods: list[Any] = ["joint", "sequential"] if options.method == "both" else [options.method]
    folders = {method: options.out / method if len(methods) > 1 else options.out for method in methods}
    for folder in folders.values():
        check_free(folder, options.overwrite)
    prepare_jax()
    import pdssjax

    study = pdssjax.load_study(options.study)
    estimates: dict[str, Any] = {}
    written = True
    for method, folder in folders.items():
        estimates[method] = _identified(study, method, folder)
        written &= _report_and_keep(estimates[method], folder)
    if len(methods) > 1:
        say(format_comparison(estimates["joint"], estimates["sequential"]))
    if written:
        say(f"Results are in {options.out}")
    lost = [method for method, estimate in estimates.items() if not estimate.converged]
    for method in lost:
        print(f"pdssjax: warning: the {method} fit did not converge: {estimates[method].message}", file=sys.stderr)
    return NOT_WRITTEN if not written else 3 if lost else 0


def _identified(study: Any, method: Any, folder: Path) -> Any:
    """The estimate of a study; of a fit that is broken off the best point so far is kept in `folder`."""
    import pdssjax

    from .output import write_essentials
    from .report import format_report

    try:
        with progress() as tell:
            return pdssjax.identify(study, method=method, progress=tell)
    except pdssjax.FitInterrupted as interrupt:
        kept = interrupt.estimate
        if kept is None:
            print("pdssjax: nothing was fitted yet, and nothing is written", file=sys.stderr)
        else:
            say(format_report(kept))
            if _keep(lambda place: write_essentials(kept, place), folder, kept):
                what = "estimate" if kept.converged else "best point so far"
                print(f"pdssjax: the {what} is in {folder / 'estimate.json'}", file=sys.stderr)
        raise


def _report_and_keep(estimate: Any, folder: Path) -> bool:
    """Print the report of an `estimate`, then write all that belongs to it; whether `folder` took it."""
    from .output import write_essentials, write_estimate
    from .report import format_report

    try:
        say(format_report(estimate))
        with progress() as tell:
            tell("writing report, predictions and plots")
            return _keep(lambda place: write_estimate(estimate, place), folder, estimate)
    except KeyboardInterrupt:
        if _keep(lambda place: write_essentials(estimate, place), folder, estimate):
            print(f"pdssjax: the estimate is in {folder / 'estimate.json'}, without plots", file=sys.stderr)
        raise


def _keep(write: Callable[[Path], None], folder: Path, estimate: Any = None) -> bool:
    """`write` results to `folder`, or where that fails to one for temporary files, or print the `estimate`.

    Whether `folder` took them.
    """
    from .output import estimate_json, write_aside

    try:
        write(folder)
        return True
    except OSError as error:
        print(f"pdssjax: error: {folder}: cannot be written to ({error.strerror or error})", file=sys.stderr)
    try:
        print(f"pdssjax: the results are in {write_aside(write)} instead", file=sys.stderr)
    except OSError as error:
        lost = "the results are lost" if estimate is None else "the estimate is printed here"
        print(f"pdssjax: nor is there room for temporary files ({error.strerror or error}); {lost}", file=sys.stderr)
        if estimate is not None:
            say(estimate_json(estimate))
    return False


def simulate(options: argparse.Namespace) -> int:
    from .output import check_free, write_predictions
    from .report import format_numbers, format_records
    from .runtime import prepare_jax

    check_free(options.out, options.overwrite)
    prepare_jax()
    from .identified import numbers_used

    study = _study(options)
    used = numbers_used(study)
    with progress() as tell:
        tell("simulating")
        records = [_compared(*pair) for pair in zip(study.records, study.predict(), strict=True)]
    say(format_numbers(used))
    say(format_records(records))
    with progress() as tell:
        tell("writing predictions and plots")
        written = _keep(lambda place: write_predictions(records, used, place), options.out)
    return _told(written, f"Results are in {options.out}")


def _told(written: bool, where: str) -> int:
    """The exit status; says `where` the results are if they were `written` there."""
    if written:
        say(where)
    return 0 if written else NOT_WRITTEN


def _study(options: argparse.Namespace, virtual: bool = False) -> Any:
    """The study of a command, with the numbers of `--estimate`, and those of `--guess` for what then is missing."""
    import pdssjax

    study = pdssjax.load_study(options.study, virtual=True) if virtual else pdssjax.load_study(options.study)
    if options.estimate is not None:
        from .identified import with_estimate

        study = with_estimate(study, options.estimate)
    if options.guess and (missing := study.missing()):
        with progress() as tell:
            tell("guessing from the records")
            guess = pdssjax.initial_guess(study)
        study = study.with_values({path: guess[path] for path in missing}, "guess from the records")
    return study


def _compared(record: "Record", predicted: "ArrayLike") -> "FittedRecord":
    """A record beside its simulation, which gets the record's own zero: given, or the best fit to the data."""
    import numpy as np

    from .estimate import compare

    motion = np.asarray(predicted)
    offset = float(np.mean(record.measured - motion)) if record.offset is None else record.offset
    noise = float("nan") if record.noise is None else record.noise
    return compare(record, motion, noise=noise, offset=offset)


def record(options: argparse.Namespace) -> int:
    from .output import check_free, write_recordings
    from .report import format_numbers, format_records
    from .runtime import prepare_jax

    check_free(options.out, options.overwrite)
    prepare_jax()

    from .estimate import compare
    from .identified import numbers_used
    from .virtual_rig import make_recordings, truth

    study = _study(options, virtual=True)
    used = numbers_used(study)
    with progress() as tell:
        tell("simulating")
        made = make_recordings(study, options.seed)
    compared = [compare(r.record, r.true, noise=r.record.noise or 0.0, offset=r.offset) for r in made]
    say(format_numbers(used))
    say(format_records(compared))
    went_in = truth(study, made, options.seed)
    with progress() as tell:
        tell("writing records and plots")
        write = lambda place: write_recordings(made, compared, went_in, used, options.study, place)
        written = _keep(write, options.out)
    again = f"pdssjax identify {options.out / 'records' / options.study.name} --out ..."
    return _told(written, f"Records are in {options.out / 'records'}\nIdentify them with: {again}")


def characterise(options: argparse.Namespace) -> int:
    from .output import check_free, write_characterisations
    from .report import format_characterisation
    from .runtime import prepare_jax
    from .units import to_si

    number = lambda given, unit, option: to_si(_plain(given), unit, f"option {option}")
    frequency = number(options.frequency, "Hz", "--frequency") if options.frequency else None
    slip_duration = number(options.slip_duration, "s", "--slip-duration")
    window = None
    if options.window:
        start, end = (number(end, "s", "--window") for end in options.window)
        window = (start, end)
        if start >= end:
            raise InputError(f"option --window: found {start:g} s to {end:g} s, expected an end after its start.")
    units = _units(options.unit)
    if options.out:
        check_free(options.out, options.overwrite)
    prepare_jax()
    from .characterise import characterise

    columns = {name: getattr(options, name) for name in ("time", "displacement", "force")}
    found = [
        characterise(file, **columns, units=units, frequency=frequency, window=window, slip_duration=slip_duration)
        for file in options.files
    ]
    say("\n".join(map(format_characterisation, found)), end="")
    if not options.out:
        return 0
    written = _keep(lambda place: write_characterisations(found, place), options.out)
    return _told(written, f"\nResults are in {options.out}")


def _plain(given: str) -> float | str:
    """A number without a unit, which is SI, or else the text."""
    try:
        return float(given)
    except ValueError:
        return given


def _units(given: list[str]) -> dict[str, str]:
    """Units by quantity, from options such as "displacement=um"."""
    units = {}
    for text in given:
        quantity, _, unit = (part.strip() for part in text.partition("="))
        if quantity not in ("time", "displacement", "force") or not unit:
            raise InputError(
                f'option --unit: found "{text}", expected time, displacement or force, "=" and a unit: '
                '"displacement=um".'
            )
        units[quantity] = unit
    return units


def sweep(options: argparse.Namespace) -> int:
    from .output import check_free, check_store, write_sweep
    from .report import format_numbers, format_sweep
    from .runtime import prepare_jax

    check_free(options.out, options.overwrite)
    check_store(options.store)
    prepare_jax()
    import pdssjax

    from .ranges import read_axis

    study = _study(options)
    legal = study.legal()
    given = [(f"drive.{name}", getattr(options, name)) for name in ("voltage", "frequency")]
    given += [_axis(text) for text in options.vary]
    over = {path: read_axis(path, text, legal) for path, text in given if text is not None}
    with counter("points") as count:
        data = pdssjax.sweep(study, over, record=options.record, cycles=options.cycles, progress=count)
    say(format_numbers(json.loads(data.attrs["parameters"])))
    say(format_sweep(data), end="")
    written = _keep(lambda place: write_sweep(data, place, options.store), options.out)
    return _told(written, f"Results are in {options.out}")


def _axis(text: str) -> tuple[str, str]:
    path, equals, values = text.partition("=")
    if not equals:
        raise InputError(
            f'option --vary: found "{text}", expected a path and a range such as "drive.fall_time=0 ms:2 ms:20".'
        )
    return path.strip(), values


def models(options: argparse.Namespace) -> int:
    from .catalogue import catalogue, find_entry
    from .report import format_catalogue, format_entry

    print(format_entry(find_entry(options.name)) if options.name else format_catalogue(catalogue()), end="")
    return 0


def example(options: argparse.Namespace) -> int:
    folder = options.folder
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: found something there already, expected an empty folder or nothing.")
    shutil.copytree(EXAMPLE, folder, dirs_exist_ok=True)
    print(f"Edit {folder / 'study.toml'}, then run: pdssjax identify {folder / 'study.toml'} --out {folder / 'out'}")
    return 0
