"""One designed record that tells two friction laws apart, where the thesis's plan does not.

The rig is the thesis's with LuGre's law, its parameters free; the rival is the simplified law, which has no Stribeck
effect.  The rival is fitted to the thesis's plan (three step responses, two walks at 5 Hz and 1 ms), and
`design_experiment` finds the one record, of as many samples as that plan has, that best separates the two.  Then, seed
by seed, all is made anew, and `compare` is asked: of the thesis's records with as many samples more of the same walk,
and with the designed record.  The plan knows the true parameters; where they are known by the thesis's plan alone,
which tells Stribeck's velocity to no order of magnitude, what it promises is as wrong as they are.

    python -m experiments.discrimination [--seeds 50]
"""

import argparse
import dataclasses
from collections.abc import Iterable

import numpy as np

import pdssjax
from experiments.common import Row, print_table, write
from experiments.which_law import CONTACTS
from pdssjax import Aim, Limits, Plan, Record, Resources, Study, prepare_jax
from pdssjax.design import Knowledge, fitted_rival, with_law
from pdssjax.files import EXAMPLE
from pdssjax.study import make_recordings

NAME = "discrimination"
TRUTH, RIVAL = "lugre", "simplified-lugre"
CONTACT = CONTACTS[TRUTH] | {"f_s": 0.85}
"""Of the truth [SI]: a static force two fifths above Coulomb's."""
SAMPLES = 5600
"""Of the record that is added; the thesis's plan has 5605."""


def rig() -> Study:
    """The packaged study's fitted records under the true law; every free parameter starts at the truth."""
    study = pdssjax.load_study(EXAMPLE / "study.toml")
    fitted = tuple(record for record in study.records if record.role == "fit")
    posed = with_law(dataclasses.replace(study, records=fitted), TRUTH)
    stack = {"piezo.gain": 0.1007e-6, "piezo.natural_frequency": 6736.0, "piezo.damping_ratio": 0.1772}
    return posed.with_starts(stack | {f"friction.{name}": number for name, number in CONTACT.items()})


def measured(study: Study, added: Iterable[Record] = (), seed: int = 0) -> Study:
    """The rig's records and those `added`, made with the noise and zeros of a `seed`."""
    whole = dataclasses.replace(study, records=(*study.records, *added))
    return dataclasses.replace(whole, records=tuple(made.record for made in make_recordings(whole, seed)))


def designed(study: Study) -> Plan:
    """The record that best tells the true law from its rival, after a fit of the rival to the thesis's plan."""
    known, truth = measured(study), Knowledge(dict(study.values()))
    rival, rival_knowledge = fitted_rival(known, RIVAL, truth, progress=print)
    return pdssjax.design_experiment(
        known,
        Resources(SAMPLES, 1),
        knowledge=truth,
        limits=Limits(),
        aim=Aim("discrimination", rival=rival, rival_knowledge=rival_knowledge),
        progress=print,
    )


def more_of_the_same(study: Study) -> Record:
    """The last walk of the thesis's plan again, with as many samples as the designed record."""
    walk = study.records[-1]
    times = walk.time[0] + np.arange(SAMPLES) * np.median(np.diff(walk.time))
    return dataclasses.replace(walk, name="the same walk", time=times, measured=np.zeros(SAMPLES))


def is_told(study: Study) -> bool:
    """Whether `compare` chooses the true law and calls the rival worse."""
    found = pdssjax.compare(study, friction=[TRUTH, RIVAL])
    return found.chosen == TRUTH and RIVAL not in found.ambiguous


def main(seeds: int = 50) -> None:
    """Print the table."""
    prepare_jax(dedicated=True)
    study = rig()
    plan = designed(study)
    (planned,) = plan.records
    record = planned.record(plan.with_rig)
    told = {"the thesis's plan, twice the samples": more_of_the_same(study), "and the designed record": record}
    counts = dict.fromkeys(told, 0)
    for seed in range(1, seeds + 1):
        for name, added in told.items():
            counts[name] += is_told(measured(study, [added], seed))
        print(f"{seed} of {seeds}: {', '.join(map(str, counts.values()))} told", flush=True)
    rows = [Row(f"{TRUTH} told from {RIVAL}: {name}", None, count, f"of {seeds}") for name, count in counts.items()]
    notes = [f"The record: {planned.name}, {planned.schedule.count} samples; {plan.criterion.in_words(plan.value)}."]
    write(print_table("Two laws told apart", rows, notes=notes), NAME)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=50)
    main(parser.parse_args().seeds)
