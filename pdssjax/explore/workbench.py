"""The data that all pages of one `pdssjax explore` share: study, numbers, live records, estimate and sweep."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ..core import choices
from ..files import save_study
from ..inference import FitInterrupted, identify
from ..study import Estimate, Record, Study
from .background_job import Report
from .live_record import LiveRecords, initial_stretch, instants_of
from .settings import Settings, changed_drives, inner_drive, study_to_fit

if TYPE_CHECKING:
    import xarray


class FitResult(NamedTuple):
    """The end of a fit."""

    estimate: Estimate | None
    """The estimate; None where the fit was cancelled before its first point."""
    message: str
    """A line for the user."""


def fit_from_here(study: Study, settings: Settings, report: Report) -> FitResult:
    """Fit the records of `study` jointly, starting at the numbers of `settings`.

    **Raises:** `InputError` where there is nothing to fit.
    """
    try:
        estimate = identify(study_to_fit(study, settings), progress=report)
    except KeyboardInterrupt as interrupt:
        estimate = interrupt.estimate if isinstance(interrupt, FitInterrupted) else None
        if estimate is None:
            return FitResult(None, "The fit was cancelled before its first result.")
        return FitResult(estimate, "The fit was cancelled; the sliders show the best point so far, not an optimum.")
    return FitResult(estimate, f"The fit {estimate.verdict} in {estimate.seconds:.3g} s: {estimate.message}.")


@dataclass
class Workbench:
    """The shared data, made once; pages read it from the server's thread and from their jobs."""

    study: Study
    """The study, with a number for every parameter; free parameters stay free."""
    initial: Settings
    """The numbers at the beginning."""
    estimate: Estimate | None = None
    """The estimate shown at the beginning."""
    sweep: "xarray.Dataset | None" = None
    records: LiveRecords = field(init=False)

    def __post_init__(self) -> None:
        self.records = LiveRecords(self.study)

    def record(self, name: str) -> Record:
        """The record of that name."""
        return next(record for record in self.study.records if record.name == name)

    def first(self) -> Record:
        """The record shown at the beginning: the first with a free end-effector, or else the first."""
        free = [record for record in self.study.records if record.measurement.effector_free]
        return (free or list(self.study.records))[0]

    def warm(self, record: Record | None = None) -> None:
        """Compile the curves of a record, by default of the `first`."""
        record = record or self.first()
        self.records.redraw(record.name, self.initial, instants_of(record, *initial_stretch(record)))

    def free_path(self) -> Path:
        """A path beside this study that does not exist yet, for a new study."""
        assert self.study.path is not None
        stem = self.study.path.absolute().with_suffix("")
        tried = [stem.with_name(f"{stem.name}-explored{number}.toml") for number in ("", *range(2, 1000))]
        return next(path for path in tried if not path.exists())

    def save(self, settings: Settings, target: Path, overwrite: bool) -> Path:
        """Write the study with the numbers of `settings` to `target`, and return the absolute path.

        **Raises:** `InputError` as `files.save_study` does.
        """
        assert self.study.path is not None
        drives = {}
        for name, numbers in changed_drives(self.study, settings).items():
            drive = self.record(name).drive
            assert drive is not None
            words = {
                f"drive.{field}": {number: word for word, number in known.items()}
                for field, known in choices(type(inner_drive(drive))).items()
            }
            drives[name] = {
                path.removeprefix("drive."): words.get(path, {}).get(number, number) for path, number in numbers.items()
            }
        return save_study(self.study.path, target, settings.values, drives, overwrite)
