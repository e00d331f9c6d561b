"""A planned rig whose records are of all four kinds: as text for a study file, whole or in part."""

import re
from collections.abc import Sequence

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

_WALK = """
[[record]]
name = "{direction}"
file = "{direction}.csv"
columns = {{ time = "time_s", displacement = "x_um" }}
measures = "effector"
noise = "0.01 um"
sampling = {{ end = "{end} s", interval = "0.5 ms" }}
drive = {{ waveform = "sawtooth", direction = "{direction}", voltage = "60 V", frequency = "20 Hz" }}
"""

RECORDS = {
    "step": """
[[record]]
name = "step"
file = "step.csv"
columns = { time = "time_ms", displacement = "y_um" }
measures = "platform"
noise = "0.01 um"
sampling = { start = "-1 ms", end = "20 ms", interval = "50 us" }
drive = { waveform = "step", voltage = "60 V" }
""",
    "forward": _WALK.format(direction="forward", end="{end}"),
    "backward": _WALK.format(direction="backward", end="{end}"),
    "loops": """
[[record]]
name = "loops"
file = "loops.csv"
columns = { time = "time_s", motion = "d_um", force = "f_mN" }
measures = "friction"
noise = "5 mN"
sampling = { end = "1.5 s", interval = "5 ms", amplitude = "3 um", frequency = "1 Hz" }
""",
    "blocked": """
[[record]]
name = "blocked"
file = "blocked.csv"
columns = { time = "time_s", force = "f_mN" }
measures = "force"
noise = "2 mN"
sampling = { end = "0.4 s", interval = "0.5 ms" }
drive = { waveform = "sawtooth", direction = "forward", voltage = "60 V", frequency = "20 Hz" }
""",
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
