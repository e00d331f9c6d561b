"""What is said of channels that were found: uneven clocks, suggestions that make sense, the same for all commands."""

import numpy as np
import pytest

from pdssjax import InputError
from pdssjax.files import Hints, list_channels
from pdssjax.files.channel_roles import roles_of
from pdssjax.files.channel_samples import open_file
from pdssjax.files.characterise_record import _clock
from pdssjax.files.record_columns import Layout, read_columns
from pdssjax.files.record_table import read_record
from pdssjax.files.toml_table import Table
from pdssjax.metrics import counts_without_noise, outliers
from pdssjax.report.text import format_channels

UNTOLD = Hints({}, {}, {})


def text_file(folder, header, *columns, form="%.6f"):
    file = folder / "run.csv"
    np.savetxt(file, np.column_stack(columns), form, ",", header=header, comments="")
    return file


@pytest.mark.parametrize(
    ("time", "form", "said"),
    [
        (3.0 + 4e-4 * np.arange(90), "%.6f", ""),
        (3.0 + 4e-4 * np.arange(90), "%.3f", "repeats numbers: too few digits"),
        (np.cumsum(1e-3 * (1.0 + np.arange(90) % 2)), "%.6f", "increases, unevenly: steps of 0.001 to 0.002"),
        (np.where(np.arange(90) < 50, 0.0, 8.0), "%.6f", ""),
    ],
)
def test_clocks_that_are_uneven_or_coarse_are_marked(tmp_path, time, form, said):
    file = text_file(tmp_path, "time_s,x_um", time, np.sin(time * 40), form=form)
    told = format_channels("run.csv", *list_channels(file)).splitlines()[2]
    assert said in told and (said or ("unevenly" not in told and "repeats" not in told))


def test_times_that_repeat_are_refused_with_what_to_give_instead(tmp_path):
    file = text_file(tmp_path, "time_s,x_um", 7.0 + 4e-4 * np.arange(90), np.arange(90.0), form="%.3f")
    with pytest.raises(InputError, match="too few digits give the interval"):
        read_columns(file, Layout({"time": 1, "x": 2}, {"time": "s", "x": "m"}, {}))


@pytest.mark.parametrize(
    ("header", "scale"),
    [("load_kN,x_um", ""), ("x_um,y_mm", ""), ("time_s,voltage_V,b_V", '--scale "displacement=0.5 um/V"')],
)
def test_a_scale_is_suggested_of_what_a_sensors_amplifier_gives_alone(tmp_path, header, scale):
    columns = np.random.default_rng(4).standard_normal((header.count(",") + 1, 60))
    columns[0] = 1e-3 * np.arange(60) if header.startswith("time") else columns[0]
    with pytest.raises(InputError) as caught:
        roles_of(text_file(tmp_path, header, *columns), UNTOLD)
    assert scale in str(caught.value) and ("--scale" in str(caught.value)) == bool(scale)


def test_a_refusal_says_which_channels_were_taken(tmp_path):
    columns = np.random.default_rng(4).standard_normal((4, 60))
    columns[0] = 1e-3 * np.arange(60)
    with pytest.raises(InputError, match=r'took channel 1 \("time_s"\) for the time, 2 \("u_V"\) for the voltage'):
        roles_of(text_file(tmp_path, "time_s,u_V,a_um,b_um", *columns), UNTOLD)


def test_a_count_of_samples_beside_a_clock_is_no_motion(tmp_path):
    count = np.arange(60.0)
    columns = np.random.default_rng(4).standard_normal((2, 60))
    with pytest.raises(InputError, match=r'no channel that may be the displacement \(4: "sensor_V"'):
        roles_of(
            text_file(tmp_path, "n,time_s,u_V,sensor_V", count, 1e-3 * count, *columns),
            Hints({"voltage": "u_V"}, {}, {}),
        )


def test_a_letter_among_symbols_is_not_taken_for_volts(tmp_path):
    time = 1e-3 * np.arange(400)
    wave = [np.sin(30 * time), np.sin(30 * time), np.cos(30 * time), np.sign(np.cos(30 * time))]
    with pytest.raises(InputError) as caught:
        roles_of(text_file(tmp_path, "t,A,D,V,F", time, *wave), UNTOLD)
    assert "several channels that may be the voltage" in str(caught.value) and '"V"' in str(caught.value)


@pytest.mark.parametrize(
    ("header", "clock"), [("t,x_um", 1), ("x_um,Zeit", 2), ("x_um,n_s", 2), ("x_um,count", 2), ("x_um,", 2)]
)
def test_what_the_list_shows_as_a_clock_is_one_for_a_characterisation(tmp_path, header, clock):
    columns = [np.sin(np.arange(60.0)), np.sin(np.arange(60.0))]
    columns[clock - 1] = 1e-3 * np.arange(60)
    file = text_file(tmp_path, header, *columns)
    assert _clock(file, None, open_file(file).channels(), "") == {"time": clock}


@pytest.mark.parametrize("interval", ["0.1 ns", 1e-12])
def test_a_record_to_be_made_of_very_many_samples_is_refused(tmp_path, interval):
    entries = {
        "file": "made.csv",
        "measures": "platform",
        "columns": {"time": "time_s", "displacement": "x_um"},
        "drive": {"waveform": "step", "voltage": "10 V"},
        "sampling": {"end": "9 s", "interval": interval},
    }
    with pytest.raises(InputError, match=r'sampling: key "interval": found .* expected 1e\+07 at most'):
        read_record(Table(entries, "study.toml"), Table({}, ""), tmp_path, virtual=True)


def test_counts_without_noise_are_no_glitches():
    time = 1e-4 * np.arange(800)
    true = 4.0 * (1 - np.exp(-60 * time) * np.cos(900 * time))
    counted = np.round(true / 0.05) * 0.05
    assert counts_without_noise(counted)
    assert outliers(counted, true, time, None).size == 0
    counted[333] += 0.4
    assert outliers(counted, true, time, None).tolist() == [333]
    noisy = true + 0.1 * np.random.default_rng(1).standard_normal(800)
    assert not counts_without_noise(np.round(noisy / 0.05) * 0.05) and not counts_without_noise(noisy)
