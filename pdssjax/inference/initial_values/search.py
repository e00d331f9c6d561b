"""The search for the starts of a fit where the study gives none.

The piezo: gain, overshoot and time of the first peak of a step response, as in the thesis's
appendix 1; without a step, the slope of the slow flank gives the gain.  A record of the contact
alone tells force, stiffness and speed of what happens there.  What then is still unknown is
looked for by trying a Latin hypercube of plausible values against the records.
"""

import dataclasses
import os
from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float

from ...core import InputError, check_kind, on_device, require_float64
from ...integration import Accuracy
from ...metrics import scatter_floor
from ...piezo.base import Shown
from ...study import MARK, Models, Parameter, Predictor, Record, Study, Values, check_begins_early, split_path
from ..losses.base import AbstractLoss
from ..prior import Prior
from ..residual import TOGETHER, Comparison, Evaluator, as_weights
from .loop_starts import loop_starts
from .record_features import (
    as_quantity,
    contact_scale,
    frequency_of,
    interval_of,
    oscillator,
    peak_bend,
    stop_stiffness,
    swing_of,
)

TRIALS, TRIALS_OF_ONE = 512, 64
"""Points of the hypercube, at most; and along a single unknown: each further one doubles them."""

_COARSE = Accuracy(tolerance=1e-9, settle_tolerance=1e-10)
"""Accuracy of the integration of trials."""

PERIODS = 3.0
"""Periods of a record that the trials are compared with."""

SAMPLES = 2000
"""Samples of a friction record that the trials are compared with."""

NEAR = 1.5
"""Factor by which a start is scattered up and down where no better range is known."""

USUAL_RATE = 6e3
"""Natural frequency [rad/s] assumed of a stack whose model has none."""

AMPLIFIER, SENSOR = 5.0, 1.0
"""Starts of unknown bandwidths, over the frequency at which the platform rings."""

FALL_TIME = "drive.fall_time"


class _Rig(NamedTuple):
    models: Models
    parameters: Mapping[str, Parameter]
    records: Sequence[Record]

    @property
    def fitted(self) -> list[Record]:
        """The records with role "fit"; all of them where none has it."""
        return [record for record in self.records if record.role == "fit"] or list(self.records)

    def clipped(self, path: str, number: float) -> float:
        """`number`, moved inside the bounds of the parameter `path` that the study gives."""
        return float(np.clip(number, *self.parameters[path].bounds()))

    def every(self, known: Mapping[str, float]) -> dict[str, float]:
        """A number for every parameter; one that holds under a condition begins where the usual one does."""
        return {path: known[path] if path in known else known[split_path(path)[0]] for path in self.parameters}

    def split_known(
        self, better: Mapping[str, float]
    ) -> tuple[dict[str, float], dict[str, tuple[float, float]], list[Record]]:
        """The numbers known before a search, the ranges of the others, and the records to search with."""
        parameters, fitted = self.parameters, self.fitted
        known = {path: float(p.number) for path, p in parameters.items() if p.number is not None} | dict(better)
        for record in fitted:
            check_begins_early(record)
        for guess in (self.guess_of_stack, self.guess_of_electronics):
            for path, number in guess(known).items():
                if path in parameters and path not in known:
                    known[path] = self.clipped(path, number)
        blocked = [record for record in as_quantity(fitted, "force") if record.measurement.blocked]
        stiffnesses = [stop_stiffness(record, self.gain_and_rate(known)[0]) for record in blocked]
        if "stop.stiffness" in parameters and "stop.stiffness" not in known and any(stiffnesses):
            known["stop.stiffness"] = self.clipped("stop.stiffness", max(stiffnesses))
        unknown = [path for path in parameters if path not in known and MARK not in path]
        ranges = self.ranges(known, unknown)
        for path in [path for path in unknown if path not in ranges]:
            known[path] = self.clipped(path, parameters[path].quantity.nominal)
        return known, ranges, [record for record in fitted if not record.measurement.platform_alone] if ranges else []

    def gain_and_rate(self, known: Mapping[str, float]) -> tuple[float, float]:
        """Gain [m/V] and first natural frequency [rad/s] of the stack with the numbers `known`, others nominal."""
        piezo = self.models.actuator(known).piezo
        rates = np.atleast_1d(getattr(getattr(piezo, "modes", piezo), "natural_frequency", USUAL_RATE))
        return float(piezo.static_gain()), float(rates[0])

    def guess_of_stack(self, known: Mapping[str, float]) -> dict[str, float]:
        """Starts of the stack's parameters that its model derives from features of the records."""
        models, driven = self.models, [record for record in self.fitted if record.drive is not None]
        shown = Shown(
            **oscillator(driven, "piezo.natural_frequency" in models.declared()),
            swing=max(map(swing_of, driven), default=0.0) or None,
            duration=max((float(record.time[-1]) for record in driven), default=0.0) or None,
            interval=min(map(interval_of, driven), default=None),
        )
        usual = {path: number for path, number in known.items() if MARK not in path}
        given = {path.removeprefix("piezo."): number for path, number in usual.items() if path.startswith("piezo.")}
        found = models.piezo.first_guess(shown, given)
        if not models.feedback:
            found |= loop_starts(models.piezo, shown, given, driven)
        return {f"piezo.{name}": number for name, number in found.items()}

    def guess_of_electronics(self, known: Mapping[str, float]) -> dict[str, float]:
        """Starts of an amplifier and a sensor that visibly change the platform's motion.

        The amplifier slews as fast as the platform rises.  With bandwidths far from the platform's frequency a fit
        would begin where they change nothing, or where they hide the platform.
        """
        driven = [(record, record.drive) for record in self.fitted if record.drive is not None]
        if not driven:
            return {}
        _, rate = self.gain_and_rate(known)
        volts = max(float(drive.peak()) for _, drive in driven) or 1.0
        ringing, finest = rate / (2.0 * np.pi), min(interval_of(record) for record, _ in driven)
        return {
            "amplifier.bandwidth": AMPLIFIER * ringing,
            "amplifier.slew": 0.1 * volts * rate,
            "sensor.bandwidth": min(SENSOR * ringing, 0.25 / finest),
        }

    def ranges(self, known: Mapping[str, float], unknown: Sequence[str]) -> dict[str, tuple[float, float]]:
        """The ranges in which to search `unknown` parameters, on logarithmic scales."""
        records, (gain, rate) = self.fitted, self.gain_and_rate(known)
        mass = known.get("effector.mass", 0.1)
        moved = mass if any(record.measurement.effector_moves for record in records) else None
        contacts = [contact_scale(r, moved) for r in as_quantity(records, "force") if not r.measurement.driven]
        driven = (mass, gain * max((peak_bend(r, rate, known) for r in records), default=0.0) or rate**2 * gain, rate)
        friction = self.models.friction.search_ranges(*(np.median(contacts, axis=0) if contacts else driven))
        ranges = {f"friction.{name}": ends for name, ends in friction.items()}
        ranges["piezo.natural_frequency"] = (0.3 * rate, 3.0 * rate)
        ranges["piezo.damping_ratio"] = (0.03, 0.6)
        periods = [1.0 / frequency for frequency in map(frequency_of, records) if frequency]
        longest = min(0.02, 0.1 * min(periods, default=0.1))
        ranges[FALL_TIME] = (min(1e-4, 0.1 * longest), longest)
        clipped = {}
        for path in unknown:
            if path in ranges:
                low, high = (self.clipped(path, end) for end in ranges[path])
                clipped[path] = (low, high) if low < high else (0.999 * low, low)
        return clipped

    def search(
        self,
        known: dict[str, float],
        ranges: Mapping[str, tuple[float, float]],
        used: Sequence[Record],
        loss: AbstractLoss | None,
        share: float = 1.0,
    ) -> list[dict[str, float]]:
        """The trials against the first periods of those records that are `used`, the best first."""
        paths = list(ranges)
        low, high = (np.log([ranges[path][end] for path in paths]) for end in (0, 1))
        usual = min(TRIALS, TRIALS_OF_ONE * 2 ** (len(paths) - 1))
        random, count = np.random.default_rng(0), max(1, round(share * usual))
        strata = np.stack([random.permutation(count) for _ in paths], axis=1)
        points = low + (high - low) * (strata + random.random(strata.shape)) / count
        trials = [{path: float(np.exp(x)) for path, x in zip(paths, point, strict=True)} for point in points]
        costs = _trial_costs(self, used, loss, [self.every(known | trial) for trial in trials])
        order = np.argsort(np.where(np.isfinite(costs), costs, np.inf))
        return [trials[i] for i in order]


def guess_starts(
    models: Models, parameters: Mapping[str, Parameter], records: Sequence[Record]
) -> tuple[dict[str, float], bool]:
    """A number for every listed parameter without a search, and whether a search would find better ones."""
    rig = _Rig(models, parameters, records)
    known, ranges, searchable = rig.split_known({})
    known |= {path: float(np.sqrt(low * high)) for path, (low, high) in ranges.items()}
    return rig.every(known), bool(searchable)


def rank_starts(
    models: Models,
    parameters: Mapping[str, Parameter],
    records: Sequence[Record],
    better: Mapping[str, float] | None = None,
    share: float = 1.0,
    loss: AbstractLoss | None = None,
) -> list[dict[str, float]]:
    """Starts for every listed parameter [SI] from a search, the most promising first.

    **Arguments:** `better` numbers are taken in place of the starts given or found; a `share` of the usual number of
    points is tried.  The `loss` of the fit judges them, that of squares by default.
    """
    rig = _Rig(models, parameters, records)
    known, ranges, searchable = rig.split_known(better or {})
    if not searchable:
        return [guess_starts(models, parameters, records)[0] | dict(better or {})]
    return [rig.every(known | trial) for trial in rig.search(known, ranges, searchable, loss, share)]


def scatter_starts(
    models: Models,
    parameters: Mapping[str, Parameter],
    records: Sequence[Record],
    around: Mapping[str, float],
    held: Collection[str] = (),
    to_sticking: bool = False,
    loss: AbstractLoss | None = None,
) -> list[dict[str, float]]:
    """Starts that differ in every free parameter, the most promising first, whether or not the study gives a start.

    For fits that are compared with others: a search of what is unknown alone leaves them all near one minimum.

    **Arguments:** numbers [SI] `around` which to search those that have no range of their own, within a
    factor `NEAR`; the paths `held` there, as are signed parameters.  Friction forces are searched up to those
    at which nothing slips, if `to_sticking`, else below a third of it, where motion is large.  The `loss` as of
    `rank_starts`.
    """
    rig, ranges = _Rig(models, parameters, records), scatter_ranges(models, parameters, records, around, held)
    if to_sticking:
        # Friction forces reach up to m a, the most that ever accelerates the end-effector.  The acceleration a is that
        # of the shortest fall time in the ranges: the usual ranges know it where it starts alone.
        shortest = dict(around) | {path: low for path, (low, _) in ranges.items() if path == FALL_TIME}
        gain, rate = rig.gain_and_rate(shortest)
        bend = max((peak_bend(record, rate, shortest) for record in rig.fitted), default=0.0)
        largest = shortest.get("effector.mass", 0.1) * gain * bend
        for path, (low, high) in ranges.items():
            if path.startswith("friction.") and parameters[path].quantity.unit == "N":
                ranges[path] = (low, max(high, rig.clipped(path, largest)))
    used = [record for record in rig.fitted if not record.measurement.platform_alone]
    if not (ranges and used):
        return []
    known = {path: number for path, number in around.items() if path not in ranges}
    return [{path: (known | trial)[path] for path in parameters} for trial in rig.search(known, ranges, used, loss)]


def scatter_ranges(
    models: Models,
    parameters: Mapping[str, Parameter],
    records: Sequence[Record],
    around: Mapping[str, float],
    held: Collection[str] = (),
) -> dict[str, tuple[float, float]]:
    """The ranges [SI] over which starts are scattered, by path; arguments as of `scatter_starts`."""
    rig, ranges = _Rig(models, parameters, records), {}
    free = [path for path, p in parameters.items() if p.free and path not in held]
    for path in free:
        if parameters[path].quantity.positive:
            low, high = (rig.clipped(path, end) for end in (around[path] / NEAR, around[path] * NEAR))
            if low < high:
                ranges[path] = (low, high)
    return ranges | rig.ranges(around, free)


def _trial_costs(
    rig: _Rig, used: Sequence[Record], loss: AbstractLoss | None, trials: Sequence[Values]
) -> Float[np.ndarray, " trials"]:
    """The sum of the `loss` over the first periods of the records `used`, by the numbers [SI] of each trial.

    The first periods are enough to rank trials, and quick where a contact never rests.  The compiled function of a fit
    predicts them, side by side on all cores.
    """
    models, parameters, records = rig
    if any(record.motion is not None for record in used):
        thinned = []
        for record in used:
            if record.motion is not None:
                # Every so many samples of a friction curve, of a loop the first ones.
                curve = record.measurement.prescribed == "velocity"
                few = slice(None, None, -(-record.time.size // SAMPLES)) if curve else slice(SAMPLES)
                parts = {name: getattr(record, name)[few] for name in ("time", "measured", "motion")}
                record = dataclasses.replace(record, **parts)
            thinned.append(record)
        records = used = thinned
    ends = np.zeros(len(records))
    for place, record in enumerate(records):
        frequency = frequency_of(record) if record.motion is None else None
        ends[place] = record.time[0] + PERIODS / frequency if frequency else record.time[-1]
    fitted = [place for place, record in enumerate(records) if record.role == "fit"]
    places = tuple(fitted or range(len(records)))
    compared = [records[place] for place in places]
    early = tuple(record.time <= ends[place] for place, record in zip(places, compared, strict=True))
    comparison = Comparison(compared, loss, Prior.measured_apart(parameters))
    comparison = eqx.tree_at(lambda comparison: comparison.used, comparison, early)
    is_used = np.array([any(record is other for other in used) for record in records])
    noises = [scatter_floor(record.measured[e]) for record, e in zip(compared, early, strict=True)]
    weights = as_weights(noises, is_used[list(places)])
    predictor, comparison = on_device((Predictor(models, records).until(ends), comparison))
    free = tuple(path for path, parameter in parameters.items() if parameter.free)
    evaluator = Evaluator(predictor, comparison, _COARSE, places, tuple(sorted(parameters)), free)
    costs = lambda some: np.asarray(evaluator(some, weights, is_used).squares)[: len(some)]
    first, *others = (trials[begin : begin + TOGETHER] for begin in range(0, len(trials), TOGETHER))
    found = [costs(first)]  # alone: it compiles what the others share
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return np.concatenate([*found, *pool.map(costs, others)])


def initial_guess(study: Study) -> dict[str, float]:
    """A number [SI] for every listed parameter: its value, its start, or else a guess from the records.

    The piezo's come from its step responses (thesis, appendix 1) or slow flanks; what then is
    unknown is searched for by trying plausible points against the records, which takes some
    seconds.  A guess is where a fit may begin, not an estimate: expect factors, not percents.

    **Raises:** `InputError` where a guess is needed from records that are still to be made, and where JAX works in
    single precision.
    """
    require_float64("initial_guess")
    check_kind("study", study, Study, "load_study")
    missing = study.missing()
    unmade = [record.name for record in study.records if not np.any(record.measured)]
    if missing and unmade:
        raise InputError(
            f"{study.path or study.title}: parameters: found no number for {', '.join(missing)}; expected one for "
            f'each, since the record "{unmade[0]}" is still to be made and has no data to guess from.'
        )
    return rank_starts(study.models, study.parameters, study.records)[0]
