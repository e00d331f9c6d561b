"""A plan carried out on the virtual rig: its records are made with noise and zeros, and identified without starts.

Records that the plan counts on are made anew as well, at their own samples, so that what the fit has can be compared
with what the plan promised.
"""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..core import check_kind
from ..inference import identify
from ..study import Estimate, Recording, make_recordings
from .information import Noise
from .plan import Errors, Plan


class Rehearsal(NamedTuple):
    """The result of carrying out a plan on the virtual rig."""

    recordings: tuple[Recording, ...]
    """The recordings made so far, where the plan counts on them, then those of the plan."""
    estimate: Estimate
    promised: Errors
    """Standard errors [SI] that the plan promised for a fit of all of these."""

    @property
    def had(self) -> Errors:
        """Standard errors [SI] of the fit, by path."""
        return {path: self.estimate.parameters[path].standard_error for path in self.promised}

    @property
    def ratio(self) -> float:
        """Errors had over errors promised, the geometric mean over all parameters."""
        pairs = [(self.had[path], promised) for path, promised in self.promised.items()]
        logs = [np.log(had / promised) for had, promised in pairs if np.isfinite(had / promised) and had > 0]
        return float(np.exp(np.mean(logs))) if logs else float("nan")


def rehearse(plan: Plan, seed: int = 0, progress: Callable[[str], None] | None = None) -> Rehearsal:
    """Make the records of a plan on the virtual rig and identify them without starts.

    **Arguments:** `seed` of noise and zeros; `progress` takes lines of text.

    **Returns:** records, estimate and what was promised.

    **Raises:** `InputError` where the records cannot be simulated or fitted.
    """
    check_kind("plan", plan, Plan)
    report = progress or (lambda message: None)
    rig = plan.with_rig
    counts_on_records = any(np.isfinite(error) for error in plan.before.values())
    so_far = [r for r in plan.study.records if counts_on_records and r.role == "fit" and np.any(r.measured)]
    noise = plan.limits.noise
    so_far = [r if r.noise is not None else dataclasses.replace(r, noise=noise.get(r.measures, 0.0)) for r in so_far]
    planned = [each.record(rig) for each in plan.records]
    study = dataclasses.replace(rig, records=(*so_far, *planned))
    report("making the records on the virtual rig")
    made = [_with_coloured_noise(plan, recording, seed) for recording in make_recordings(study, seed)]
    # What is free, but for what was measured apart, starts nowhere.
    parameters = {
        path: p if not p.free or p.standard_error is not None else dataclasses.replace(p, start=None)
        for path, p in study.parameters.items()
    }
    measured = dataclasses.replace(study, parameters=parameters, records=tuple(each.record for each in made))
    estimate = identify(measured, progress=report)
    promised = plan.after_identify if counts_on_records and so_far else plan.alone_identify
    return Rehearsal(tuple(made), estimate, promised)


def _with_coloured_noise(plan: Plan, recording: Recording, seed: int) -> Recording:
    """The recording with the coloured noise that the plan counts with, where that is coloured."""
    record = recording.record
    correlation_time = plan.limits.correlation_time.get(record.measures, 0.0)
    if not correlation_time or not record.noise:
        return recording
    random = np.random.default_rng([seed, *record.name.encode()])
    noise = Noise(record.noise, correlation_time).drawn(record.time, random)
    record = dataclasses.replace(record, measured=recording.true + recording.offset + noise)
    return dataclasses.replace(recording, record=record)
