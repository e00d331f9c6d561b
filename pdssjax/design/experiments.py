"""Experiments that may be made next: kinds of records, drives and rigs within the limits that a user states.

An `Experiment` is a record without its sampling: what is measured, the voltage or the prescribed motion, and the
numbers of the rig that are set for it, such as a tilt or an added mass.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import InputError, check_range, choices, member, member_name, members, nearest, quantities
from ..drive.base import AbstractDrive
from ..metrics import scatter_floor
from ..study import AbstractMeasurement, Record, Study
from .sampling import Grid, graded_grid

KINDS = ("platform", "effector", "velocity", "force", "friction")
"""Kinds of measurement that a plan may contain."""

_USUAL = {"platform": ("step", "sawtooth")}
"""Usual waveforms by kind, where the study has no record of it; other kinds have a sawtooth."""

_LEVELS = 4
"""Voltages and frequencies that are tried of a range."""


@dataclasses.dataclass(frozen=True)
class Limits:
    """Limits of rig, sensor and recorder; a limit that is None or left out is as in the study's records."""

    kinds: tuple[str, ...] | None = None
    """Kinds of measurement that are allowed, of `KINDS`."""
    waveforms: tuple[str, ...] | None = None
    """Names of the drives that are allowed."""
    voltage: tuple[float, float] | None = None
    """Least and greatest voltage of a drive [V]."""
    frequency: tuple[float, float] | None = None
    """Least and greatest frequency of a drive or a motion [Hz]."""
    duty: tuple[float, ...] = ()
    """Shares of the period that the slow flank may take [1], of drives that have a duty; none: the drive's own."""
    amplitude: tuple[float, ...] = ()
    """Amplitudes of the motion prescribed in a friction record [m]."""
    interval: float | None = None
    """Least time between samples [s]."""
    duration: float | None = None
    """Longest record [s]."""
    noise: Mapping[str, float] = dataclasses.field(default_factory=dict)
    """Standard deviation by kind, in the unit of the measurement."""
    correlation_time: Mapping[str, float] = dataclasses.field(default_factory=dict)
    """Correlation time of the noise by kind of record [s]; white noise where it is left out."""
    range: Mapping[str, float] = dataclasses.field(default_factory=dict)
    """Largest extent of what a sensor can see, by kind, in its unit."""
    rig: Mapping[str, tuple[float, ...]] = dataclasses.field(default_factory=dict)
    """Numbers [SI] to which fixed parameters may be set for a record, by path: "effector.tilt", "effector.mass"."""
    record_cost: float = 1.0
    """Cost of each record, in a unit of your choice."""
    second_cost: float = 0.0
    """Cost of each second that is recorded, in the same unit."""


@dataclasses.dataclass(frozen=True)
class CompleteLimits(Limits):
    """Limits of which none is left out; only `completed_limits` makes them."""

    kinds: tuple[str, ...] = ()
    voltage: tuple[float, float] = (math.nan, math.nan)
    frequency: tuple[float, float] = (math.nan, math.nan)
    interval: float = math.nan
    duration: float = math.nan


class Resources(eqx.Module):
    """Budget of all records together."""

    samples: int = eqx.field(static=True)
    records: int = eqx.field(static=True)
    seconds: float = eqx.field(static=True, default=math.inf)
    cost: float = eqx.field(static=True, default=math.inf)

    @property
    def amounts(self) -> Float[np.ndarray, "4"]:
        """Samples, records, time [s] and cost."""
        return np.array([self.samples, self.records, self.seconds, self.cost])


@dataclasses.dataclass(frozen=True, eq=False)
class Experiment:
    """A record that could be made, without its sampling."""

    kind: str
    drive: AbstractDrive | None
    """None where a motion is prescribed."""
    motion: tuple[float, float] | None
    """Amplitude [m] and frequency [Hz] of a prescribed motion."""
    rig: tuple[tuple[str, float], ...]
    """Paths and numbers [SI] of what is set for it."""

    @property
    def measurement(self) -> AbstractMeasurement:
        """The measurement of the experiment."""
        return member("study.measurement", self.kind)()

    @property
    def period(self) -> float | None:
        """Period of the drive or the motion [s]; None where it does not repeat."""
        if self.motion is not None:
            return 1.0 / self.motion[1]
        frequency = None if self.drive is None else self.drive.cycle_frequency()
        return None if frequency is None else 1.0 / float(frequency)

    @property
    def group(self) -> tuple[str, str]:
        """Experiments of one group share what is compiled: kind and waveform."""
        return self.kind, "" if self.drive is None else member_name(type(self.drive))

    @property
    def shape(self) -> dict[str, float]:
        """The continuous design variables: voltage, frequency and duty, as far as the drive has them."""
        if self.drive is None:
            return {}
        numbers = self.drive.numbers()
        return {field: float(numbers[field]) for field in ("voltage", "frequency", "duty") if field in numbers}

    def with_shape(self, numbers: Mapping[str, float]) -> "Experiment":
        """The experiment with other numbers of its drive."""
        assert self.drive is not None
        return dataclasses.replace(self, drive=self.drive.with_numbers(numbers))

    def rounded(self) -> "Experiment":
        """The experiment with voltage, frequency and duty to four digits, as a generator is set."""
        return self.with_shape({f: float(f"{n:.4g}") for f, n in self.shape.items()}) if self.shape else self

    @property
    def words(self) -> dict[str, str]:
        """The choices of the drive, such as the direction, by field."""
        if self.drive is None:
            return {}
        options = choices(type(self.drive))
        return {f: next(w for w in words if words[w] == getattr(self.drive, f)) for f, words in options.items()}

    @property
    def name(self) -> str:
        """The name of the experiment in a plan."""
        if self.motion is not None:
            return f"{self.kind}, {1e6 * self.motion[0]:.3g} um at {self.motion[1]:.3g} Hz{self._rig}"
        shape = self.shape
        at = f" {shape['frequency']:.3g} Hz" if "frequency" in shape else ""
        way = f" {self.words['direction']}" if "direction" in self.words else ""
        duty = f" duty {shape['duty']:.3g}" if shape.get("duty", 1.0) < 1.0 else ""
        return f"{self.kind}, {self.group[1]}{way} {shape['voltage']:.3g} V{at}{duty}{self._rig}"

    @property
    def _rig(self) -> str:
        return "".join(f", {path} {number:.3g}" for path, number in self.rig)

    @property
    def conditions(self) -> frozenset[str]:
        """The conditions under which the study lists what is set for the experiment."""
        return frozenset(condition_name(path, number) for path, number in self.rig)

    def record(
        self, study: Study, name: str, times: Float[np.ndarray, " n"], noise: float, offset: float | None = None
    ) -> Record:
        """The experiment as a record with samples at `times` [s], still to be made: what was measured is zero.

        Numbers of the drive that are parameters of the `study` are the study's, but for those of `shape`.
        """
        fields = {} if self.drive is None else self.drive.declared()
        shared = {field for field in fields if f"drive.{field}" in study.parameters} - set(self.shape)
        motion = None
        if self.motion is not None:
            amplitude, frequency = self.motion
            motion = amplitude * np.sin(2.0 * np.pi * frequency * (times - times[0]))
        return Record(
            name=name,
            file=Path(f"{name}.csv"),
            role="fit",
            measurement=self.measurement,
            drive=self.drive,
            overrides=frozenset(fields) - shared,
            time=times,
            measured=np.zeros(times.size),
            noise=noise,
            offset=offset,
            motion=motion,
            conditions=self.conditions,
        )

    def corners(self) -> list[float]:
        """Where in a cycle the drive has corners [s], 0 first."""
        if self.drive is None or self.drive.period() is None:
            return [0.0]
        first, count = self.drive.period() or (0, 0)
        durations = np.asarray(_durations(self.drive, jnp.arange(first, first + count)))
        starts = np.concatenate([[0.0], np.cumsum(durations)[:-1]])
        return sorted({float(start) for start in starts[durations > 0]} | {0.0})

    def grid(self, ringing: float | None, finest: float, duration: float) -> Grid:
        """Dense time grid of the experiment; `ringing` is the platform's angular frequency [rad/s], if it has one."""
        spacing = finest if ringing is None else min(finest, 2.0 * math.pi / ringing / 40)
        return graded_grid(self.period, self.corners(), spacing, duration)


@eqx.filter_jit
def _durations(drive: AbstractDrive, indices: Array) -> Array:
    return jax.vmap(lambda index: drive.segment(index).duration)(indices)


def condition_name(path: str, number: float) -> str:
    """The condition under which a parameter is set to a number for some records."""
    return f"{path.replace('.', '_')}={number:.6g}"


def completed_limits(study: Study, limits: Limits, misfit: Mapping[str, float]) -> CompleteLimits:
    """`limits` with what they leave out as the study's records have it, all numbers checked.

    **Arguments:** `misfit` is by how much the residuals of a kind of record exceed its noise; noise that the limits do
    not state is enlarged by it.

    **Raises:** `InputError` where something is unknown or out of range, or neither stated nor told by a record.
    """
    where = f"{study.path or study.title}: design"
    records = [record for record in study.records if record.measures in KINDS]
    kinds = limits.kinds or tuple(dict.fromkeys(record.measures for record in records))
    if not kinds:
        raise InputError(f'{where}: found no record and no "kinds", expected some of {", ".join(KINDS)}.')
    for kind in kinds:
        if kind not in KINDS:
            raise InputError(f'{where}: kinds: found "{kind}"; {nearest(kind, KINDS)}')
    for waveform in limits.waveforms or ():
        if waveform not in members("drive") or waveform == "sampled":
            raise InputError(f'{where}: waveforms: found "{waveform}"; {nearest(waveform, _plannable_waveforms())}')
    driven = [record.drive for record in records if record.drive is not None]
    peaks = [float(drive.peak()) for drive in driven]
    rates = [float(f) for drive in driven if (f := drive.cycle_frequency()) is not None]
    # Of a clock as it is written, without the rounding of differences.
    steps = [float(f"{np.min(np.diff(record.time)):.6g}") for record in records]
    lasting = [float(record.time[-1]) for record in records]
    noise = dict(limits.noise) | {k: _noise(k, records, where) * misfit.get(k, 1.0) for k in {*kinds} - {*limits.noise}}
    found = {
        "kinds": kinds,
        "voltage": limits.voltage or tuple(_from_records(peaks, end, "voltage", where) for end in (min, max)),
        "frequency": limits.frequency or ((min(rates), max(rates)) if rates else (1.0, 1.0)),
        "interval": limits.interval or _from_records(steps, min, "interval", where),
        "duration": limits.duration or _from_records(lasting, max, "duration", where),
        "noise": noise,
    }
    out = CompleteLimits(**(vars(limits) | found))
    _check(study, out, where)
    return out


def _plannable_waveforms() -> list[str]:
    """Names of the waveforms that a plan may choose: all that need no file."""
    return [name for name in members("drive") if name != "sampled"]


def _from_records(numbers: list[float], choose: Callable[[list[float]], float], key: str, where: str) -> float:
    if not numbers:
        raise InputError(f'{where}: the key "{key}" is missing, and no record of the study tells it.')
    return float(choose(numbers))


def _noise(kind: str, records: Sequence[Record], where: str) -> float:
    """The noise that the records of a kind have, or show between neighbouring samples."""
    own = [record for record in records if record.measures == kind]
    known = [scatter_floor(r.measured) if r.noise is None else r.noise for r in own]
    known = [noise for noise in known if math.isfinite(noise) and noise > 0]
    if not known:
        raise InputError(
            f'{where}: noise: found none of "{kind}", expected its standard deviation, as no record tells it.'
        )
    return float(np.median(known))


def _check(study: Study, limits: CompleteLimits, where: str) -> None:
    """**Raises** `InputError` for a number of complete `limits` that is out of range."""
    for key in ("voltage", "frequency"):
        low, high = getattr(limits, key)
        if not 0.0 < low <= high < math.inf:
            raise InputError(f"{where}: {key}: found {low:g} to {high:g}, expected two ascending numbers above 0.")
    for key in ("interval", "duration"):
        if not 0.0 < getattr(limits, key) < math.inf:
            raise InputError(f"{where}: {key}: found {getattr(limits, key):g} s, expected a time above 0.")
    if limits.interval >= limits.duration:
        raise InputError(f"{where}: interval: found {limits.interval:g} s in records of {limits.duration:g} s.")
    for key in ("noise", "range"):
        for kind, number in getattr(limits, key).items():
            if kind not in KINDS or not 0.0 < number < math.inf:
                raise InputError(f'{where}: {key}: found {number:g} of "{kind}", expected above 0, by kind of record.')
    for kind, number in limits.correlation_time.items():
        if kind not in KINDS or not 0.0 <= number < math.inf:
            raise InputError(f'{where}: correlation_time: found {number:g} s of "{kind}", expected a time, by kind.')
    legal = study.legal()
    for path, numbers in limits.rig.items():
        if path not in legal:
            raise InputError(f'{where}: rig: found the unknown parameter "{path}"; {nearest(path, legal)}')
        if path in study.parameters and study.parameters[path].free:
            raise InputError(f'{where}: rig: found "{path}", which is free; expected a parameter with a value.')
        for number in numbers:
            check_range(number, legal[path], f'{where}: rig: "{path}"')
    if "friction" in limits.kinds and not limits.amplitude:
        raise InputError(f'{where}: the key "amplitude" is missing, expected those of the motion in friction records.')
    if "force" in limits.kinds and "stop.stiffness" not in study.parameters:
        raise InputError(f'{where}: kinds: found "force" in a study without "stop.stiffness", expected it listed.')


def possible_experiments(study: Study, limits: CompleteLimits) -> list[Experiment]:
    """All experiments that the `limits` allow, on a few levels of what is continuous."""
    levels = lambda low, high: [low] if low == high else np.geomspace(low, high, _LEVELS).tolist()
    voltages, frequencies = levels(*limits.voltage), levels(*limits.frequency)
    rigs = [tuple(zip(limits.rig, numbers, strict=True)) for numbers in itertools.product(*limits.rig.values())]
    found = []
    for kind in limits.kinds:
        if kind == "friction":
            motions = itertools.product(limits.amplitude, frequencies)
            found += [Experiment(kind, None, motion, rig) for rig in rigs for motion in motions]
            continue
        for waveform, rig in itertools.product(waveforms_of(kind, study, limits), rigs):
            drives = _drives(waveform, study, kind, voltages, frequencies, limits.duty)
            found += [Experiment(kind, drive, None, rig) for drive in drives]
    return found


def waveforms_of(kind: str, study: Study, limits: Limits) -> tuple[str, ...]:
    """The waveforms of a kind: those stated, else those of the study's records of that kind, else usual ones."""
    if limits.waveforms:
        return limits.waveforms
    own = [member_name(type(r.drive)) for r in study.records if r.measures == kind and r.drive is not None]
    return tuple(
        dict.fromkeys([*(name for name in own if name in _plannable_waveforms()), *_USUAL.get(kind, ("sawtooth",))])
    )


def _drives(
    waveform: str,
    study: Study,
    kind: str,
    voltages: Sequence[float],
    frequencies: Sequence[float],
    duties: Sequence[float],
) -> list[AbstractDrive]:
    """The drives of a waveform; numbers that are not varied are those of the study's first drive of that waveform."""
    model = member("drive", waveform)
    declared = quantities(model)
    alike = [r.drive for r in study.records if r.drive is not None and type(r.drive) is model]
    base: AbstractDrive = alike[0] if alike else model()
    axes = {"voltage": voltages, "frequency": frequencies} | ({"duty": duties} if duties else {})
    axes = {field: numbers for field, numbers in axes.items() if field in declared}
    words = choices(model).get("direction", {})
    ways = list(words.values()) if words and kind != "platform" else [None]
    made = []
    for numbers in itertools.product(*axes.values()):
        drive = base.with_peak_voltage().with_numbers(dict(zip(axes, numbers, strict=True)))
        made += [drive if way is None else dataclasses.replace(drive, direction=way) for way in ways]
    return [drive for drive in made if not drive.broken_conditions()]
