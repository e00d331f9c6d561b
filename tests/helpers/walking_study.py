"""A small study of a platform and a walking end-effector, with an estimate and a sweep: made, not fitted."""

import dataclasses
import json

import fabricated
import numpy as np
import platform_study
import xarray
from record_tables import sawtooth_table, step_table

from pdssjax import load_study
from pdssjax.files import estimate_text

_HEAD = """\
format = "pdssjax-study/1"
title = "Walking rig"

[actuator]
piezo = "second-order"
friction = "simplified-lugre"

[parameters]
"piezo.gain" = { start = "0.1 um/V" }
"piezo.natural_frequency" = { start = "1 kHz" }
"piezo.damping_ratio" = { start = 0.25, min = 0.05, max = 0.6 }
"effector.mass" = { value = "86 g" }
"friction.sigma0" = { value = "1.1 N/um" }
"friction.sigma1" = { value = 45 }
"friction.f_ss" = { value = "0.65 N" }
"drive.fall_time" = { value = 0 }
"""
STUDY = "\n".join([_HEAD, step_table(platform_study.NOISE_LINE), sawtooth_table('role = "validate"', voltage="64 V")])


def write_walking(folder):
    """The study and its two records; the study's path."""
    study = platform_study.write_platform(folder, STUDY)
    time = np.arange(0.0, 0.25, 5e-4)
    write_walk(folder, time, fabricated.walk_motion(time, 20.0))
    return study


def write_walk(folder, time, motion):
    """The record of a walk: its `motion` [m] at `time` [s], with noise."""
    noisy = motion + np.random.default_rng(1).normal(0.0, platform_study.NOISE, time.size)
    rows = np.stack([time, 1e6 * noisy], axis=1)
    np.savetxt(folder / "walk.csv", rows, "%.7f", ",", header="time_s,displacement_um", comments="")


def write_made_estimate(study_file, folder):
    """An estimate.json whose parameters are those of the study, with a profile of each free one; its path."""
    study, made = load_study(study_file), fabricated.estimate()
    found = {}
    for path, p in study.parameters.items():
        number = study.values()[path]
        told = fabricated.parameter(path, number, 0.01 * number, p.unit)
        found[path] = told if p.free else fabricated.fixed(path, number, p.unit)
    names = tuple(path for path, p in study.parameters.items() if p.free)
    (profile, *_) = fabricated.profiles(made.parameters)
    profiles = tuple(dataclasses.replace(profile, path=name) for name in names)
    whole = dataclasses.replace(
        made,
        parameters=found,
        names=names,
        correlation=(correlation := np.array([[1.0, 0.4, -0.1], [0.4, 1.0, 0.72], [-0.1, 0.72, 1.0]])),
        covariance=1e-4 * correlation,
        profiles=profiles,
    )
    folder.mkdir(exist_ok=True)
    (folder / "estimate.json").write_text(estimate_text(whole), encoding="utf-8")
    return folder / "estimate.json"


def made_sweep(frequencies=(10.0, 20.0, 40.0), voltages=(30.0, 45.0, 60.0, 75.0)):
    """A dataset as `pdssjax.sweep` gives it, over voltage and frequency."""
    volts, hertz = np.meshgrid(voltages, frequencies, indexing="ij")
    step = 1e-7 * np.maximum(volts - 20.0, 0.0)
    dims = ["drive_voltage", "drive_frequency"]
    told = lambda values, unit, name: (dims, values, {"units": unit, "long_name": name})
    used = {"effector.mass": {"value": 0.086, "unit": "kg", "source": "value in the study"}}
    return xarray.Dataset(
        {
            "net_step": told(step, "m", "net step of a cycle"),
            "speed": told(step * hertz, "m/s", "average speed"),
            "efficiency": told(step / (1e-7 * volts), "1", "step efficiency (3.1)"),
            "failure": (dims, np.zeros(step.shape, np.int8), {"long_name": "why a point has no value"}),
        },
        {
            "drive_voltage": ("drive_voltage", list(voltages), {"units": "V", "long_name": "drive.voltage"}),
            "drive_frequency": ("drive_frequency", list(frequencies), {"units": "Hz", "long_name": "drive.frequency"}),
        },
        {"record": "walk", "title": "Walking rig", "parameters": json.dumps(used), "drive.direction": 1.0},
    )


def write_made_sweep(folder):
    """The results of a sweep; the folder."""
    folder.mkdir()
    made_sweep().to_netcdf(folder / "sweep.nc", engine="scipy")
    return folder
