"""A planned rig whose records are of all four kinds: as text for a study file, whole or in part."""

import re
from collections.abc import Sequence

from record_tables import record_table, sawtooth_table, step_table

LAWS = {
    "simplified-lugre": {"sigma0": "1 N/um", "sigma1": "45 N s/m", "f_ss": "0.65 N"},
    "lugre": {"sigma0": "1 N/um", "sigma1": "45 N s/m", "f_c": "0.55 N", "f_s": "0.65 N", "v_s": "1 mm/s"},
}
"""Each law with its parameters as they truly are."""
_HEAD = """\
format = "pdssjax-study/1"
title = "Four kinds of records"
[actuator]
piezo = "second-order"
friction = "{law}"
[parameters]
"effector.mass" = {{ value = "86 g" }}
"piezo.gain" = {{ start = "0.1 um/V" }}
"piezo.natural_frequency" = {{ start = "6700 rad/s" }}
"piezo.damping_ratio" = {{ start = 0.18 }}
{contact}
"stop.stiffness" = {{ start = "0.03 N/um" }}
"stop.dissipation" = {{ value = "10 s/m" }}
{more}
"""
_NOISE = 'noise = "0.01 um"'
_SAWTOOTH = 'drive = { waveform = "sawtooth", direction = "forward", voltage = "60 V", frequency = "20 Hz" }'


def _walk(direction: str) -> str:
    sampling = 'sampling = { end = "{end} s", interval = "0.5 ms" }'
    columns = {"time": "time_s", "displacement": "x_um"}
    return "\n" + sawtooth_table(_NOISE, sampling, name=direction, direction=direction, columns=columns)


RECORDS = {
    "step": "\n"
    + step_table(
        _NOISE,
        'sampling = { start = "-1 ms", end = "20 ms", interval = "50 us" }',
        voltage="60 V",
        columns={"time": "time_ms", "displacement": "y_um"},
    ),
    "forward": _walk("forward"),
    "backward": _walk("backward"),
    "loops": "\n"
    + record_table(
        "loops",
        "friction",
        'noise = "5 mN"',
        'sampling = { end = "1.5 s", interval = "5 ms", amplitude = "3 um", frequency = "1 Hz" }',
        columns={"time": "time_s", "motion": "d_um", "force": "f_mN"},
    ),
    "blocked": "\n"
    + record_table(
        "blocked",
        "force",
        'noise = "2 mN"',
        'sampling = { end = "0.4 s", interval = "0.5 ms" }',
        _SAWTOOTH,
        columns={"time": "time_s", "force": "f_mN"},
    ),
}
"""One of the platform, two walks of the end-effector, the contact alone, and a walk against a force sensor."""


def plan(law: str = "simplified-lugre", records: Sequence[str] = tuple(RECORDS), more: str = "") -> str:
    """The text of a study with these `records`, its starts the truth; `more` lines of parameters."""
    contact = "\n".join(f'"friction.{name}" = {{ start = "{value}" }}' for name, value in LAWS[law].items())
    chosen = "".join(RECORDS[name].replace("{end}", "0.2") for name in records)
    return _HEAD.format(law=law, contact=contact, more=more) + chosen


def startless(text: str) -> str:
    """The text of a study with its parameters free and without starts."""
    return re.sub(r"\{ start = [^}]*\}", "{}", text.split("[[record]]")[0]) + text[text.index("[[record]]") :]
