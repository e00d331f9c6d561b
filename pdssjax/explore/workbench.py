"""What all pages of one `pdssjax explore` share: the study, its numbers, its live records, estimate and sweep."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from ..core import Document, choices
from ..files import save_study
from ..study import Record, Study
from .knobs import inner_drive
from .live_records import LiveRecords
from .redraw import Redraw, enlarged_at_first, instants_of
from .settings import Settings, changed_drives

if TYPE_CHECKING:
    import xarray


@dataclass
class Workbench:
    """Made once; pages read it from the server's thread and from their jobs."""

    study: Study
    """With a number for every parameter; what the study's file leaves free is free."""
    begun: Settings
    """Where the sliders begin."""
    estimate: Document | None = None
    """As estimate.json holds it."""
    sweep: "xarray.Dataset | None" = None
    records: LiveRecords = field(init=False)

    def __post_init__(self) -> None:
        self.records = LiveRecords(self.study)

    def record(self, name: str) -> Record:
        """The record of that name."""
        return next(record for record in self.study.records if record.name == name)

    def first(self) -> Record:
        """The record that is shown first: one whose end-effector walks, or else the first."""
        walks = [record for record in self.study.records if record.measurement.effector_free]
        return (walks or list(self.study.records))[0]

    def warm(self, record: Record | None = None) -> None:
        """Compiles what shows a record, by default the first."""
        record = record or self.first()
        self.records.redraw(record.name, self.begun, instants_of(record, *enlarged_at_first(record)))

    def redraw_at_once(self, record: Record, settings: Settings) -> Redraw | None:
        """A record at the numbers of `settings`, its fastest motion enlarged; None where it has to be compiled."""
        return self.records.redraw_at_once(record.name, settings, instants_of(record, *enlarged_at_first(record)))

    def free_path(self) -> Path:
        """A name for a new study beside this one that nothing has yet."""
        assert self.study.path is not None
        stem = self.study.path.absolute().with_suffix("")
        tried = [stem.with_name(f"{stem.name}-explored{number}.toml") for number in ("", *range(2, 1000))]
        return next(path for path in tried if not path.exists())

    def save(self, settings: Settings, target: Path, overwrite: bool) -> Path:
        """Write the study's file with the numbers of `settings` where it says others or none; the file's whole path.

        **Raises:** `InputError` as `files.save_study` does.
        """
        assert self.study.path is not None
        drives = {
            name: _fields(self.record(name), numbers) for name, numbers in changed_drives(self.study, settings).items()
        }
        return save_study(self.study.path, target, settings.values, drives, overwrite)


def _fields(record: Record, numbers: Mapping[str, float]) -> dict[str, float | str]:
    """Numbers of a drive by field, and words in place of those that stand for one."""
    assert record.drive is not None
    words = choices(type(inner_drive(record.drive)))
    found: dict[str, float | str] = {}
    for path, number in numbers.items():
        name = path.removeprefix("drive.")
        found[name] = (
            next((word for word, n in words[name].items() if n == number), number) if name in words else number
        )
    return found
