"""The rival of a study for discrimination: the same actuator with another friction law, fitted to the same records."""

import dataclasses
from collections.abc import Callable

import numpy as np

from ..core import InputError, member_name, members, nearest
from ..inference import effort_of, identify
from ..selection import Candidate, candidates_of, starting_near
from ..study import Estimate, Record, Study, make_recordings
from .experiments import Experiment, Limits, completed_limits, possible_experiments
from .plan import Knowledge, knowledge_of

_SAMPLES = 1000
"""Samples of each record that a rival is fitted to where the study has none."""

_CYCLES = 3
"""Cycles of each of these records at most."""


def with_law(study: Study, law: str) -> Study:
    """The study under another friction law, as `compare` poses it: what both laws have keeps its number or start.

    **Raises:** `InputError` where there is no such law, it is the study's own, or the study cannot be posed under it.
    """
    return _candidate_with(study, law).study


def _candidate_with(study: Study, law: str) -> Candidate:
    known = members("friction")
    if law not in known:
        raise InputError(f'against: found "{law}"; {nearest(law, known)}')
    if law == member_name(study.friction):
        raise InputError(f'against: found "{law}", which is the law of the study itself; expected another one.')
    (other,) = (candidate for candidate in candidates_of(study, [law]) if not candidate.is_own)
    if other.refused:
        raise InputError(f'against: "{law}": {other.refused}.')
    return other


def fitted_rival(
    study: Study,
    law: str,
    knowledge: Knowledge | Estimate | None = None,
    limits: Limits | None = None,
    progress: Callable[[str], None] | None = None,
) -> tuple[Study, Knowledge]:
    """The study with another law, its parameters fitted; and what that fit knows of them.

    It is fitted to the study's records, or where these are still to be made to what the study's own law predicts of a
    few records within the `limits`.  The fit begins at what is known of the study's own law; where it creeps along a
    valley, as those of a wrong law may, its best point is taken: what a better one would explain counts to first order.

    **Arguments:** `knowledge` tells the numbers of the study's own law where it has none; `progress` takes lines.

    **Raises:** `InputError` for an unknown law, and where it cannot be simulated.
    """
    rival = _candidate_with(study, law)
    if knowledge is None:
        values = {path: p.number for path, p in study.parameters.items() if p.free and p.number is not None}
    else:
        values = (knowledge_of(knowledge) if isinstance(knowledge, Estimate) else knowledge).values
    records = [record for record in study.records if record.role == "fit" and np.any(record.measured)]
    if not records:
        records = _simulated_records(study.with_values(values) if values else study, limits or Limits())
    estimate = identify(
        dataclasses.replace(starting_near(rival, values), records=tuple(records)),
        effort=effort_of("quick")._replace(compares=False),
        progress=None if progress is None else lambda line: progress(f"fitting {law}: {line}"),
    )
    if not np.isfinite(estimate.statistics.chi2):
        raise InputError(f'against: found no fit of "{law}" to the records: {estimate.message}.')
    found = knowledge_of(estimate)
    return rival.study.with_starts({path: found.values[path] for path in rival.free}), found


def _simulated_records(study: Study, limits: Limits) -> list[Record]:
    """A few records of the study's own law, with noise and zeros."""
    complete = completed_limits(study, limits, {})
    # The first and the last of each kind, waveform and direction: least and greatest voltage and frequency.
    groups: dict[object, list[Experiment]] = {}
    for experiment in possible_experiments(study, complete):
        groups.setdefault((experiment.group, experiment.words.get("direction"), experiment.rig), []).append(experiment)
    few = [e for group in groups.values() for e in dict.fromkeys([group[0], group[-1]])]
    records = []
    for number, experiment in enumerate(few):
        end = complete.duration if experiment.period is None else min(_CYCLES * experiment.period, complete.duration)
        times = np.arange(1, _SAMPLES + 1) * max(complete.interval, end / _SAMPLES)
        noise = complete.noise[experiment.kind]
        records.append(experiment.record(study, f"{number} {experiment.name}", times, noise))
    recordings = make_recordings(dataclasses.replace(study, records=tuple(records)))
    return [recording.record for recording in recordings]
