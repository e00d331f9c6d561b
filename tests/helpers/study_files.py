"""Writes a small legal study with its records, for tests to load or to spoil."""

import json
import math
from collections.abc import Mapping
from pathlib import Path

import pytest
from record_tables import sawtooth_table, step_table

from pdssjax import InputError, load_study

_HEAD = """\
format = "pdssjax-study/1"
title = "Small rig"

[actuator]
piezo = "second-order"
friction = "simplified-lugre"
feedback = false

[parameters]
"effector.mass" = { value = "86 g" }
"piezo.gain" = { start = "0.1 um/V", min = "0.05 um/V", max = 2e-7 }
"piezo.natural_frequency" = {}
"piezo.damping_ratio" = { start = "20 %" }
"friction.sigma0" = {}
"friction.sigma1" = {}
"friction.f_ss" = {}
"drive.fall_time" = { value = "1 ms" }
"""
STUDY = "\n".join(
    [
        _HEAD,
        step_table('noise = "0.01 um"', voltage="48.2 V"),
        sawtooth_table(
            'role = "validate"', 'offset = "2 um"', direction="backward", voltage="64.2 V", frequency="5 Hz"
        ),
    ]
)


def csv(interval: float, samples: int) -> str:
    """A CSV file with two columns, `samples` times `interval` [s] apart, and a motion."""
    rows = [f"{k * interval:.6f},{math.sin(k):.4f}\n" for k in range(samples)]
    return "time_s,displacement_um\n" + "".join(rows)


def write_study(folder: Path, study: str = STUDY, step: str = csv(5e-5, 40), walk: str = csv(1e-3, 400)) -> Path:
    """Writes the texts of the study and its two records to `folder`; the study's path."""
    (folder / "step.csv").write_text(step)
    (folder / "walk.csv").write_text(walk)
    path = folder / "study.toml"
    path.write_text(study)
    return path


def check_refused(path: Path, *essentials: str) -> None:
    """The study at `path` is refused in two lines at most, which name its folder and contain the `essentials`."""
    with pytest.raises(InputError) as caught:
        load_study(path)
    message = str(caught.value)
    assert message.count("\n") <= 1
    for essential in [str(path.parent), *essentials]:
        assert essential in message


def write_estimate(folder: Path, values: Mapping[str, float], **more: object) -> Path:
    """Writes an `estimate.json` with the `values` of parameters, and `more` keys; its path."""
    parameters = {path: {"value": value} for path, value in values.items()}
    file = folder / "estimate.json"
    file.write_text(json.dumps({"format": "pdssjax-estimate/1", "parameters": parameters} | more))
    return file


def changed(old: str, new: str, text: str = STUDY) -> str:
    """`text` with its first `old` replaced, which must be there."""
    assert old in text
    return text.replace(old, new, 1)
