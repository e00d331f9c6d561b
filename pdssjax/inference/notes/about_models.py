"""What the parameters found make of the models: broken conditions, modes that are not to be believed."""

from collections.abc import Mapping, Sequence

import numpy as np

from ...study import SHOWN, Models, Record, Resonance, depends_on, hidden_from
from .words import listed

UNDAMPED = 0.005
"""Damping ratio below which a contact or a platform is not to be believed: it would ring for thirty periods."""


def about_models(models: Models, values: Mapping[str, float]) -> list[str]:
    """Conditions that tie parameters together, and are broken by what was found."""
    broken = models.actuator(values).piezo.broken_conditions()
    return [
        f"The parameters found break a condition of the model: {text}. Set min and max so that it holds, or fix "
        "one of them, and fit again."
        for text in broken
    ]


def about_resonances(
    models: Models, values: dict[str, float], paths: Sequence[str], records: Sequence[Record]
) -> list[str]:
    """Modes that no record is sampled finely enough for, and modes without damping; of free `paths` only."""
    notes = []
    for mode, involved in depends_on(models, values, paths).items():
        seen = [record for record in records if mode.acts_on(record.measurement)]
        if not involved or not seen:
            continue
        if aliased := hidden_from(mode, records):
            notes.append(_alias(mode, involved, aliased))
        if 0.0 < mode.damping_ratio < UNDAMPED:
            notes.append(
                f"The {mode.what} is found to ring at {mode.frequency:.4g} Hz with a damping ratio of "
                f"{mode.damping_ratio:.2g}, for {0.16 / mode.damping_ratio:.0f} periods: that is not to be believed "
                f"of a real one. Look at {listed(involved)}: another start, or min and max, may lead to another "
                "optimum."
            )
    return list(dict.fromkeys(notes))


def _alias(mode: Resonance, involved: Sequence[str], records: Sequence[Record]) -> str:
    rates = [1.0 / float(np.percentile(np.diff(record.time), 10.0)) for record in records]
    names = listed(f'"{record.name}" ({rate:.4g} Hz)' for record, rate in zip(records, rates, strict=True))
    highest_rate, enough = max(rates), float(f"{mode.frequency / SHOWN:.2g}")
    image = abs(mode.frequency - round(mode.frequency / highest_rate) * highest_rate)
    return (
        f"The {mode.what} is found to ring at {mode.frequency:.4g} Hz (damping ratio {mode.damping_ratio:.2g}), above "
        f"the {SHOWN * highest_rate:.4g} Hz that samples at {highest_rate:.4g} Hz show; no record that it acts on is "
        f"sampled more finely: {names}. It may be an alias, since its samples are like those of {image:.4g} Hz. Do not "
        f"trust {listed(involved)} before a record sampled at {enough:g} Hz or more has confirmed "
        f"{'them' if len(involved) > 1 else 'it'}."
        + " A stage this slow needs no resonance: fix it, or choose static dynamics."
        * (mode.what == "platform")
    )
