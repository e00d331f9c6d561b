"""Texts of columns as files of instruments have them, and what `pdssjax new` makes of them."""

import functools
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

from pdssjax import load_study
from pdssjax.cli import main as cli
from pdssjax.files import Hints, RigOptions, guess_file
from pdssjax.files.new_study import study_text
from pdssjax.metrics import Waveform, detect_waveform

NOTHING, UNTOLD = MappingProxyType({}), RigOptions()


@functools.cache
def _detected(time: bytes, volts: bytes) -> Waveform:
    return detect_waveform(np.frombuffer(time), np.frombuffer(volts))


@pytest.fixture
def detected_once(monkeypatch):
    """Look for the waveform of the same samples once for all tests: most of the time of `pdssjax new` goes there."""
    found = lambda time, volts: _detected(*(np.asarray(samples, float).tobytes() for samples in (time, volts)))
    for module in ("files.channel_roles", "metrics.record_guess"):
        monkeypatch.setattr(f"pdssjax.{module}.detect_waveform", found)


def text_of(header, *columns, form=".6f"):
    rows = zip(*columns, strict=True)
    return header + "\n" + "".join(",".join(f"{cell:{form}}" for cell in row) + "\n" for row in rows)


def walk_of(volts_per_um, gain=1e-7):
    """A sawtooth of 60 V, 20 Hz, and an end-effector that sticks on its slow flanks, as a sensor in volts shows it."""
    time = 1e-4 * np.arange(6000)
    turn = 20.0 * time
    volts = 60.0 * np.mod(turn, 1.0)
    moved = 1e6 * gain * (volts + 20.0 * np.floor(turn))
    return time, volts, volts_per_um * moved


def guessed(folder, text, columns=NOTHING, units=NOTHING, scales=NOTHING, rig=UNTOLD, **options):
    """What the `text` of a file suggests for a record, as the options say how to read it; a path is read as it is."""
    file = text if isinstance(text, Path) else folder / "run.csv"
    if file is not text:
        file.write_text(text)
    return guess_file(file, Hints(columns, units, scales), rig, **options)


def study_of(folder, *found, rig=UNTOLD):
    """The text of the study of records that were `found`, and what it is loaded as."""
    text = study_text(found, rig, folder, "found")
    (folder / "study.toml").write_text(text, encoding="utf-8")
    return text, load_study(folder / "study.toml")


def study_by_command(folder, text, *options):
    """The same of `pdssjax new` with the `text` of a file."""
    (folder / "run.csv").write_text(text)
    assert cli.main(["new", str(folder / "rig"), "--files", str(folder / "run.csv"), *options]) == 0
    study = folder / "rig" / "study.toml"
    return study.read_text(), load_study(study)
