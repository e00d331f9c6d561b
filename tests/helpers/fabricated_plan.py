"""A plan made up by hand: nothing is simulated."""

import numpy as np

import pdssjax
from pdssjax import Limits, Plan, Resources
from pdssjax.design import Experiment, Knowledge, Noise, PlannedRecord
from pdssjax.design.criteria import Determinant
from pdssjax.design.sampling import Schedule
from pdssjax.drive.sawtooth import Sawtooth

SOURCE = """
format = "pdssjax-study/1"
title = "Rig"
actuator = { piezo = "second-order", friction = "simplified-lugre" }

[parameters]
"effector.mass" = { value = "86 g" }
"piezo.gain" = { start = "0.1 um/V" }
"piezo.natural_frequency" = { start = "1072 Hz" }
"piezo.damping_ratio" = { value = 0.18 }
"friction.sigma0" = { value = "1 N/um" }
"friction.sigma1" = { start = 45 }
"friction.f_ss" = { start = "0.65 N" }

[[record]]
name = "20 Hz"
file = "20_Hz.csv"
columns = { time = "time_s", displacement = "displacement_um" }
measures = "effector"
noise = "0.01 um"
sampling = { start = "0.2 s", end = "0.6 s", interval = "0.1 ms" }
drive = { waveform = "sawtooth", voltage = "64 V", frequency = "20 Hz" }
"""
"""A study whose record is still to be made."""


def plan(source):
    """Three records of the study in the file `source`: even, in windows and tilted, and of the contact alone."""
    study = pdssjax.load_study(source, virtual=True)
    records = (
        (Experiment("effector", Sawtooth(63.21, 12.34), None, ()), Schedule(1, 1, 0.01, 100, 1.1e-3)),
        (
            Experiment("effector", Sawtooth(80.0, 20.0, direction="backward"), None, (("effector.tilt", 0.05),)),
            Schedule(0, 4, -1e-3, 25, 5e-5, 4),
        ),
        (Experiment("friction", None, (2e-6, 5.0), ()), Schedule(0, 1, 0.0, 80, 1e-3)),
    )
    planned = tuple(
        PlannedRecord(f"{number} {experiment.name}", experiment, schedule, Noise(1e-8, 1e-3), 1.5)
        for number, (experiment, schedule) in enumerate(records, start=1)
    )
    values = study.values()
    free = [path for path, parameter in study.parameters.items() if parameter.free]
    errors = lambda share: {path: share * values[path] for path in free}
    return Plan(
        study=study,
        knowledge=Knowledge(values),
        criterion=Determinant(),
        limits=Limits(correlation_time={"effector": 1e-3}),
        budget=Resources(600, 3),
        records=planned,
        before=errors(0.1),
        alone=errors(0.02),
        after=errors(0.01),
        alone_identify=errors(0.03),
        after_identify=errors(0.02),
        value=float(np.log(0.01)),
        value_before=float(np.log(0.1)),
        notes=("A note.",),
        candidates=3,
        draws=1,
        seconds=1.0,
    )
