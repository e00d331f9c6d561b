"""The numbers of all sliders, and the study at these numbers."""

import dataclasses
from collections.abc import Mapping

from ..core import choices
from ..study import Record, Study
from .knobs import drive_numbers, inner_drive


@dataclasses.dataclass(frozen=True)
class Settings:
    """All parameters of a page [SI]; immutable, so that threads may share them."""

    values: Mapping[str, float]
    """Values of the study's parameters, by path."""
    drives: Mapping[str, Mapping[str, float]]
    """Parameters of each record's drive, by the record's name and then by path, such as "drive.voltage"."""

    def with_value(self, path: str, number: float) -> "Settings":
        """The settings with another number [SI] of a parameter."""
        return dataclasses.replace(self, values={**self.values, path: number})

    def with_values(self, values: Mapping[str, float]) -> "Settings":
        """The settings with other numbers [SI] of some parameters; unknown paths are ignored."""
        known = {path: float(number) for path, number in values.items() if path in self.values}
        return dataclasses.replace(self, values={**self.values, **known})

    def with_drive(self, record: str, path: str, number: float) -> "Settings":
        """The settings with another number [SI] of a record's drive."""
        return dataclasses.replace(self, drives={**self.drives, record: {**self.drives[record], path: number}})


def settings_of(study: Study) -> Settings:
    """The settings with the numbers of a study.

    **Raises:** `InputError` that names the parameters without a number.
    """
    return Settings(study.values(), {record.name: drive_numbers(record) for record in study.records})


def changed_drives(study: Study, settings: Settings) -> dict[str, dict[str, float]]:
    """The numbers [SI] of drives that differ from the study's, by the record's name."""
    found = {}
    for record in study.records:
        before, now = drive_numbers(record), settings.drives[record.name]
        other = {path: number for path, number in now.items() if number != before[path]}
        if other:
            found[record.name] = other
    return found


def study_at(study: Study, settings: Settings) -> Study:
    """`study` with the numbers of `settings`, as starts of free parameters and as values of fixed ones."""
    parameters = {
        path: dataclasses.replace(p, value=settings.values[path])
        if p.value is not None
        else p.with_start(settings.values[path])
        for path, p in study.parameters.items()
    }
    changed = changed_drives(study, settings)
    records = tuple(_driven(study, record, changed.get(record.name, {})) for record in study.records)
    return dataclasses.replace(study, parameters=parameters, records=records)


def to_be_fitted(study: Study, settings: Settings) -> Study:
    """The study whose fit starts at `settings`: as `study_at`, but measured parameters keep their measured value."""
    there = study_at(study, settings)
    apart = {path: p for path, p in study.parameters.items() if p.measured_apart}
    return dataclasses.replace(there, parameters=there.parameters | apart)


def _driven(study: Study, record: Record, numbers: Mapping[str, float]) -> Record:
    """`record` with other numbers of its drive, which override the study's."""
    if record.drive is None or not numbers:
        return record
    fields = {path.removeprefix("drive."): number for path, number in numbers.items()}
    overrides = record.overrides | (set(fields) - set(choices(type(inner_drive(record.drive)))))
    return dataclasses.replace(record, drive=record.drive.with_numbers(fields), overrides=overrides)
