"""What each command of `pdssjax` does; each takes the parsed options and returns the exit status.

What takes long to import is imported where it is used, so that help comes at once.
"""

import argparse
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .console import counter, progress
from .errors import InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from .estimate import FittedRecord
    from .records import Record

EXAMPLE = Path(__file__).parent / "example"
"""Folder of the packaged study."""


def identify(options: argparse.Namespace) -> int:
    from .output import check_free, write_estimate
    from .report import format_comparison, format_report
    from .runtime import prepare_jax

    methods: list[Any] = ["joint", "sequential"] if options.method == "both" else [options.method]
    folders = {method: options.out / method if len(methods) > 1 else options.out for method in methods}
    for folder in folders.values():
        check_free(folder, options.overwrite)
    prepare_jax()
    import pdssjax

    study = pdssjax.load_study(options.study)
    estimates = {}
    with progress() as say:
        for method, folder in folders.items():
            estimates[method] = pdssjax.identify(study, method=method, progress=say)
            say("writing report, predictions and plots")
            write_estimate(estimates[method], folder)
    for estimate in estimates.values():
        print(format_report(estimate))
    if len(methods) > 1:
        print(format_comparison(estimates["joint"], estimates["sequential"]))
    print(f"Results are in {options.out}")
    lost = [method for method, estimate in estimates.items() if not estimate.converged]
    for method in lost:
        print(f"pdssjax: warning: the {method} fit did not converge: {estimates[method].message}", file=sys.stderr)
    return 3 if lost else 0


def simulate(options: argparse.Namespace) -> int:
    from .output import check_free, write_predictions
    from .report import format_records
    from .runtime import prepare_jax

    check_free(options.out, options.overwrite)
    prepare_jax()

    study = _study(options)
    with progress() as say:
        say("simulating")
        records = [_compared(*pair) for pair in zip(study.records, study.predict({}), strict=True)]
        say("writing predictions and plots")
        write_predictions(records, options.out)
    print(format_records(records))
    print(f"Results are in {options.out}")
    return 0


def _study(options: argparse.Namespace, virtual: bool = False) -> Any:
    """The study of a command, with the numbers of `--estimate` where that is given."""
    import pdssjax

    study = pdssjax.load_study(options.study, virtual=True) if virtual else pdssjax.load_study(options.study)
    if options.estimate is None:
        return study
    from .identified import with_estimate

    return with_estimate(study, options.estimate)


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
    from .report import format_records
    from .runtime import prepare_jax

    check_free(options.out, options.overwrite)
    prepare_jax()

    from .estimate import compare
    from .virtual_rig import make_recordings, truth

    study = _study(options, virtual=True)
    with progress() as say:
        say("simulating")
        made = make_recordings(study, options.seed)
        say("writing records and plots")
        compared = [compare(r.record, r.true, noise=r.record.noise or 0.0, offset=r.offset) for r in made]
        write_recordings(made, compared, truth(study, made, options.seed), options.study, options.out)
    print(format_records(compared))
    print(f"Records are in {options.out / 'records'}")
    print(f"Identify them with: pdssjax identify {options.out / 'records' / options.study.name} --out ...")
    return 0


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
    print("\n".join(map(format_characterisation, found)), end="")
    if options.out:
        write_characterisations(found, options.out)
        print(f"\nResults are in {options.out}")
    return 0


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
    from .report import format_sweep
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
    write_sweep(data, options.out, options.store)
    print(format_sweep(data), end="")
    print(f"Results are in {options.out}")
    return 0


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
