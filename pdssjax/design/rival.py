"""The rival of a study for discrimination: the same actuator with another friction law, fitted to the same records."""

import dataclasses
from collections.abc import Callable

import numpy as np

from ..core import InputError, member, members, nearest, quantities
from ..inference import identify
from ..study import Estimate, Parameter, Record, Study, make_recordings
from .experiments import Experiment, Limits, completed_limits, possible_experiments
from .plan import Knowledge, knowledge_of

_SAMPLES = 1000
"""Samples of each record that a rival is fitted to where the study has none."""

_CYCLES = 3


def with_law(study: Study, law: str) -> Study:
    """A study whose friction law is replaced, all parameters of the other law free and without starts.

    Parameters that both laws have by the same name keep the numbers, as where friction starts.

    **Raises:** `InputError` where there is no such law, or it is the study's own.
    """
    known = members("friction")
    if law not in known:
        raise InputError(f'against: found "{law}"; {nearest(law, known)}')
    friction = member("friction", law)
    if friction is study.friction:
        raise InputError(f'against: found "{law}", which is the law of the study itself; expected another one.')
    other = {path: p for path, p in study.parameters.items() if not path.startswith("friction.")}
    for field, declared in quantities(friction).items():
        path = f"friction.{field}"
        if not declared.optional:
            other[path] = study.parameters.get(path) or Parameter(path, declared.unit, declared)
    return dataclasses.replace(study, friction=friction, parameters=other)


def fitted_rival(
    study: Study,
    law: str,
    knowledge: Knowledge | Estimate | None = None,
    limits: Limits | None = None,
    progress: Callable[[str], None] | None = None,
) -> tuple[Study, Knowledge]:
    """The study with another law, its parameters fitted; and what that fit knows of them.

    It is fitted to the study's records, or where these are still to be made to what the study's own law predicts of a
    few records within the `limits`.

    **Arguments:** `knowledge` tells the numbers of the study's own law where it has none; `progress` takes lines.

    **Raises:** `InputError` for an unknown law, and where it cannot be fitted.
    """
    rival = with_law(study, law)
    records = [record for record in study.records if record.role == "fit" and np.any(record.measured)]
    if not records:
        known = knowledge_of(knowledge) if isinstance(knowledge, Estimate) else knowledge
        own = study if known is None else study.with_values(known.values)
        records = _made(own, limits or Limits())
    estimate = identify(
        dataclasses.replace(rival, records=tuple(records)),
        effort="quick",
        progress=None if progress is None else lambda line: progress(f"fitting {law}: {line}"),
    )
    found = knowledge_of(estimate)
    if not estimate.converged:
        raise InputError(f'against: found no fit of "{law}" to the records: {estimate.message}.')
    starts = {path: found.values[path] for path, p in rival.parameters.items() if p.free}
    return rival.with_starts(starts), found


def _made(study: Study, limits: Limits) -> list[Record]:
    """A few records of the study's own law, with noise and zeros."""
    complete = completed_limits(study, limits, {})
    assert complete.interval is not None and complete.duration is not None
    records = []
    for number, experiment in enumerate(_few(possible_experiments(study, complete))):
        end = complete.duration if experiment.period is None else min(_CYCLES * experiment.period, complete.duration)
        times = np.arange(1, _SAMPLES + 1) * max(complete.interval, end / _SAMPLES)
        noise = complete.noise[experiment.kind]
        records.append(experiment.record(study, f"{number} {experiment.name}", times, noise))
    recordings = make_recordings(dataclasses.replace(study, records=tuple(records)))
    return [recording.record for recording in recordings]


def _few(experiments: list[Experiment]) -> list[Experiment]:
    """The first and the last of each kind, waveform and direction: least and greatest voltage and frequency."""
    groups: dict[object, list[Experiment]] = {}
    for experiment in experiments:
        groups.setdefault((experiment.group, experiment.words.get("direction"), experiment.rig), []).append(experiment)
    return [e for group in groups.values() for e in dict.fromkeys([group[0], group[-1]])]
