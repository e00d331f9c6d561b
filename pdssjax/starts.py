"""Where a fit starts when the study does not say: found from the data.

The piezo: gain, overshoot and time of the first peak of a step response, as in the thesis's
appendix 1; without a step, the slope of the slow flank gives the gain.  A record of the contact
alone tells force, stiffness and speed of what happens there.  What then is still unknown is
looked for by trying a Latin hypercube of plausible values against the records.
"""

import dataclasses
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax

from .hold import waveform
from .integration import Accuracy
from .parameters import Parameter, scale
from .prediction import Models
from .quantity import quantities
from .records import Record
from .residual import Residual, as_weights, noise_floor

TRIALS = 512
"""Points of the hypercube."""
_TOGETHER = 16
"""Of them are tried by one core one after the other; `TRIALS` is a multiple of it."""
PERIODS = 3.0
"""Periods of a record that the trials are compared with."""
SAMPLES = 2000
"""Samples of a friction record that the trials are compared with."""


def find_starts(models: Models, parameters: Mapping[str, Parameter], records: Sequence[Record]) -> dict[str, float]:
    """A number for every listed parameter [SI]: its value, its start, or the best one found from the data."""
    return rank_starts(models, parameters, records)[0]


def guess_starts(
    models: Models, parameters: Mapping[str, Parameter], records: Sequence[Record]
) -> tuple[dict[str, float], bool]:
    """A number for every listed parameter without a search, and whether a search would find better ones."""
    known, ranges, searchable = _outset(models, parameters, records, {})
    known |= {path: float(np.sqrt(low * high)) for path, (low, high) in ranges.items()}
    return {path: known[path] for path in parameters}, bool(searchable)


def rank_starts(
    models: Models,
    parameters: Mapping[str, Parameter],
    records: Sequence[Record],
    better: Mapping[str, float] | None = None,
) -> list[dict[str, float]]:
    """Starts for every listed parameter [SI] from a search, the most promising first.

    **Arguments:** `better` numbers are taken in place of the starts given or found.
    """
    known, ranges, searchable = _outset(models, parameters, records, better or {})
    if not searchable:
        return [guess_starts(models, parameters, records)[0] | dict(better or {})]
    trials = _search(models, known, ranges, parameters, searchable)
    return [{path: (known | trial)[path] for path in parameters} for trial in trials]


def _outset(models, parameters, records, better):
    """What is known before a search, the ranges of what is not, and the records to search with."""
    given = {path: p.value if p.value is not None else p.start for path, p in parameters.items()}
    known = {path: float(number) for path, number in given.items() if number is not None} | dict(better)
    fitted = [record for record in records if record.role == "fit"] or list(records)
    for path, number in _piezo_from_data(fitted).items():
        if path in parameters and path not in known:
            known[path] = _within(number, parameters[path])
    pushes = [_stop_stiffness(record, known.get("piezo.gain", 1e-7)) for record in fitted if record.measures == "force"]
    if "stop.stiffness" in parameters and "stop.stiffness" not in known and any(pushes):
        known["stop.stiffness"] = _within(max(pushes), parameters["stop.stiffness"])
    unknown = [path for path in parameters if path not in known]
    ranges = _ranges(models, known, unknown, parameters, fitted)
    for path in [path for path in unknown if path not in ranges]:
        known[path] = _within(parameters[path].quantity.nominal, parameters[path])
    return known, ranges, [record for record in fitted if record.measures != "platform"] if ranges else []


def _within(number: float, parameter: Parameter) -> float:
    """`number`, moved inside the bounds that the study gives."""
    low = parameter.quantity.low if parameter.low is None else parameter.low
    high = parameter.quantity.high if parameter.high is None else parameter.high
    return float(np.clip(number, low, high))


def _piezo_from_data(records: Sequence[Record]) -> dict[str, float]:
    steps = [r for r in records if r.measures == "platform" and _is_step(r)]
    if steps:
        # A slow record of creep does not show how the platform rings.
        finest = min(map(_interval, steps))
        steps = [record for record in steps if _interval(record) < 2.0 * finest]
        found = [_from_step(record) for record in steps]
        return {path: float(np.median([f[path] for f in found])) for path in found[0]}
    flanks = [
        _flank_gain(r)
        for r in records
        if r.measures != "force" and _frequency(r) and hasattr(waveform(r.drive), "fall_time")
    ]
    follows = [_range_gain(r) for r in records if r.measures == "platform"]
    gains = flanks or follows
    return {"piezo.gain": float(np.median(gains))} if gains else {}


def _frequency(record: Record) -> float | None:
    """Of a drive that repeats, held or not [Hz]."""
    frequency = getattr(waveform(record.drive), "frequency", None)
    return float(frequency) if frequency else None


def _interval(record: Record) -> float:
    """From one sample to the next [s]."""
    return float(np.median(np.diff(record.time)))


def _volts(record: Record) -> np.ndarray:
    """The voltage at the samples [V]; 0 where none is applied."""
    return np.zeros(1) if record.drive is None else np.asarray(_voltage(record.drive, record.time))


@eqx.filter_jit
def _voltage(drive, time):
    return drive.at(time)


def _amplitude(record: Record) -> float:
    """Largest voltage [V]."""
    given = getattr(waveform(record.drive), "voltage", None)
    return float(np.max(np.abs(_volts(record)))) if given is None else abs(float(given))


def _is_step(record: Record) -> bool:
    """The voltage goes to one level within the first tenth of the record, and stays there."""
    volts, last = _volts(record), record.time[-1]
    late = volts[record.time > 0.1 * last]
    return bool(late.size and abs(volts[-1]) > 0 and np.all(np.abs(late - volts[-1]) < 0.01 * abs(volts[-1])))


def _range_gain(record: Record) -> float:
    """A platform that hardly rings goes as far as the voltage does."""
    return float(np.ptp(record.measured) / (np.ptp(_volts(record)) or 1.0))


def _from_step(record: Record) -> dict[str, float]:
    """Gain, natural frequency and damping ratio from the peak and the end of a step response."""
    time, y = record.time, record.measured
    before = time < 0
    after = time >= 0
    end = float(np.mean(y[-max(y.size // 5, 1) :]))
    zero = float(np.mean(y[before])) if before.any() else float(y[after][0])
    rise = (y[after] - zero) / ((end - zero) or 1e-12)
    peak = int(np.argmax(rise))
    overshoot = float(np.clip(rise[peak] - 1.0, 1e-3, 0.98))
    logarithm = np.log(overshoot)
    damping = -logarithm / np.hypot(np.pi, logarithm)
    delay = max(float(time[after][peak]), _interval(record))
    return {
        "piezo.gain": abs(end - zero) / (abs(float(_volts(record)[-1])) or 1.0),
        "piezo.damping_ratio": float(damping),
        "piezo.natural_frequency": float(np.pi / delay / np.sqrt(1.0 - damping**2)),
    }


def _flank_gain(record: Record) -> float:
    """While it sticks, the end-effector follows the slow flank: the usual slope over the voltage's.

    Taken over a quarter of a period, so that noise and rounding matter little, and most of
    the spans hold no slip.
    """
    drive: Any = waveform(record.drive)
    span = int(np.clip(0.25 / float(drive.frequency) / _interval(record), 1, record.time.size - 1))
    rise = record.measured[span:] - record.measured[:-span]
    slope = float(np.median(rise / (record.time[span:] - record.time[:-span])))
    return abs(slope) / abs(float(drive.voltage) * float(drive.frequency))


def _stop_stiffness(record: Record, gain: float) -> float:
    """While the contact sticks, the stop is pressed as far as the platform goes [N/m]; 0 where nothing pushes.

    Of the rises within a tenth of a period the steepest tenth: later the contact slides, earlier
    the end-effector may not have reached the stop.
    """
    frequency = _frequency(record)
    if not frequency or record.time.size < 8:
        return 0.0
    span = int(np.clip(0.1 / frequency / _interval(record), 1, record.time.size // 2))
    raised, pushed = (values[span:] - values[:-span] for values in (_volts(record), record.measured))
    usual = float(np.percentile(raised, 75.0))
    rises = raised > 0.5 * usual
    steep = float(np.percentile(pushed[rises] / raised[rises], 90.0)) if usual > 0 else 0.0
    return max(steep, 0.0) / gain


def _ranges(models, known, unknown, parameters, records) -> dict[str, tuple[float, float]]:
    """Where to look for what is unknown, on logarithmic scales."""
    value = lambda path, otherwise: known.get(path, otherwise)
    nominal = {f"piezo.{name}": q.nominal for name, q in quantities(models.piezo).items()}
    rate = value("piezo.natural_frequency", nominal.get("piezo.natural_frequency", 6e3))
    gain = value("piezo.gain", nominal.get("piezo.gain", 1e-7))
    volts = max((_amplitude(r) for r in records), default=1.0) or 1.0
    mass = value("effector.mass", 0.1)
    moved = mass if any(record.measures in ("effector", "force") for record in records) else None
    contacts = [_contact_scale(record, moved) for record in records if record.measures == "friction"]
    driven = (mass, gain * volts * rate**2, rate)
    friction = models.friction.plausible(*(np.median(contacts, axis=0) if contacts else driven))
    ranges = {f"friction.{name}": ends for name, ends in friction.items()}
    ranges["piezo.natural_frequency"] = (0.3 * rate, 3.0 * rate)
    ranges["piezo.damping_ratio"] = (0.03, 0.6)
    periods = [1.0 / frequency for frequency in map(_frequency, records) if frequency]
    ranges["drive.fall_time"] = (1e-4, min(0.02, 0.1 * min(periods, default=0.1)))
    clipped = {}
    for path in unknown:
        if path in ranges:
            low, high = (_within(end, parameters[path]) for end in ranges[path])
            clipped[path] = (low, high) if low < high else (0.999 * low, low)
    return clipped


def _contact_scale(record: Record, moved: float | None) -> tuple[float, float, float]:
    """Mass, acceleration and rate that stand for what a friction record shows, as `plausible` wants them.

    Its force F and its stiffness k (the steepest tenth of the loops) put the middle of the ranges: a mass
    m moved like that of an actuator has 0.3 m rate^2 = k and 0.035 m a = F there.  The mass is that of the
    end-effector where one is `moved` [kg]: its contact is damped as suits its own ringing, however slow
    the loops are.  Without one the rate is k v/F, at which the contact follows the record's speed v.
    """
    assert record.motion is not None
    force = 0.5 * float(np.subtract(*np.percentile(record.measured, [95.0, 5.0]))) or 1e-3
    steps, pulled = np.diff(record.motion), np.diff(record.measured)
    stroke = float(np.ptp(record.motion)) or 1e-6
    moves = np.abs(steps) > 1e-4 * stroke
    slopes = (pulled[moves] / steps[moves]) if moves.any() else np.zeros(1)
    stiffness = max(float(np.percentile(slopes, 90.0)), force / stroke)
    speed = float(np.median(np.abs(steps[moves] / np.diff(record.time)[moves]))) if moves.any() else stroke
    mass = stiffness / (0.3 * (stiffness * speed / force) ** 2) if moved is None else moved
    return mass, force / (0.035 * mass), float(np.sqrt(stiffness / (0.3 * mass)))


def _search(models, known, ranges, parameters, records) -> list[dict[str, float]]:
    """The trials against the first periods of the `records`, the best first."""
    paths = list(ranges)
    low, high = (np.log([ranges[path][end] for path in paths]) for end in (0, 1))
    random = np.random.default_rng(0)
    strata = np.stack([random.permutation(TRIALS) for _ in paths], axis=1)
    points = low + (high - low) * (strata + random.random(strata.shape)) / TRIALS
    used = [_beginning(record) for record in records]
    searched = {path: Parameter(path, p.unit, p.quantity) for path, p in parameters.items() if path in ranges}
    first = {path: float(np.exp(x)) for path, x in zip(paths, points[0], strict=True)}
    ordered = scale({path: searched[path] for path in paths}, first)
    residual = Residual(models, used, ordered, known, Accuracy(tolerance=1e-9, rest=1e-10))
    weights = as_weights([noise_floor(record) for record in used], [True] * len(used))
    encoded = np.stack([ordered.encode(dict(zip(paths, np.exp(point), strict=True))) for point in points])
    costs = _tried(residual, encoded, weights)
    order = np.argsort(np.where(np.isfinite(costs), costs, np.inf))
    return [{path: float(np.exp(x)) for path, x in zip(paths, points[i], strict=True)} for i in order]


def _beginning(record: Record) -> Record:
    """The first periods of a `record`: enough to tell a trial by, and quick where a contact never rests."""
    if record.motion is not None:
        parts = {name: getattr(record, name)[:SAMPLES] for name in ("time", "measured", "motion")}
        return dataclasses.replace(record, **parts)
    frequency = _frequency(record)
    if not frequency:
        return record
    kept = record.time <= record.time[0] + PERIODS / float(frequency)
    return dataclasses.replace(record, time=record.time[kept], measured=record.measured[kept])


def _tried(residual, points, weights) -> np.ndarray:
    """Chi-square at each of the `points`, shape (trials, parameters), side by side on all cores."""
    parts = points.reshape(-1, _TOGETHER, points.shape[1])
    one = lambda part: np.asarray(_costs(residual, part, weights))
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        # The first part alone: it compiles what the others share.
        return np.concatenate([one(parts[0]), *pool.map(one, parts[1:])])


@eqx.filter_jit
def _costs(residual, points, weights):
    return lax.map(lambda point: jnp.sum(residual(point, weights)[0] ** 2), points)
