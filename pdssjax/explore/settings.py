"""The numbers that the user can change on the page, their sliders, and the study at these numbers.

These are all parameters of a study, and all numbers of the drive of the record on the page.
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import NamedTuple

from ..core import InputError, Quantity, check_range, choices, display_unit, to_si, with_micro_sign
from ..drive.base import AbstractDrive
from ..study import MARK, Record, Study, shared_fields

POSITIONS = 1000
"""Steps of a slider from end to end; an arrow key moves it by one."""

DECADES = 10.0
"""Factor that a slider of a positive number covers in each direction, where no bound is given."""

_SPANS = {"s": 2e-3, "N": 1.0, "rad": 0.1, "m": 1e-5, "V": 100.0}
"""Range of a slider whose number is zero, by its unit."""


class SliderRange(NamedTuple):
    """The ends of a slider [SI], and its scale."""

    low: float
    high: float
    logarithmic: bool

    def position(self, number: float) -> int:
        """The position of `number` [SI], from 0 to `POSITIONS`; outside the range that of the nearest end."""
        low, high, at = (math.log(x) if self.logarithmic else x for x in (self.low, self.high, self._within(number)))
        return round(POSITIONS * (at - low) / (high - low))

    def number(self, position: int) -> float:
        """The number [SI] at a `position`, rounded to the resolution of a step."""
        fraction = position / POSITIONS
        if self.logarithmic:
            return self._within(float(f"{self.low * (self.high / self.low) ** fraction:.4g}"))
        step = (self.high - self.low) / POSITIONS
        return round((self.low + fraction * (self.high - self.low)) / step) * step if step else self.low

    def widened(self, number: float, quantity: Quantity) -> "SliderRange":
        """The range, extended within legal ends where `number` [SI] lies outside it."""
        if self.low <= number <= self.high:
            return self
        half = abs(number) / 2
        low, high = (number / 3.0, number * 3.0) if self.logarithmic else (number - half, number + half)
        low, high = max(low, quantity.low), min(high, max(number, _below(quantity.high)))
        return self._replace(low=min(self.low, low), high=max(self.high, high))

    def _within(self, number: float) -> float:
        return min(max(number, self.low), self.high)


def slider_range(quantity: Quantity, number: float, low: float | None = None, high: float | None = None) -> SliderRange:
    """The range of a slider that starts at `number` [SI].

    Its ends are `low` and `high` [SI], the bounds of the study, where these are given.  Otherwise a positive quantity
    has a logarithmic slider with a factor `DECADES` in each direction, and any other a linear one to twice the number.
    """
    if quantity.positive:
        begin = number / DECADES if low is None else low
        end = number * DECADES if high is None else high
        begin = begin if begin > 0 else number / DECADES**2
        return SliderRange(begin, min(end, max(number, _below(quantity.high))), True)
    span = 2.0 * abs(number) or _SPANS.get(quantity.unit, 1.0)
    begin = (0.0 if number > 0 else -span) if low is None else low
    end = (0.0 if number < 0 else span) if high is None else high
    return SliderRange(max(begin, quantity.low), min(end, _below(quantity.high)), False)


def _below(high: float) -> float:
    """A legal number just below the end `high`, which itself is not legal."""
    return high * (1.0 - 1e-6) if math.isfinite(high) else high


_SMALLEST, _LARGEST = 1e-30, 1e30
"""Limits of the magnitude of a number [SI] other than zero: wider than for any actuator, well within floats."""


class Knob(NamedTuple):
    """A number that has a slider."""

    path: str
    """The name of a parameter, such as "piezo.gain", or of a number of the drive, such as "drive.voltage"."""
    quantity: Quantity
    range: SliderRange
    free: bool
    """Whether a fit changes the number."""
    parameter: bool
    """Whether the number is a parameter of the study; else it is one of a record's drive."""

    @property
    def unit(self) -> str:
        """The unit on the page, such as "µm/V"; "" for a pure number."""
        return with_micro_sign(display_unit(self.quantity.unit)[0])

    def text(self, number: float) -> str:
        """`number` [SI] as a text in the unit of the page."""
        return f"{number * display_unit(self.quantity.unit)[1]:.6g}"

    def read(self, text: str) -> float:
        """The number [SI] in a `text`, in the unit of the page or in a unit of its own ("200 Hz").

        **Raises:** `InputError` where the text is no number, or the number is not legal.
        """
        text = text.strip().replace("µ", "u")
        unit, factor = display_unit(self.quantity.unit)
        try:
            number, text = float(text) / factor, f"{text} {unit}"
        except ValueError:
            number = to_si(text, self.quantity.unit, self.path, unit)
        if number and not _SMALLEST <= abs(number) <= _LARGEST:
            where = f"{self.path}: found {number:g} {self.quantity.unit}".rstrip()
            raise InputError(f"{where}, expected 0 or a size between {_SMALLEST:g} and {_LARGEST:g}.")
        check_range(number, self.quantity, self.path, text)
        return number


class Choice(NamedTuple):
    """A field of a drive whose value is one of a few words."""

    path: str
    words: dict[str, float]
    """The number that stands for each word."""


def parameter_knobs(study: Study) -> list[Knob]:
    """Knobs of all parameters, in the order of the study.

    **Raises:** `InputError` that names the parameters without a number.
    """
    knobs = []
    for path, number in study.values().items():
        parameter = study.parameters[path]
        ends = slider_range(parameter.quantity, number, parameter.low, parameter.high)
        knobs.append(Knob(path, parameter.quantity, ends, parameter.free, True))
    return knobs


def drive_knobs(study: Study, record: Record) -> list[Knob]:
    """Knobs of the numbers of the record's drive that are no parameters of the study; empty without a drive."""
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
    """The choices of the record's drive, such as its direction."""
    if record.drive is None:
        return []
    return [Choice(f"drive.{field}", words) for field, words in choices(type(inner_drive(record.drive))).items()]


def inner_drive(drive: AbstractDrive) -> AbstractDrive:
    """The waveform inside a zero-order hold, or the drive itself."""
    inside = getattr(drive, "drive", None)
    return inside if isinstance(inside, AbstractDrive) else drive


def drive_numbers(record: Record) -> dict[str, float]:
    """The numbers [SI] of the record's drive by path, including those that stand for words."""
    if record.drive is None:
        return {}
    drive = inner_drive(record.drive)
    named = [field.name for field in dataclasses.fields(drive) if {"quantity", "choice"} & set(field.metadata)]
    return {f"drive.{name}": float(getattr(drive, name)) for name in named}


def group_of(path: str) -> str:
    """The heading of a parameter on the page: its model, such as "friction"."""
    return path.partition(MARK)[0].partition(".")[0]


@dataclasses.dataclass(frozen=True)
class Settings:
    """All numbers of a page [SI]; immutable, so that threads may share them."""

    values: Mapping[str, float]
    """Values of the study's parameters, by path."""
    drives: Mapping[str, Mapping[str, float]]
    """Numbers of each record's drive, by the record's name and then by path, such as "drive.voltage"."""

    def with_values(self, values: Mapping[str, float]) -> "Settings":
        """The settings with other numbers [SI] of some parameters; unknown paths are ignored."""
        known = {path: float(number) for path, number in values.items() if path in self.values}
        return dataclasses.replace(self, values={**self.values, **known})

    def with_drive(self, record: str, path: str, number: float) -> "Settings":
        """The settings with another number [SI] of a record's drive."""
        return dataclasses.replace(self, drives={**self.drives, record: {**self.drives[record], path: number}})


def settings_of(study: Study) -> Settings:
    """The settings with the numbers of a study; **raises** `InputError` that names the parameters without a number."""
    return Settings(study.values(), {record.name: drive_numbers(record) for record in study.records})


def changed_drives(study: Study, settings: Settings) -> dict[str, dict[str, float]]:
    """The numbers [SI] of drives that differ from the study's, by the record's name."""
    changed = {}
    for record in study.records:
        before = drive_numbers(record)
        if numbers := {path: n for path, n in settings.drives[record.name].items() if n != before[path]}:
            changed[record.name] = numbers
    return changed


def study_at(study: Study, settings: Settings) -> Study:
    """`study` with the numbers of `settings`, as starts of free parameters and as values of fixed ones."""
    parameters = {
        path: dataclasses.replace(p, value=settings.values[path])
        if p.value is not None
        else p.with_start(settings.values[path])
        for path, p in study.parameters.items()
    }
    changed, records = changed_drives(study, settings), []
    for record in study.records:
        if record.drive is not None and record.name in changed:
            fields = {path.removeprefix("drive."): number for path, number in changed[record.name].items()}
            # Numbers override the study's parameters; words are none.
            overrides = record.overrides | (set(fields) - set(choices(type(inner_drive(record.drive)))))
            drive = record.drive.with_numbers(fields)
            record = dataclasses.replace(record, drive=drive, overrides=overrides)
        records.append(record)
    return dataclasses.replace(study, parameters=parameters, records=tuple(records))


def study_to_fit(study: Study, settings: Settings) -> Study:
    """The study whose fit starts at `settings`: as `study_at`, but measured parameters keep their measured value."""
    started = study_at(study, settings)
    measured = {path: p for path, p in study.parameters.items() if p.measured_apart}
    return dataclasses.replace(started, parameters=started.parameters | measured)
