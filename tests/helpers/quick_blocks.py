"""Blocks of a sweep that take no simulation: for what is asked of stores and executors."""

import json

import numpy as np
import pytest

import pdssjax
from pdssjax.files import EXAMPLE
from pdssjax.sweeps import execution


def example_study():
    """The packaged example with its true values."""
    truth = json.loads((EXAMPLE / "truth.json").read_text())["parameters"]
    study = pdssjax.load_study(EXAMPLE / "study.toml")
    return study.with_values({path: truth[path]["value"] for path in study.parameters})


def found_at(points):
    """In place of what a simulation would find: numbers that tell the points apart."""
    return np.column_stack(
        [*(np.sin(points @ np.arange(1.0, points.shape[1] + 1) + k) for k in range(5)), points[:, 0] < 0]
    )


@pytest.fixture
def quick(monkeypatch):
    """Sweeps find `found_at` their points; the list says which points each block had, in order."""
    blocks = []

    def computed_block(function, points):
        blocks.append(points)
        return found_at(points)

    monkeypatch.setattr(execution, "computed_block", computed_block)
    return blocks
