"""Parts of the page without a browser: pale plots, another record, the field of a slider."""

import dataclasses
import re
from types import SimpleNamespace

import fabricated
import platform_study
import pytest
from walking_study import write_walking

from pdssjax import InputError, load_study
from pdssjax.explore import Workbench, instants_of, settings_of
from pdssjax.explore.settings import parameter_knobs
from pdssjax.explore.workbench import FitResult

pn = pytest.importorskip("panel")
from pdssjax.explore.widgets import control_column, page  # noqa: E402  (needs Panel)
from pdssjax.explore.widgets.control_column import ControlRow  # noqa: E402  (needs Panel)
from pdssjax.explore.widgets.estimate_tab import EstimateTab  # noqa: E402  (needs Panel)


class AtOnce:
    """In place of the thread of a page: what is to be done later is done now, what is idle never, and jobs are kept."""

    def __init__(self):
        self.begun = []

    def later(self, act):
        act()

    def after(self, milliseconds, act):
        pass

    def start(self, *job):
        self.begun.append(job)
        return SimpleNamespace(is_running=False)


def marked(view, name):
    return list(view.select(lambda part: name in getattr(part, "css_classes", [])))


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """That of a platform alone."""
    text = platform_study.PLATFORM.replace(" = {}", " = { start = 0.5 }")
    study = load_study(platform_study.write_platform(tmp_path_factory.mktemp("rig"), text))
    return Workbench(study, settings_of(study))


def test_plots_are_pale_while_a_record_is_computed_for_other_numbers(bench, monkeypatch):
    bench.warm()
    thread = AtOnce()
    view = page.Page(bench, thread).view
    places, (field,) = marked(view, "plots"), marked(view, "field-piezo-gain")
    assert [place.styles["opacity"] for place in places] == ["1", "1"]
    monkeypatch.setattr(bench.records, "redraw_at_once", lambda *given: None)  # as where more room is needed
    field.value = "0.11"
    assert len(thread.begun) == 1
    assert [place.styles["opacity"] for place in places] == ["0.3", "0.3"]
    monkeypatch.undo()
    field.value = "0.12"
    assert [place.styles["opacity"] for place in places] == ["1", "1"]


class Later(AtOnce):
    """What is to be done later is kept."""

    def __init__(self):
        super().__init__()
        self.kept = []

    def later(self, act):
        self.kept.append(act)


def test_another_record_is_announced_before_it_is_drawn_and_of_several_the_last_is(tmp_path, monkeypatch):
    study = load_study(write_walking(tmp_path))
    bench, later, made, tab = Workbench(study, settings_of(study)), Later(), [], page.RecordTab
    # Nothing is computed.
    monkeypatch.setattr(bench.records, "redraw_at_once", lambda *given: None)
    view = page.Page(bench, later).view
    (select,), (headline,), places = (marked(view, name) for name in ("record", "headline", "plots"))
    for place in places:
        place.styles = {"opacity": "1"}
    monkeypatch.setattr(page, "RecordTab", lambda record, *more: made.append(record.name) or tab(record, *more))
    for name in ("step", "walk", "step"):
        select.value = name
    assert headline.object == "drawing step; the pale plots are of walk"
    assert [place.styles["opacity"] for place in places] == ["0.3", "0.3"]
    assert made == []
    for act in later.kept:
        act()
    assert set(made) == {"step"}


def test_a_slider_that_is_moved_ends_the_complaint_about_its_field(tmp_path):
    study = load_study(write_walking(tmp_path))
    said, knob = [], next(k for k in parameter_knobs(study) if k.path == "effector.mass")
    row = ControlRow(knob, 0.086, lambda path, number: None, said.append)
    slider, field = (next(p for p in row.view if name in p.css_classes) for name in ("slider", "field"))
    field.value = "heavy"
    assert 'found "heavy"' in said[-1]
    slider.value += 10
    assert said[-1] == ""


def test_a_simulation_that_fails_says_why_below_the_sliders_until_a_number_is_changed(bench, monkeypatch):
    record = bench.study.records[0]
    view = page.Page(bench, AtOnce()).view
    (headline,), (line,), (field,) = (marked(view, name) for name in ("headline", "said", "field-piezo-gain"))
    failed = bench.records.redraw(record.name, bench.initial, instants_of(record, 0.0, 0.1))
    monkeypatch.setattr(
        bench.records, "redraw_at_once", lambda *given: failed._replace(message="the motion did not stay finite")
    )
    field.value = "0.11"
    assert "the simulation fails" in headline.object
    assert line.object == "the motion did not stay finite"
    monkeypatch.setattr(bench.records, "redraw_at_once", lambda *given: failed)
    field.value = "0.12"
    assert "chi-square" in headline.object
    assert line.object == ""


def test_what_could_not_be_compiled_is_told_of_the_numbers_of_the_sliders_alone(bench, monkeypatch):
    thread = AtOnce()
    monkeypatch.setattr(bench.records, "redraw_at_once", lambda *given: None)  # as where something is to be compiled
    view = page.Page(bench, thread).view
    (line,), (field,) = marked(view, "said"), marked(view, "field-piezo-gain")
    ended = [on_end for _, on_end in thread.begun]
    field.value = "0.11"
    ended[0](None, InputError("of the numbers before"))
    assert line.object == ""
    thread.begun[-1][1](None, InputError("of these numbers"))
    assert line.object == "of these numbers"


class Working(AtOnce):
    """Jobs are done at once."""

    def start(self, work, on_end, on_line=lambda line: None):
        on_end(work(on_line), None)
        return SimpleNamespace(is_running=False)


def test_a_fit_that_ends_moves_the_sliders_to_its_estimate(bench, monkeypatch):
    estimate = fabricated.estimate()
    view = page.Page(bench, Working()).view
    ended = FitResult(estimate, "The fit converged in 1 s.")
    monkeypatch.setattr(control_column, "fit_from_here", lambda study, settings, report: report("fits") or ended)
    (fit,), (line,), (field,), (told,) = (marked(view, n) for n in ("fit", "fit-said", "field-piezo-gain", "estimate"))
    fit.clicks += 1
    assert line.object == "The fit converged in 1 s."
    assert float(field.value) == pytest.approx(1e6 * estimate.parameters["piezo.gain"].value, rel=1e-5)
    assert estimate.title in told.object
    assert not fit.disabled


def test_a_fit_is_cancelled_and_another_can_begin(bench):
    asked, ends, thread = [], [], AtOnce()

    def start(work, on_end, on_line):
        ends.append(on_end)
        return SimpleNamespace(is_running=True, cancel=lambda: asked.append("cancel"))

    thread.start = start
    view = page.Page(bench, thread).view
    (fit,), (cancel,), (line,) = (marked(view, name) for name in ("fit", "cancel", "fit-said"))
    ends.clear()
    fit.clicks += 1
    assert fit.disabled and not cancel.disabled
    cancel.clicks += 1
    assert asked == ["cancel"] and cancel.disabled and line.object.startswith("Cancelling")
    ends[0](FitResult(None, "The fit was cancelled."), None)
    assert (fit.disabled, cancel.disabled, line.object) == (False, True, "The fit was cancelled.")


def table_of(estimate):
    """What the tab shows of an estimate: its text, and the cells of its rows."""
    tab = EstimateTab()
    tab.show(estimate)
    rows = re.findall(r"<tr>(.*?)</tr>", tab._text.object)
    cells = [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in rows[1:]]
    return tab, {row[0]: row[1:] for row in cells}


def test_values_of_an_estimate_stand_in_the_unit_shown_with_digits_that_their_errors_allow():
    _, rows = table_of(fabricated.estimate())
    assert rows["piezo.gain"][:4] == ["µm/V", "0.1007020", "0.0000070 (0.00695 %)", "0.1006880 to 0.1007160"]
    assert rows["effector.mass"] == ["g", "86", "", "", "", "fixed"]
    assert rows["effector.load"][-1] == "no information"
    assert rows["drive.fall_time"][-1].startswith("at bound")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({}, "converged; chi-square a degree of freedom 0.9987"),
        ({"converged": False}, "DID NOT CONVERGE"),
        ({"explained": False}, "BUT DOES NOT EXPLAIN ITS RECORDS"),
    ],
)
def test_the_headline_of_an_estimate_says_whether_it_converged(changes, said):
    assert said in table_of(dataclasses.replace(fabricated.estimate(), **changes))[0]._text.object


def test_correlations_profiles_and_advice_are_shown_where_there_are_any():
    made = fabricated.estimate()
    plain, _ = table_of(made)
    assert len(plain._plots.objects) == 1 and "Errors to believe" not in plain._text.object
    profiles = fabricated.profiles(made.parameters)
    assert len(table_of(dataclasses.replace(made, profiles=profiles))[0]._plots.objects) == 1 + len(profiles)
    advised, _ = table_of(fabricated.with_errors(made))
    assert "<p>Errors to believe: with-misfit. Believe" in advised._text.object
