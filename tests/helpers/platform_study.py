"""A study of a platform alone, known in closed form and quick to compile; its record is made with noise."""

import math

import numpy as np

GAIN, RATE, DAMPING, ZERO, NOISE = 1.1e-7, 6000.0, 0.2, 0.3e-6, 1e-8

PLATFORM = """\
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

[[record]]
name = "step"
file = "step.csv"
columns = { time = "time_s", displacement = "displacement_um" }
measures = "platform"
noise = "0.01 um"
drive = { waveform = "step", voltage = "50 V" }
"""


def write_platform(folder, text=PLATFORM):
    """The study and its record, with noise; the study's path."""
    time = np.arange(-0.005, 0.035, 5e-5)
    ring = RATE * math.sqrt(1.0 - DAMPING**2)
    elapsed = np.maximum(time, 0.0)
    fade = np.exp(-DAMPING * RATE * elapsed) * (np.cos(ring * elapsed) + DAMPING * RATE / ring * np.sin(ring * elapsed))
    motion = 50.0 * GAIN * (1.0 - fade) + ZERO + np.random.default_rng(3).normal(0.0, NOISE, time.size)
    rows = np.stack([time, 1e6 * motion], axis=1)
    np.savetxt(folder / "step.csv", rows, "%.7f", ",", header="time_s,displacement_um", comments="")
    (folder / "study.toml").write_text(text)
    return folder / "study.toml"
