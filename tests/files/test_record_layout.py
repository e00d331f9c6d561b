"""What a record says of its file: channels by name or number, units, scales, a clock that was not stored, decimals."""

import instrument_files as made
import numpy as np
import pytest
from study_files import STUDY, changed, csv, write_study

from pdssjax import InputError, InputWarning, load_study

COLUMNS = 'columns = { time = "time_s", displacement = "displacement_um" }\nmeasures = "platform"'
SAMPLED = 'drive = { waveform = "sampled", column = "voltage_V" }'
IDEAL = 'drive = { waveform = "step", voltage = "48.2 V" }'


def step_of(folder, lines, file="step.csv", text=STUDY):
    """The step's record, with these `lines` in place of its columns."""
    study = changed(COLUMNS, lines + '\nmeasures = "platform"', text)
    return load_study(write_study(folder, changed('"step.csv"', f'"{file}"', study))).records[0]


@pytest.mark.parametrize(
    ("name", "lines"),
    [
        ("no header", 'columns = { time = 1, displacement = 3 }\nunits = { time = "s", displacement = "um" }'),
        ("no header", 'channel = 3\ntime = 1\nunits = { time = "s", displacement = "um" }'),
        ("Excel in Europe", 'channel = "Weg"\ntime = "Zeit"'),
        ("Excel, UTF-16 text", 'columns = { time = "Time", displacement = "Position [µm]" }'),
        ("Siglent", 'channel = "CH2"\ntime = 1\nscale = "1 um/V"'),
        ("TDMS", 'channel = "x"'),
        ("HDF5", 'channel = "run/x"\ntime = "run/t"'),
        ("MATLAB struct", 'channel = "x"\ntime = "t"'),
        ("MATLAB 7.3", 'channel = "x"\ntime = 1\nscale = "1 um"\nunits = { time = "s" }'),
    ],
)
def test_channels_of_any_file_are_named_or_numbered(tmp_path, name, lines):
    ending, write = made.FORMATS.get(name) or (".csv", made.TEXTS[name])
    write(tmp_path / f"file{ending}")
    step = step_of(tmp_path, lines, f"file{ending}")
    np.testing.assert_allclose(step.time, made.TIME, atol=1e-12)
    np.testing.assert_allclose(step.measured, 1e-6 * made.MOTION, atol=1e-15)


def test_a_clock_that_was_not_stored_is_told_by_its_interval(tmp_path):
    (tmp_path / "bare.txt").write_text("".join(f"{value:.4f}\n" for value in made.MOTION))
    lines = 'channel = 1\nunits = { displacement = "um" }\ntime = { interval = "50 us", start = "-2 ms" }'
    step = step_of(tmp_path, lines, "bare.txt")
    np.testing.assert_allclose(step.time, made.TIME, atol=1e-12)
    started = step_of(tmp_path, lines.replace(', start = "-2 ms"', "") + '\nstart = "2 ms"', "bare.txt")
    np.testing.assert_allclose(started.time, made.TIME, atol=1e-12)


@pytest.mark.parametrize(
    ("scale", "unit", "factor"),
    [
        ('"0.5 um/V"', "V", 0.5e-6),
        ('"-2 nm/mV"', "V", -2e-6),
        ("-1", "um", -1e-6),
        ('"3 um"', "", 3e-6),
        ("1e-6", "", 1e-6),
    ],
)
def test_a_scale_makes_displacements_of_volts(tmp_path, scale, unit, factor):
    lines = f'columns = {{ time = "time_s", displacement = "x" }}\nscale = {scale}'
    lines += f'\nunits = {{ displacement = "{unit}" }}' * (unit != "")
    text = changed('"step.csv"', '"shown.csv"')
    (tmp_path / "shown.csv").write_text(changed("displacement_um", "x", csv(5e-5, 40)))
    step = step_of(tmp_path, lines, "shown.csv", changed('"shown.csv"', '"step.csv"', text))
    np.testing.assert_allclose(step.measured[1], factor * 0.8415, rtol=1e-12)


def test_an_amplifiers_monitor_is_scaled_and_its_unit_may_stand_with_the_records(tmp_path):
    rows = [f"{k * 5e-5:.6f},{k % 7},{0.1 * min(k, 40):.3f}\n" for k in range(60)]
    (tmp_path / "seen.csv").write_text("time_s,x_um,monitor\n" + "".join(rows))
    drive = 'drive = { waveform = "sampled", column = "monitor", scale = 20 }'
    lines = 'channel = "x_um"\ntime = "time_s"\nunits = { voltage = "V" }'
    step = step_of(tmp_path, lines, "seen.csv", changed(IDEAL, drive))
    np.testing.assert_allclose(step.drive.at(np.array([5e-5, 1e-3])), [2.0, 40.0])


def test_the_remedy_that_a_message_names_for_a_voltage_works(tmp_path):
    (tmp_path / "seen.csv").write_text("time_s,x_um,u\n" + "".join(f"{k}e-5,{k % 7},{k}\n" for k in range(60)))
    lines, study = 'channel = "x_um"\ntime = "time_s"', changed(IDEAL, SAMPLED.replace("voltage_V", "u"))
    with pytest.raises(InputError, match=r'column "u": found no unit.*or the key "voltage" in \[record.units\]'):
        step_of(tmp_path, lines, "seen.csv", study)
    step = step_of(tmp_path, lines + '\nunits = { voltage = "mV" }', "seen.csv", study)
    assert step.drive.at(np.array([1e-4]))[0] == pytest.approx(0.01)


def test_a_decimal_comma_is_read_and_hinted_at(tmp_path):
    text = "time_s;displacement_um\n" + "".join(f"{k * 5e-5:.6f};{k % 7}.5\n" for k in range(40))
    (tmp_path / "mixed.csv").write_text(text.replace("0.000100;2.5", "0,000100;-0,005"))
    columns = 'columns = { time = "time_s", displacement = "displacement_um" }'
    with pytest.raises(InputError, match=r'line 4.*found "0,000100".*decimal = ","'):
        step_of(tmp_path, columns, "mixed.csv")
    (tmp_path / "comma.csv").write_text("time_s;displacement_um\n" + text.partition("\n")[2].replace(".", ","))
    for said in ("", '\ndecimal = ","'):
        assert step_of(tmp_path, columns + said, "comma.csv").measured[1] == pytest.approx(1.5e-6)
    with pytest.raises(InputError, match=r'key "decimal": found ";"'):
        step_of(tmp_path, columns + '\ndecimal = ";"', "comma.csv")


@pytest.mark.parametrize("cell", ["NaN", "", "overload"])
def test_what_is_no_number_may_stand_where_it_is_excluded(tmp_path, cell):
    text = changed("0.000500,", f"0.000500,{cell}#", csv(5e-5, 40))
    head, _, rest = text.partition(f"{cell}#")
    text = head + cell + rest[rest.index("\n") :]
    (tmp_path / "gap.csv").write_text(text)
    columns = 'columns = { time = "time_s", displacement = "displacement_um" }'
    step = step_of(tmp_path, columns + '\nexclude = [["0.45 ms", "0.55 ms"]]', "gap.csv")
    assert step.time.size == 37 and np.isfinite(step.measured).all()
    with pytest.raises(InputError, match='line 12, column "displacement_um"'):
        step_of(tmp_path, columns, "gap.csv")


def test_a_time_that_is_no_number_may_be_excluded_too(tmp_path):
    (tmp_path / "gap.csv").write_text(changed("0.000500,", "lost,", csv(5e-5, 40)))
    columns = 'columns = { time = "time_s", displacement = "displacement_um" }'
    assert step_of(tmp_path, columns + '\nexclude = [["0.44 ms", "0.46 ms"]]', "gap.csv").time.size == 38
    with pytest.raises(InputError, match='line 12, column "time_s": found "lost"'):
        step_of(tmp_path, columns, "gap.csv")


def test_decimation_keeps_what_is_slow_and_stops_what_would_fold(tmp_path):
    time = 1e-4 * np.arange(20_000)
    # The second one is faster than half the rate of what is kept.
    slow, fast = 3.0 * np.sin(2 * np.pi * 5.0 * time), np.sin(2 * np.pi * 990.0 * time)
    rows = "".join(f"{t:.6f},{x:.6f}\n" for t, x in zip(time, slow + fast, strict=True))
    (tmp_path / "long.csv").write_text("time_s,displacement_um\n" + rows)
    columns = 'columns = { time = "time_s", displacement = "displacement_um" }\ndecimate = 10'
    step = step_of(tmp_path, columns, "long.csv")
    assert step.time.size == 2000 - 32
    np.testing.assert_allclose(np.diff(step.time), 1e-3, rtol=1e-6)
    np.testing.assert_allclose(step.measured, 3e-6 * np.sin(2 * np.pi * 5.0 * step.time), atol=2e-10)
    # Thinned alone, the fast motion would have folded to a slow one in full.
    assert np.ptp(fast[::10]) > 1.8
    parts = step_of(tmp_path, columns + '\nexclude = [["0.9995 s", "1.0005 s"]]', "long.csv")
    assert parts.time.size < step.time.size - 30
    np.testing.assert_allclose(parts.measured, 3e-6 * np.sin(2 * np.pi * 5.0 * parts.time), atol=2e-10)


LAYOUTS = {
    "two clocks": (
        'columns = { time = "time_s", displacement = "displacement_um" }\ntime = 1',
        ["the time in columns"],
    ),
    "channel twice": ("columns = { displacement = 2, time = 1 }\nchannel = 2", ["the displacement in columns"]),
    "no clock": ('channel = "displacement_um"', ["found no clock", "interval"]),
    "interval beyond all clocks": (
        "channel = 2\ntime = { interval = 1e308 }",
        ['time: key "interval"', "found 1e+308 s", "up to 1e+09 s"],
    ),
    "interval of zero": ("channel = 2\ntime = { interval = 0 }", ['time: key "interval"', "above 0"]),
    "interval in volts": ('channel = 2\ntime = { interval = "1 V" }', ['"interval"', '"V"']),
    "number zero": ("channel = 0\ntime = 1", ['"channel"', "found 0", "from 1 on"]),
    "number beyond": ("channel = 3\ntime = 1", ["no column 3", "1, 2"]),
    "truth value": ("channel = true\ntime = 1", ['"channel"', "true"]),
    "scale of zero": ("channel = 2\ntime = 1\nscale = 0", ["scale", "other than 0"]),
    "scale of another kind": ('channel = 2\ntime = 1\nscale = "2 N/V"', ["scale", '"2 N/V"', "um"]),
    "scale beyond all floats": ("channel = 2\ntime = 1\nscale = 1" + "0" * 400, ["scale", "finite"]),
    "scale of words": ('channel = 2\ntime = 1\nscale = "much"', ["scale", '"much"']),
    "decimate by one": ("channel = 2\ntime = 1\ndecimate = 1", ['"decimate"', "from 2 on"]),
    "held for one": ("channel = 2\ntime = 1\nheld = 1", ['"held"', "from 2 on"]),
    "held for long": ("channel = 2\ntime = 1\nheld = 21", ['"held"', "40 samples"]),
    "decimate too short": ("channel = 2\ntime = 1\ndecimate = 2", ['"decimate"', "40 samples", "64"]),
}


@pytest.mark.parametrize(("lines", "essentials"), LAYOUTS.values(), ids=LAYOUTS)
def test_a_layout_at_fault_is_refused(tmp_path, lines, essentials):
    with pytest.raises(InputError) as caught:
        step_of(tmp_path, lines)
    assert "\n" not in str(caught.value)
    for essential in [str(tmp_path), *essentials]:
        assert essential in str(caught.value)


def test_cells_that_outnumber_the_header_are_told(tmp_path):
    rows = "".join(f"0,{k:06d},{k % 7},5\n" for k in range(40))
    (tmp_path / "commas.csv").write_text("time_s,displacement_um\n" + rows)
    with pytest.raises(InputError, match="line 2: found 4 cells, expected 2 as in the header; are decimal commas"):
        step_of(tmp_path, 'channel = "displacement_um"\ntime = "time_s"', "commas.csv")


@pytest.mark.parametrize("end", ["\r", "\r\n"])
def test_ends_of_lines_are_those_of_any_system(tmp_path, end):
    text = "Rig \x0c one" + end + csv(5e-5, 40).replace("\n", end)
    (tmp_path / "ends.csv").write_bytes(text.encode())
    step = step_of(tmp_path, 'channel = "displacement_um"\ntime = "time_s"', "ends.csv")
    assert step.time.size == 40


def test_uneven_samples_are_not_decimated(tmp_path):
    rows = "".join(f"{1e-4 * k**1.1:.7f},{np.sin(k):.4f}\n" for k in range(400))
    (tmp_path / "uneven.csv").write_text("time_s,displacement_um\n" + rows)
    with pytest.raises(InputError, match=r'"decimate": found samples .* expected even ones'):
        step_of(tmp_path, "channel = 2\ntime = 1\ndecimate = 4", "uneven.csv")


def test_a_noise_beyond_the_motion_is_questioned(tmp_path):
    with pytest.warns(InputWarning, match=r'"noise": found 1e\+04 um for a record that moves over 2 um in all'):
        load_study(write_study(tmp_path, changed('"0.01 um"', '"10 mm"')))


def test_records_to_be_made_need_names_of_columns(tmp_path):
    sampling = '\nsampling = { end = "20 ms", interval = "50 us" }'
    study = changed(COLUMNS, "channel = 2\ntime = 1" + sampling + '\nmeasures = "platform"')
    with pytest.raises(InputError, match='"columns": found a record to be made whose columns are numbered'):
        load_study(write_study(tmp_path, study), virtual=True)
    made_as = changed('"step.csv"', '"step.tdms"', changed("noise =", sampling[1:] + "\nnoise ="))
    with pytest.raises(InputError, match=r'"file": found "step.tdms" for a record to be made'):
        load_study(write_study(tmp_path, made_as), virtual=True)
