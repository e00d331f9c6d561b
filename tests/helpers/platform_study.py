"""A study of a platform alone, known in closed form and quick to compile; its record is made with noise."""

import fabricated
import numpy as np
from record_tables import step_table, write_columns

GAIN, RATE, DAMPING, ZERO, NOISE = 1.1e-7, 6000.0, 0.2, 0.3e-6, 1e-8
NOISE_LINE = 'noise = "0.01 um"'
_HEAD = """\
format = "pdssjax-study/1"
title = "Platform alone"

[actuator]
piezo = "second-order"
friction = "simplified-lugre"

[parameters]
"piezo.gain" = {}
"piezo.natural_frequency" = {}
"piezo.damping_ratio" = {}
"friction.sigma0" = {}
"friction.sigma1" = { value = 45 }
"friction.f_ss" = { value = 0.65 }
"""
PLATFORM = "\n".join([_HEAD, step_table(NOISE_LINE)])


def write_platform(folder, text=PLATFORM):
    """The study and its record, with noise; the study's path."""
    time = np.arange(-0.005, 0.035, 5e-5)
    response = fabricated.step_motion(time, 50.0 * GAIN, RATE, DAMPING)
    motion = response + ZERO + np.random.default_rng(3).normal(0.0, NOISE, time.size)
    write_columns(folder / "step.csv", "time_s,displacement_um", time, 1e6 * motion)
    (folder / "study.toml").write_text(text)
    return folder / "study.toml"
