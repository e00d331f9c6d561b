"""Parts of the page, without a browser."""

import pytest
from walking_study import write_walking

from pdssjax import load_study

pn = pytest.importorskip("panel")
from pdssjax.explore.knobs import parameter_knobs  # noqa: E402  (needs Panel)
from pdssjax.explore.widgets.control_column import ControlRow  # noqa: E402  (needs Panel)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return load_study(write_walking(tmp_path_factory.mktemp("rig")))


def test_a_slider_that_is_turned_ends_the_complaint_about_its_field(study):
    said, knob = [], next(k for k in parameter_knobs(study) if k.path == "effector.mass")
    row = ControlRow(knob, 0.086, lambda path, number: None, said.append)
    slider, field = (next(p for p in row.view if name in p.css_classes) for name in ("slider", "field"))
    field.value = "heavy"
    assert 'found "heavy"' in said[-1]
    slider.value += 10
    assert said[-1] == ""
