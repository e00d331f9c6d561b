"""The command `pdssjax`: identify an actuator, simulate a study, characterise records, copy the example.

Exit status: 0 when it worked, 2 when the input is at fault, 3 when a fit did not
converge (its best result is written all the same), 130 when interrupted.

What takes long to import is imported where it is used, so that help comes at once.
"""

import argparse
import contextlib
import shutil
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from .errors import InputError, InputWarning

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from .estimate import FittedRecord
    from .records import Record

EXAMPLE = Path(__file__).parent / "example"
"""Folder of the packaged study."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status; `arguments` default to the process's own."""
    with warnings.catch_warnings():
        warnings.simplefilter("always", InputWarning)
        warnings.showwarning = _announce_warnings(warnings.showwarning)
        try:
            options = _parser().parse_args(arguments)
            return options.run(options)
        except (InputError, OSError) as error:
            print(f"pdssjax: error: {error}", file=sys.stderr)
            return 2
        except KeyboardInterrupt:
            print("pdssjax: interrupted", file=sys.stderr)
            return 130


def _identify(options: argparse.Namespace) -> int:
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
    with _progress() as progress:
        for method, folder in folders.items():
            estimates[method] = pdssjax.identify(study, method=method, progress=progress)
            progress("writing report, predictions and plots")
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


def _simulate(options: argparse.Namespace) -> int:
    from .output import check_free, write_predictions
    from .report import format_records
    from .runtime import prepare_jax

    check_free(options.out, options.overwrite)
    prepare_jax()
    import pdssjax

    study = pdssjax.load_study(options.study)
    with _progress() as progress:
        progress("simulating")
        records = [_compared(*pair) for pair in zip(study.records, study.predict({}), strict=True)]
        progress("writing predictions and plots")
        write_predictions(records, options.out)
    print(format_records(records))
    print(f"Results are in {options.out}")
    return 0


def _compared(record: "Record", predicted: "ArrayLike") -> "FittedRecord":
    """A record beside its simulation, which gets the record's own zero: given, or the best fit to the data."""
    import numpy as np

    from .estimate import compare

    motion = np.asarray(predicted)
    offset = float(np.mean(record.measured - motion)) if record.offset is None else record.offset
    noise = float("nan") if record.noise is None else record.noise
    return compare(record, motion, noise=noise, offset=offset)


def _record(options: argparse.Namespace) -> int:
    from .output import check_free, write_recordings
    from .report import format_records
    from .runtime import prepare_jax

    check_free(options.out, options.overwrite)
    prepare_jax()
    import pdssjax

    from .estimate import compare
    from .virtual_rig import make_recordings, truth

    study = pdssjax.load_study(options.study, virtual=True)
    with _progress() as progress:
        progress("simulating")
        made = make_recordings(study, options.seed)
        progress("writing records and plots")
        compared = [compare(r.record, r.true, noise=r.record.noise or 0.0, offset=r.offset) for r in made]
        write_recordings(made, compared, truth(study, made, options.seed), options.study, options.out)
    print(format_records(compared))
    print(f"Records are in {options.out / 'records'}")
    print(f"Identify them with: pdssjax identify {options.out / 'records' / options.study.name} --out ...")
    return 0


def _characterise(options: argparse.Namespace) -> int:
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


def _models(options: argparse.Namespace) -> int:
    from .catalogue import catalogue, find_entry
    from .report import format_catalogue, format_entry

    print(format_entry(find_entry(options.name)) if options.name else format_catalogue(catalogue()), end="")
    return 0


def _example(options: argparse.Namespace) -> int:
    folder = options.folder
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: found something there already, expected an empty folder or nothing.")
    shutil.copytree(EXAMPLE, folder, dirs_exist_ok=True)
    print(f"Edit {folder / 'study.toml'}, then run: pdssjax identify {folder / 'study.toml'} --out {folder / 'out'}")
    return 0


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message} (see {self.prog} --help)")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="pdssjax", description="Models and identifies piezoelectric stick-slip actuators.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    text = "estimate an actuator's parameters, with uncertainties, from the records of a study"
    identify = commands.add_parser("identify", help=text, description=text)
    identify.set_defaults(run=_identify)
    identify.add_argument(
        "study",
        nargs="?",
        type=Path,
        default=EXAMPLE / "study.toml",
        metavar="STUDY",
        help="study file (TOML); left out: the packaged example",
    )
    identify.add_argument(
        "--method",
        choices=["joint", "sequential", "both"],
        default="joint",
        help="all parameters at once (default), the piezo first as in the thesis, or both side by side",
    )
    _add_out(identify)

    text = "predict every record of a study at its given values and starts"
    simulate = commands.add_parser("simulate", help=text, description=text)
    simulate.set_defaults(run=_simulate)
    simulate.add_argument("study", type=Path, metavar="STUDY", help="study file (TOML)")
    _add_out(simulate)

    text = "tell from records alone how well an actuator walks or pushes (thesis, chapter 3)"
    characterise = commands.add_parser("characterise", help=text, description=text)
    characterise.set_defaults(run=_characterise)
    characterise.add_argument("files", nargs="+", type=Path, metavar="FILE", help="record (CSV)")
    characterise.add_argument("--time", metavar="COL", help='column of the times; left out: the one named "time..."')
    measured = characterise.add_mutually_exclusive_group()
    text = "column of the displacements; left out: the one whose name ends in a length"
    measured.add_argument("--displacement", metavar="COL", help=text)
    measured.add_argument("--force", metavar="COL", help="column of a blocked actuator's force")
    text = "unit of time, displacement or force, where the column's name does not end in it; repeatable"
    characterise.add_argument("--unit", action="append", default=[], metavar="QUANTITY=UNIT", help=text)
    characterise.add_argument("--frequency", metavar="F", help='of the drive, such as "5 Hz"; left out: found')
    text = 'part of the record to use, such as "0.2 s" "1.8 s"'
    characterise.add_argument("--window", nargs=2, metavar=("START", "END"), help=text)
    text = "how long a slip takes, which does not count as sticking (default 0)"
    characterise.add_argument("--slip-duration", default="0", metavar="T", help=text)
    _add_out(characterise, required=False)

    text = "make the records of a study on a virtual rig, with noise, zeros and rounding, from a seed"
    record = commands.add_parser("record", help=text, description=text)
    record.set_defaults(run=_record)
    record.add_argument("study", type=Path, metavar="STUDY", help="study file (TOML) whose parameters all have numbers")
    record.add_argument("--seed", type=int, default=0, help="another seed, other noise (default 0)")
    _add_out(record)

    text = "list the drives, piezos, friction laws and parts of a rig that a study may name, or explain one"
    models = commands.add_parser("models", help=text, description=text)
    models.set_defaults(run=_models)
    models.add_argument(
        "name", nargs="?", metavar="NAME", help='one of them, such as "lugre": equations and parameters'
    )

    text = "copy the packaged study, as a start for your own"
    example = commands.add_parser("example", help=text, description=text)
    example.set_defaults(run=_example)
    example.add_argument("folder", type=Path, metavar="DIR", help="new or empty folder")
    return parser


def _add_out(parser: argparse.ArgumentParser, required: bool = True) -> None:
    parser.add_argument("--out", type=Path, required=required, metavar="DIR", help="folder for the results")
    parser.add_argument("--overwrite", action="store_true", help="replace results that DIR already holds")


def _announce_warnings(show: Callable[..., None]) -> Callable[..., None]:
    """In place of `warnings.showwarning`: plain lines for the user's own warnings, `show` for others."""

    def announce(message, category, *where) -> None:
        if issubclass(category, InputWarning):
            print(f"pdssjax: warning: {message}", file=sys.stderr)
        else:
            show(message, category, *where)

    return announce


@contextlib.contextmanager
def _progress() -> Iterator[Callable[[str], None]]:
    """A function that shows what is being done: one live line on a terminal, else line by line."""
    from rich.console import Console
    from rich.text import Text

    console = Console(stderr=True)
    if console.is_terminal:
        with console.status("") as status:
            yield lambda message: status.update(Text(message))
    else:
        yield lambda message: print(message, file=sys.stderr, flush=True)
