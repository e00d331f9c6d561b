"""Progress in a notebook is a bar of plain HTML in one place, and figures are drawn; outside there is neither."""

import sys
import types

import pytest

from pdssjax.core import clear_bar, draw_in_notebook, notebook_counter, notebook_progress


class Handle:
    def __init__(self, shown):
        self.shown = shown

    def update(self, what):
        self.shown.append(what)


@pytest.fixture
def shown(monkeypatch):
    """All that a stand-in for IPython was asked to show; the first is the place."""
    seen = []
    module = types.ModuleType("IPython")
    module.get_ipython = lambda: types.SimpleNamespace(kernel=object())
    module.display = types.SimpleNamespace(display=lambda what, display_id: seen.append(what) or Handle(seen))
    monkeypatch.setitem(sys.modules, "IPython", module)
    return seen


def test_outside_a_notebook_there_is_no_bar(monkeypatch):
    monkeypatch.delitem(sys.modules, "IPython", raising=False)
    assert notebook_progress() is None and notebook_counter("points") is None


def test_in_a_terminal_of_ipython_there_is_none_either(shown, monkeypatch):
    monkeypatch.setattr(sys.modules["IPython"], "get_ipython", lambda: types.SimpleNamespace())
    assert notebook_progress() is None


def test_points_fill_a_bar(shown):
    tell = notebook_counter("points")
    assert not shown
    tell(5, 20)
    tell(20, 20)
    assert len(shown) == 3
    assert 'value="0.2500"' in shown[1]._repr_html_() and repr(shown[1]) == "5 of 20 points"
    assert 'value="1.0000"' in shown[2]._repr_html_()


def test_a_line_that_counts_fills_the_bar_and_another_leaves_it_open(shown):
    tell = notebook_progress()
    tell("bootstrap: 10 of 40 replicates")
    tell("joint: chi-square < 7")
    assert 'value="0.2500"' in shown[1]._repr_html_()
    assert "value=" not in shown[2]._repr_html_() and "chi-square &lt; 7" in shown[2]._repr_html_()


def test_the_bar_is_taken_away_at_the_end_if_it_was_shown(shown):
    tell = notebook_progress()
    tell.clear()
    assert not shown
    tell("finding starts")
    clear_bar(print)
    assert len(shown) == 2
    clear_bar(tell)
    assert shown[-1]._repr_html_() == "" and repr(shown[-1]) == ""


@pytest.mark.parametrize("known", [{}, {Handle: str}])
def test_figures_are_drawn_where_the_notebook_does_not_yet(shown, monkeypatch, known):
    formatters = {"image/png": types.SimpleNamespace(type_printers=known)}
    shell = types.SimpleNamespace(kernel=object(), display_formatter=types.SimpleNamespace(formatters=formatters))
    sys.modules["IPython"].get_ipython = lambda: shell
    tools, asked = types.ModuleType("IPython.core.pylabtools"), []
    tools.select_figure_formats = lambda *what: asked.append(what)
    monkeypatch.setitem(sys.modules, "IPython.core.pylabtools", tools)
    draw_in_notebook(Handle)
    assert asked == ([] if known else [(shell, {"png"})])
