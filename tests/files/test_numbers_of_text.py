"""Numbers of texts: thousands that may be divided, words among samples, headers of symbols, what would never end."""

import numpy as np
import pytest

from pdssjax import InputError
from pdssjax.files.channel_samples import open_file
from pdssjax.files.record_columns import Layout, read_columns


def text_file(folder, *lines):
    file = folder / "run.csv"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


def column(file, number=1, decimal=""):
    """The numbers of a column."""
    return np.concatenate([block.values[:, 0] for block in open_file(file, decimal).blocks([number])])


@pytest.mark.parametrize(
    ("cells", "sign"),
    [
        (["12", "480", "-2.013", "-12.471"], ","),
        (["0", "1.000", "2.000", "999"], ","),
        (["+7", "", "8", "31.116", "9"], ","),
        (["12", "480", "2,013"], "."),
    ],
)
def test_a_column_of_whole_numbers_and_groups_of_three_is_asked_about(tmp_path, cells, sign):
    file = text_file(tmp_path, "n;x_nm", *(f"{1000 + k};{cell}" for k, cell in enumerate(cells)))
    group = next(k for k, cell in enumerate(cells) if len(cell) > 4)
    with pytest.raises(InputError) as caught:
        column(file, 2)
    message = str(caught.value)
    assert message.startswith(f'{file}: line {group + 2}, column "x_nm": found "{cells[group]}"')
    assert 'decimal = ","' in message and 'decimal = "."' in message and "\n" not in message
    np.testing.assert_array_equal(column(file, 1), 1000 + np.arange(len(cells)))
    thousands = [float(cell.replace(".", "").replace(",", "") or "nan") for cell in cells]
    np.testing.assert_array_equal(column(file, 2, sign), thousands)
    decimals = [float(cell.replace(",", ".") or "nan") for cell in cells]
    np.testing.assert_array_equal(column(file, 2, {",": ".", ".": ","}[sign]), decimals)


@pytest.mark.parametrize(
    "cells",
    [
        ["1.070", "2.110", "3.350"],  # three decimals throughout
        ["0", "0.125", "1.250"],  # no group of thousands begins with 0
        ["90", "1.07", "2.110"],
        ["90", "1.0705", "2.110"],
        ["90", "1.070", "2110"],  # thousands that nothing divides
        ["90", "1.070e3", "2.110"],
    ],
)
def test_decimals_that_show_themselves_are_read_as_before(tmp_path, cells):
    np.testing.assert_array_equal(column(text_file(tmp_path, "x_nm", *cells)), [float(cell) for cell in cells])


def test_what_divides_thousands_is_looked_for_across_blocks(tmp_path, monkeypatch):
    monkeypatch.setattr("pdssjax.files.readers.delimited_text.BLOCK", 50)
    file = text_file(tmp_path, "x_nm", *["17"] * 120, "1.204")
    with pytest.raises(InputError, match='line 122, column "x_nm"'):
        column(file)


@pytest.mark.parametrize(
    ("cells", "numbers"),
    [
        (['"90.5"', '"-1,070.25"', '"2,110,400.5"'], [90.5, -1070.25, 2110400.5]),
        (["90,5", "1.070,25", "2.110.400"], [90.5, 1070.25, 2110400.0]),
    ],
)
def test_thousands_beside_decimals_are_clear(tmp_path, cells, numbers):
    rows = [f"{0.5 * k};{cell}".replace(".", "," if "," in cells[0] else ".", 1) for k, cell in enumerate(cells)]
    np.testing.assert_array_equal(column(text_file(tmp_path, "t_s;x_nm", *rows), 2), numbers)


def test_one_number_with_what_may_divide_thousands_among_others_is_named(tmp_path):
    file = text_file(tmp_path, "t_s;x_nm", "0.0;90.5", "0.5;1,070", "1.0;95.25")
    read = read_columns(file, Layout({"time": "t_s", "x": "x_nm"}, {"time": "s", "x": "m"}, {}))
    with pytest.raises(InputError, match=r'line 3, column "x_nm": found "1,070".*decimal = ",".*decimal = "."'):
        read.check_numbers()


@pytest.mark.parametrize("words", [1, 7, 60])
@pytest.mark.parametrize("header", ["time_s;u_V;x_um", ""])
def test_words_among_the_first_samples_are_no_header(tmp_path, header, words):
    rows = [f"{0.25 * k};{k % 3};{'no signal' if k < words else f'{k}.5'}" for k in range(150)]
    file = text_file(tmp_path, *[header] * bool(header), *rows)
    reader = open_file(file)
    assert [channel.name for channel in reader.channels()] == (header.split(";") if header else ["1", "2", "3"])
    values = np.concatenate([block.values for block in reader.blocks([1, 3])])
    np.testing.assert_array_equal(values[:, 0], 0.25 * np.arange(150))
    assert np.isnan(values[:, 1]).sum() == words


def test_a_preamble_of_words_and_numbers_is_no_sample(tmp_path):
    file = text_file(tmp_path, "Sensor range;100", *(f"{0.5 * k};{k}" for k in range(20)))
    assert column(file).size == 20


@pytest.mark.parametrize(
    ("header", "letters"),
    [("t,A,D,V,F", "AV"), ("t,x,V", "V"), ("time,V", ""), ("s,u,V", ""), ("t,x,U_V", ""), ("t,x,V (mV)", "")],
)
def test_a_letter_among_symbols_may_be_no_unit(tmp_path, header, letters):
    count = header.count(",") + 1
    rows = [",".join(f"{k * (j + 1) / 8}" for j in range(count)) for k in range(20)]
    channels = open_file(text_file(tmp_path, header, *rows)).channels()
    assert "".join(c.name for c in channels if c.letter) == letters
    assert not any(c.measures("V") or c.measures("A") for c in channels if c.letter)


def test_a_column_that_is_named_v_in_a_study_is_in_volts(tmp_path):
    file = text_file(tmp_path, "t,x,V", *(f"{k / 8},{k},{k / 4}" for k in range(20)))
    read = read_columns(file, Layout({"time": "t", "u": "V"}, {"time": "s", "u": "V"}, {"time": "s"}))
    assert read.data["u"][4] == 1.0


@pytest.mark.parametrize("lines", [["X,CH1,CH2,Start,Increment", "Sequence,Volt,mm,{start},{step}"],
                                   ["CH1,CH2,Start,Increment", "Volt,mm,{start},{step}"],
                                   ["X,CH1,CH2,Start,Increment,", "Sequence,Volt,mm,{start},{step},"]])  # fmt: skip
def test_a_clock_in_the_header_of_an_oscilloscope_is_found_whatever_the_rows_hold(tmp_path, lines):
    index = lines[0].startswith("X")
    rows = [f"{k}," * index + f"{k % 5}.5,0.0{k % 7}" for k in range(40)]
    file = text_file(tmp_path, lines[0], lines[1].format(start="-2.0e-03", step="1.25e-04"), *rows)
    channels = {channel.name: channel for channel in open_file(file).channels()}
    assert list(channels) == ["X", "CH1", "CH2"][not index :]
    assert channels["CH1"].unit == "volt" and channels["CH2"].unit == "mm"
    read = read_columns(file, Layout({"x": "CH2"}, {"time": "s", "x": "m"}, {}))
    np.testing.assert_allclose(read.data["time"], -2e-3 + 1.25e-4 * np.arange(40))


@pytest.mark.parametrize("place", ["header", "first rows"])
def test_a_row_of_very_many_cells_is_refused_at_once(tmp_path, place):
    wide = "," * 240_000
    lines = [f"t_s,x_um{wide}"] * (place == "header") + ["0,1", wide, "1,2"]
    file = text_file(tmp_path, *lines)
    with pytest.raises(InputError, match=r"found 24000[0-9] cells, expected 10000 at most"):
        open_file(file).channels()


def test_a_row_of_very_many_cells_far_below_is_refused(tmp_path):
    file = text_file(tmp_path, "t_s,x_um", *["0,1"] * 80_000, "1" + ",2" * 240_000)
    with pytest.raises(InputError, match="line 80002: found 240001 cells, expected 2"):
        column(file)


@pytest.mark.parametrize("before", [1, 90_000])
def test_a_quoted_cell_of_any_length_is_a_cell(tmp_path, before):
    file = text_file(tmp_path, "t_s,x_um", *["0,1"] * before, f'1,"{"a" * 150_000}"', *["2,3"] * 9)
    read = read_columns(file, Layout({"x": "x_um"}, {"time": "s", "x": "m"}, {}, interval=1.0))
    with pytest.raises(InputError, match=r'found "a+\.\.\.", expected a finite number') as caught:
        read.check_numbers()
    assert len(str(caught.value)) < 400
