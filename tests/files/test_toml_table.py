"""Tables of a study file: each value is checked where it is read, and the message names the place."""

import pytest

from pdssjax import InputError
from pdssjax.core import Quantity
from pdssjax.files.toml_table import Table

TABLE = Table(
    {"name": "run", "empty": "", "count": 3, "length": "2 mm", "flag": True, "inner": {"x": 1}}, "study.toml: record 1"
)
POSITIVE = Quantity(1.0, "m", True, 0.0, 1.0, False)


def test_values_come_as_they_are_asked_for():
    assert TABLE.text("name", "a name") == "run"
    assert TABLE.option("name", ["walk", "run"]) == "run"
    assert TABLE.get("flag", bool, "true or false") is True
    assert TABLE.number("length", "m") == 2e-3
    assert TABLE.number("count", "") == 3.0
    assert TABLE.quantity("length", POSITIVE) == 2e-3
    inner = TABLE.table("inner", "a table")
    assert (inner.entries, inner.where) == ({"x": 1}, "study.toml: record 1: inner")


def test_what_is_left_out_has_its_default_none_included():
    assert TABLE.text("title", "a text", "none") == "none"
    assert TABLE.option("kind", ["a", "b"], "b") == "b"
    assert TABLE.number("start", "s", 0.5) == 0.5
    assert TABLE.number("offset", "m", None) is None
    assert TABLE.table("units", "a table", {}).entries == {}
    assert TABLE.get("exclude", list, "a list", []) == []


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        (lambda t: t.text("title", "a text"), 'study.toml: record 1: the key "title" is missing, expected a text.'),
        (lambda t: t.text("count", "a text"), 'study.toml: record 1: key "count": found 3, expected a text.'),
        (lambda t: t.text("empty", "a text"), 'study.toml: record 1: key "empty": found an empty text, expected'),
        (lambda t: t.text("inner", "a text"), 'study.toml: record 1: key "inner": found a table, expected a text.'),
        (lambda t: t.option("name", ["walks", "runs"]), 'key "name": found "run"; did you mean "runs"?'),
        (lambda t: t.number("name", "m"), 'study.toml: record 1: key "name": found "run", expected'),
        (lambda t: t.number("length", "s"), 'study.toml: record 1: key "length": found'),
        (lambda t: t.number("flag", ""), 'study.toml: record 1: key "flag": found True, expected a pure number'),
        (lambda t: t.quantity("count", POSITIVE), 'key "count": found 3 m, expected a value above 0 m and below 1 m.'),
        (lambda t: t.table("name", "a table"), 'study.toml: record 1: key "name": found "run", expected a table.'),
        (
            lambda t: t.only(["nane", "count"]),
            'study.toml: record 1: found the unknown key "name"; did you mean "nane"?',
        ),
    ],
)
def test_what_is_wrong_is_said_with_its_place(ask, said):
    with pytest.raises(InputError) as refused:
        ask(TABLE)
    assert str(refused.value).startswith(said) or said in str(refused.value)
