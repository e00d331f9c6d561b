"""Tables of reports: columns that line up."""

import pytest

from pdssjax.report.text._layout import aligned_table, heading


def test_columns_line_up_on_the_side_asked_for():
    text = aligned_table("<>", [["", "value"], ["piezo.gain", "1.5"], ["load", "-12.25"]])
    assert text == "                 value\n    piezo.gain     1.5\n    load        -12.25\n"


def test_cells_end_and_begin_at_one_place_whatever_they_hold():
    rows = [["a", "b", "c"], ["long name", "1", "x"], ["µm", "22.75", ""]]
    lines = aligned_table("<><", rows).splitlines()
    # Of a left column the begins, of a right one the ends.
    assert {line.index(row[0]) for line, row in zip(lines, rows, strict=True)} == {4}
    assert {line.index(row[1]) + len(row[1]) for line, row in zip(lines, rows, strict=True)} == {4 + 9 + 2 + 5}
    assert {lines[0].index("c"), lines[1].index("x")} == {4 + 9 + 2 + 5 + 2}


def test_no_line_ends_in_blanks():
    assert aligned_table("<<", [["a", ""], ["", ""]]) == "    a\n\n"


@pytest.mark.parametrize("rows", [[["a", "b"], ["c"]], [["a"], ["b"]]])
def test_rows_of_other_lengths_are_refused(rows):
    with pytest.raises(ValueError, match="zip"):
        aligned_table("<>", rows)


def test_a_heading_stands_by_itself():
    assert heading("Records") == "[[Records]]\n"
