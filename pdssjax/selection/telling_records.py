"""Which record would tell two fitted models apart: the one in which their predictions differ most beside the noise.

Records like those of the study are simulated by both models on a small grid of voltage and frequency, with samples
spread evenly or gathered behind the beginning of each cycle, where the contact slips; a prescribed motion is made
slower and faster.
"""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..core import member_name
from ..study import Record, Study, cycles_a_second
from .comparison import FittedCandidate, TellingRecord
from .scores import CommonNoise

VOLTAGES = (0.5, 0.75, 1.0)
"""Parts of the template's voltage: what drove the rig once does not harm it."""

FREQUENCIES = (0.25, 1.0, 4.0)
"""Times the template's frequency."""

WINDOWS = (1.0, 0.1)
"""Parts of each cycle in which the samples lie."""

SPEEDS = (0.1, 1.0, 10.0)
"""Times the speed of a prescribed motion."""

CYCLES = 4
"""Of each record."""

SAMPLES = 800
"""Of each record."""


class _Trial(NamedTuple):
    record: Record
    noise: CommonNoise
    template: Record
    window: float
    speed: float


def most_telling_record(
    first: tuple[Study, FittedCandidate],
    second: tuple[Study, FittedCandidate],
    noises: Sequence[CommonNoise],
) -> TellingRecord | None:
    """The record that best tells two models apart; None where none can be made up, or both predict the same.

    **Arguments:** each model's study and fit; the noise of each record.
    """
    trials = _trials(first[0].records, noises)
    if not trials:
        return None
    motions = [_predicted(study, fitted, [trial.record for trial in trials]) for study, fitted in (first, second)]
    sizes = [_sigmas(trial, a - b) for trial, a, b in zip(trials, *motions, strict=True)]
    place = int(np.argmax(sizes))
    if not sizes[place] > 0.0:
        return None
    found, drive = trials[place], trials[place].record.drive
    return TellingRecord(
        models=(first[1].name, second[1].name),
        template=found.template.name,
        measures=found.template.measures,
        voltage=float("nan") if drive is None else float(drive.peak()),
        frequency=cycles_a_second(found.record) or float("nan"),
        window=found.window,
        speed=found.speed,
        samples=found.record.time.size,
        sigmas=float(sizes[place]),
        tried=len(trials),
    )


def _trials(records: Sequence[Record], noises: Sequence[CommonNoise]) -> list[_Trial]:
    """Records to try: like the first one of each kind of measurement and drive."""
    kinds: dict[tuple[str, str], tuple[Record, CommonNoise]] = {}
    for record, noise in zip(records, noises, strict=True):
        waveform = "" if record.drive is None else member_name(type(record.drive))
        kinds.setdefault((record.measures, waveform), (record, noise))
    out = []
    for record, noise in kinds.values():
        out += _moved(record, noise) if record.drive is None else _driven(record, noise)
    return out


def _moved(record: Record, noise: CommonNoise) -> list[_Trial]:
    """A prescribed motion, slower and faster."""
    if record.motion is None or record.measurement.prescribed == "velocity":
        return []
    of = lambda speed: dataclasses.replace(record, time=record.time[0] + (record.time - record.time[0]) / speed)
    return [_Trial(of(speed), noise, record, 1.0, speed) for speed in SPEEDS]


def _driven(record: Record, noise: CommonNoise) -> list[_Trial]:
    """A drive that repeats, at other voltages and frequencies; none where it has no such numbers."""
    drive, frequency = record.drive, cycles_a_second(record)
    if drive is None or frequency is None or not {"voltage", "frequency"} <= set(drive.numbers()):
        return []
    out, told = [], drive.numbers()
    for part, times, window in itertools.product(VOLTAGES, FREQUENCIES, WINDOWS):
        changed = {"voltage": part * float(told["voltage"]), "frequency": times * float(told["frequency"])}
        made = drive.with_numbers(changed)
        if made.broken_conditions():
            continue
        cycle = np.arange(SAMPLES) * CYCLES // SAMPLES
        within = np.arange(SAMPLES) - cycle * SAMPLES // CYCLES
        time = (cycle + window * within * CYCLES / SAMPLES) / (times * frequency)
        empty = np.zeros(SAMPLES)
        trial = dataclasses.replace(
            record, drive=made, overrides=record.overrides | {"voltage", "frequency"}, time=time, measured=empty
        )
        out.append(_Trial(trial, noise, record, window, 1.0))
    return out


def _predicted(study: Study, fitted: FittedCandidate, records: Sequence[Record]) -> list[Float[np.ndarray, " samples"]]:
    known = {path: number for path, number in fitted.values.items() if path in study.parameters}
    posed = dataclasses.replace(study, records=tuple(records)).with_values(known, of_estimate=True)
    return [np.asarray(motion) for motion in posed.predict()]


def _sigmas(trial: _Trial, apart: Float[np.ndarray, " samples"]) -> float:
    """How far two predictions are `apart`, in standard deviations of the noise; 0 where one of them failed."""
    if not np.isfinite(apart).all():
        return 0.0
    if trial.record.offset is None:
        apart = apart - np.mean(apart)
    interval = float(np.median(np.diff(trial.record.time)))
    share = 1.0 / (1.0 + 2.0 * trial.noise.correlation_time / interval)
    return float(np.sqrt(share * np.sum(apart**2))) / trial.noise.deviation
