"""The [[record]] tables of study files, as text, and the files of their columns."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

import pdssjax

COLUMNS = {"time": "time_s", "displacement": "displacement_um"}
SHORT = {"time": "time_s", "displacement": "y_um"}
"""Columns of a displacement, by quantity."""


def write_columns(file: Path, header: str, *columns: np.ndarray, digits: str = "%.7f") -> None:
    """A CSV file of `columns` under a `header`."""
    np.savetxt(file, np.column_stack(columns), digits, ",", header=header, comments="")


def loaded(folder: Path, text: str) -> pdssjax.Study:
    """The study of a `text`, written to the folder."""
    (folder / "study.toml").write_text(text)
    return pdssjax.load_study(folder / "study.toml")


def record_table(name: str, measures: str, *lines: str, columns: Mapping[str, str] = COLUMNS) -> str:
    """A record whose file has its name; `lines` follow what it `measures`, its drive among them."""
    named = ", ".join(f'{quantity} = "{column}"' for quantity, column in columns.items())
    head = ["[[record]]", f'name = "{name}"', f'file = "{name}.csv"', f"columns = {{ {named} }}"]
    return "\n".join([*head, f'measures = "{measures}"', *lines]) + "\n"


def step_table(*lines: str, name: str = "step", voltage: str = "50 V", columns: Mapping[str, str] = COLUMNS) -> str:
    """The platform under a step; `lines` stand before its drive."""
    drive = f'drive = {{ waveform = "step", voltage = "{voltage}" }}'
    return record_table(name, "platform", *lines, drive, columns=columns)


def sawtooth_table(
    *lines: str,
    name: str = "walk",
    direction: str = "forward",
    voltage: str = "60 V",
    frequency: str = "20 Hz",
    columns: Mapping[str, str] = COLUMNS,
) -> str:
    """The end-effector under a sawtooth; `lines` stand before its drive."""
    numbers = f'direction = "{direction}", voltage = "{voltage}", frequency = "{frequency}"'
    drive = f'drive = {{ waveform = "sawtooth", {numbers} }}'
    return record_table(name, "effector", *lines, drive, columns=columns)


STEP_HEAD = """\
format = "pdssjax-study/1"
[actuator]
piezo = "second-order"
friction = "coulomb"
[parameters]
"piezo.gain" = {}
"piezo.natural_frequency" = {}
"piezo.damping_ratio" = {}
"""
"""Of a study whose records are steps of the platform alone."""
