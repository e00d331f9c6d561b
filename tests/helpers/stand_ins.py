"""Stands in for the study and the fit behind the command line, and for the drawing of figures."""

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import fabricated
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.layout_engine import ConstrainedLayoutEngine

import pdssjax
import pdssjax.inference
from pdssjax import InputError


@pytest.fixture
def undrawn(monkeypatch) -> None:
    """Make pictures files that only begin as such: drawing takes longer than all else that is written."""
    drawn = FigureCanvasAgg.print_png

    def save(canvas, file, **how):
        if isinstance(file, Path):
            file.write_bytes(b"\x89PNG")
        else:  # within a page
            drawn(canvas, file, **how)

    monkeypatch.setattr(ConstrainedLayoutEngine, "execute", lambda layout, figure: None)
    monkeypatch.setattr(FigureCanvasAgg, "print_png", save)


@pytest.fixture
def calls(monkeypatch, undrawn) -> SimpleNamespace:
    """Notes what was asked and returns a made-up estimate; without pictures."""
    noted = SimpleNamespace(studies=[], methods=[], drawings=[], converged=True, explained=True)
    noted.study, noted.peaks = SimpleNamespace(parameters={}), False

    def load_study(path, virtual=False):
        noted.studies.append(path)
        return noted.study

    def identify(study, method, intervals, loss, progress, executor=None, drawing=None):
        assert study is noted.study
        progress(f"[1/2] {method}")
        noted.methods.append(method)
        noted.drawings.append(drawing)
        whole = fabricated.estimate(method, noted.converged)
        return dataclasses.replace(whole, records=whole.records[:1], explained=noted.explained)

    def pick_peaks(study):
        if not noted.peaks:
            raise InputError("rig.toml: found no step, expected one.")

    # Set past the module's own look-up, which would load the real ones first.
    monkeypatch.setitem(vars(pdssjax), "load_study", load_study)
    monkeypatch.setitem(vars(pdssjax), "identify", identify)
    monkeypatch.setitem(vars(pdssjax.inference), "pick_peaks", pick_peaks)
    monkeypatch.setitem(vars(pdssjax.inference), "check_method", lambda study, method: None)
    return noted
