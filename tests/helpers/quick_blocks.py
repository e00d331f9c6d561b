"""Blocks of a sweep that take no simulation: for what is asked of stores and executors."""

import json
import shutil

import numpy as np
import pytest

import pdssjax
from pdssjax.files import EXAMPLE
from pdssjax.sweeps import execution, plan_sweep

OVER = {"drive.voltage": np.linspace(20.0, 80.0, 20), "drive.frequency": np.linspace(2.0, 50.0, 20)}
"""400 points: seven blocks."""


def example_study():
    """The packaged example with its true values."""
    truth = json.loads((EXAMPLE / "truth.json").read_text())["parameters"]
    study = pdssjax.load_study(EXAMPLE / "study.toml")
    return study.with_values({path: truth[path]["value"] for path in study.parameters})


@pytest.fixture(scope="module")
def study():
    return example_study()


def written(folder, study):
    """The example's study with its true values, as a file."""
    shutil.copytree(EXAMPLE, folder / "study", dirs_exist_ok=True)
    file = folder / "study" / "study.toml"
    text = file.read_text()
    for path, parameter in study.parameters.items():
        line = next(line for line in text.splitlines() if line.startswith(f'"{path}"'))
        text = text.replace(line, f'"{path}" = {{ value = {parameter.value!r} }}')
    file.write_text(text)
    return file


def planned(study, over=OVER):
    """The job and the blocks of a sweep."""
    made = plan_sweep(study, over)
    return made.document, made.plan


def found_at(points):
    """In place of what a simulation would find: numbers that tell the points apart."""
    return np.column_stack(
        [*(np.sin(points @ np.arange(1.0, points.shape[1] + 1) + k) for k in range(5)), points[:, 0] < 0]
    )


@pytest.fixture
def quick(monkeypatch):
    """Sweeps find `found_at` their points; the list says which points each block had, in order."""
    blocks = []

    def compute_block(function, points):
        blocks.append(points)
        return found_at(points)

    monkeypatch.setattr(execution, "compute_block", compute_block)
    return blocks
