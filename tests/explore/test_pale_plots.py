"""Plots of numbers that the sliders have left are pale until the new ones are there."""

from types import SimpleNamespace

import platform_study
import pytest

from pdssjax import load_study
from pdssjax.explore import Workbench, settings_of

pn = pytest.importorskip("panel")
from pdssjax.explore.widgets import page  # noqa: E402  (needs Panel)


class AtOnce:
    """In place of the document of a browser: what is to be done later is done now, and what is idle never."""

    def add_next_tick_callback(self, act):
        act()

    def add_timeout_callback(self, act, milliseconds):
        pass


def marked(view, name):
    return list(view.select(lambda part: name in getattr(part, "css_classes", [])))


@pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")  # of Panel 2, not ours yet
def test_plots_are_pale_while_a_record_is_computed_for_other_numbers(tmp_path, monkeypatch):
    text = platform_study.PLATFORM.replace(" = {}", " = { start = 0.5 }")
    study = load_study(platform_study.write_platform(tmp_path, text))
    bench = Workbench(study, settings_of(study))
    bench.warm()
    view = page.Page(bench, AtOnce()).view
    places, (field,) = marked(view, "plots"), marked(view, "field-piezo-gain")
    assert [place.styles["opacity"] for place in places] == ["1", "1"]
    begun = []
    monkeypatch.setattr(page, "BackgroundJob", lambda *work: begun.append(work) or SimpleNamespace(runs=False))
    monkeypatch.setattr(bench.records, "redraw_at_once", lambda *given: None)  # as where more room is needed
    field.value = "0.11"
    assert len(begun) == 1
    assert [place.styles["opacity"] for place in places] == ["0.3", "0.3"]
    monkeypatch.undo()
    field.value = "0.12"
    assert [place.styles["opacity"] for place in places] == ["1", "1"]
