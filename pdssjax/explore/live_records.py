"""The live records of a study: each is made ready when it is first asked for, once for all pages and threads."""

import threading

import numpy as np
from jaxtyping import Float

from ..study import Record, Study
from .live_record import LiveRecord
from .redraw import Redraw, Score, redraw
from .settings import Settings, study_at


class LiveRecords:
    """Predicts one record of a study at a time."""

    def __init__(self, study: Study):
        self.study = study
        self._live: dict[str, LiveRecord] = {}
        self._locks = {record.name: threading.Lock() for record in study.records}

    def is_ready(self, name: str) -> bool:
        """Whether the record `name` has been compiled."""
        return name in self._live

    def redraw(self, name: str, settings: Settings, instants: Float[np.ndarray, " k"]) -> Redraw:
        """The record `name` at the numbers of `settings`; compiles where that is needed, which takes seconds."""
        record = self._at(name, settings)
        with self._locks[name]:
            live = self._live.get(name) or LiveRecord(self.study, record, settings.values)
            found = live.run(record, settings.values, instants)
            self._live[name] = live
        return redraw(record, found, instants)

    def redraw_at_once(self, name: str, settings: Settings, instants: Float[np.ndarray, " k"]) -> Redraw | None:
        """The same in milliseconds, or None where something has to be compiled first."""
        record, lock = self._at(name, settings), self._locks[name]
        if name not in self._live or not lock.acquire(blocking=False):
            return None
        try:
            found = self._live[name].run_at_once(record, settings.values, instants)
        finally:
            lock.release()
        return None if found is None else redraw(record, found, instants)

    def score(self, name: str, settings: Settings, instants: Float[np.ndarray, " k"]) -> Score:
        """How well the record `name` is predicted at the numbers of `settings`."""
        return self.redraw(name, settings, instants).score

    def _at(self, name: str, settings: Settings) -> Record:
        return next(record for record in study_at(self.study, settings).records if record.name == name)
