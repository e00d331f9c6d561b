"""What can be turned on the page: every parameter of a study, and every number of a record's drive."""

import dataclasses
from typing import NamedTuple

from ..core import InputError, Quantity, check_range, choices, display_unit, to_si
from ..drive.base import AbstractDrive
from ..study import MARK, Record, Study, shared_fields
from .slider_range import SliderRange, slider_range

_SMALLEST, _LARGEST = 1e-30, 1e30
"""Size of a number [SI] that is not zero: far beyond any actuator, and far within what arithmetic holds."""


class Knob(NamedTuple):
    """A number that can be turned."""

    path: str
    """Of a parameter, such as "piezo.gain"; of a drive "drive.voltage"."""
    quantity: Quantity
    range: SliderRange
    free: bool
    """A fit changes it."""
    parameter: bool
    """Of the study; else of one record's drive."""

    @property
    def unit(self) -> str:
        """As shown, such as "µm/V"; "" for a pure number."""
        return display_unit(self.quantity.unit)[0].replace("um", "µm")

    def text(self, number: float) -> str:
        """`number` [SI] as its field shows it, in the unit shown."""
        return f"{number * display_unit(self.quantity.unit)[1]:.6g}"

    def read(self, text: str) -> float:
        """The number [SI] that a `text` says: in the unit shown, or with a unit of its own ("200 Hz").

        **Raises:** `InputError` where it is no number, outside the legal range, or of a size that nothing has.
        """
        text = text.strip().replace("µ", "u")
        shown, factor = display_unit(self.quantity.unit)
        try:
            number, text = float(text) / factor, f"{text} {shown}"
        except ValueError:
            number = to_si(text, self.quantity.unit, self.path, shown)
        if number and not _SMALLEST <= abs(number) <= _LARGEST:
            found = f"{self.path}: found {number:g} {self.quantity.unit}".rstrip()
            raise InputError(f"{found}, expected 0 or a size between {_SMALLEST:g} and {_LARGEST:g}.")
        check_range(number, self.quantity, self.path, text)
        return number


class Choice(NamedTuple):
    """One of some words, of a drive."""

    path: str
    words: dict[str, float]
    """Each with the number that stands for it."""


def parameter_knobs(study: Study) -> list[Knob]:
    """Of every parameter, in the order of the study.

    **Raises:** `InputError` that names the parameters without a number.
    """
    return [_of_parameter(study, path, number) for path, number in study.values().items()]


def _of_parameter(study: Study, path: str, number: float) -> Knob:
    parameter = study.parameters[path]
    found = slider_range(parameter.quantity, number, parameter.low, parameter.high)
    return Knob(path, parameter.quantity, found, parameter.free, True)


def drive_knobs(study: Study, record: Record) -> list[Knob]:
    """Of every number of the record's drive that is no parameter of the study; none without a drive."""
    if record.drive is None:
        return []
    shared = {field for field, path in shared_fields(record).items() if path in study.parameters}
    numbers = record.drive.numbers()
    return [
        Knob(f"drive.{field}", declared, slider_range(declared, float(numbers[field])), False, False)
        for field, declared in record.drive.declared().items()
        if field not in shared
    ]


def drive_choices(record: Record) -> list[Choice]:
    """Of every word of the record's drive, such as its direction."""
    if record.drive is None:
        return []
    return [Choice(f"drive.{field}", words) for field, words in choices(type(inner_drive(record.drive))).items()]


def inner_drive(drive: AbstractDrive) -> AbstractDrive:
    """The waveform that a zero-order hold holds, or the drive itself."""
    inside = getattr(drive, "drive", None)
    return inside if isinstance(inside, AbstractDrive) else drive


def own_numbers(record: Record) -> dict[str, float]:
    """The numbers [SI] of the record's drive by path, those that stand for words included."""
    if record.drive is None:
        return {}
    drive = inner_drive(record.drive)
    named = [field.name for field in dataclasses.fields(drive) if {"quantity", "choice"} & set(field.metadata)]
    return {f"drive.{name}": float(getattr(drive, name)) for name in named}


def group_of(path: str) -> str:
    """Under which heading a parameter stands: that of its model, "friction"."""
    return path.partition(MARK)[0].partition(".")[0]
