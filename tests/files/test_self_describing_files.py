"""Files that describe themselves are believed as a whole, or refused: packing, clocks, complex numbers, names."""

import os

import numpy as np
import pytest
import scipy.io

from pdssjax import InputError
from pdssjax.files.channel_samples import find_channel, open_file
from pdssjax.files.record_columns import Layout, read_columns

COUNTS = np.array([-300, -20, 0, 17, 1200, 30000, 12, 5], np.int16)


def channel_values(file, name):
    reader = open_file(file)
    channel = find_channel(reader, file, reader.channels(), name)
    return np.concatenate([block.values[:, 0] for block in reader.blocks([channel.number])])


@pytest.fixture
def packed(tmp_path):
    """Makes an HDF5 file of one dataset with attributes."""
    h5py = pytest.importorskip("h5py")

    def make(data, **attributes):
        file = tmp_path / "packed.h5"
        with h5py.File(file, "w") as stored:
            stored["run/x"] = data
            stored["run/x"].attrs.update(attributes)
        return file

    return make


@pytest.mark.parametrize(
    ("attributes", "expected"),
    [
        ({"scale_factor": 0.5, "add_offset": -3.0}, 0.5 * COUNTS - 3.0),
        ({"scale_factor": np.array([0.25])}, 0.25 * COUNTS),
        ({"add_offset": 2}, COUNTS + 2.0),
        ({"_FillValue": np.int16(17), "add_offset": 1.0}, np.where(COUNTS == 17, np.nan, COUNTS + 1.0)),
        ({"missing_value": [12, 5]}, np.where(np.isin(COUNTS, [5, 12]), np.nan, COUNTS)),
        ({"valid_range": [-100, 2000]}, np.where((COUNTS < -100) | (COUNTS > 2000), np.nan, COUNTS)),
        ({"valid_max": 1200, "scale_factor": 2.0}, np.where(COUNTS > 1200, np.nan, 2.0 * COUNTS)),
    ],
)
def test_packed_numbers_are_unpacked(packed, attributes, expected):
    np.testing.assert_array_equal(channel_values(packed(COUNTS, **attributes), "x"), expected)


def test_a_marker_has_the_precision_of_the_samples(packed):
    file = packed(np.array([0.5, 1e20, 0.25], np.float32), missing_value=1e20)
    np.testing.assert_array_equal(channel_values(file, "x"), [0.5, np.nan, 0.25])


@pytest.mark.parametrize(
    ("attributes", "said"),
    [
        ({"scale_factor": "0.5 um"}, "expected a number"),
        ({"add_offset": [1.0, 2.0]}, "expected a number"),
        ({"valid_range": 3}, "expected two numbers"),
        ({"_Unsigned": "true"}, "not read"),
    ],
)
def test_packing_that_is_not_understood_is_refused(packed, attributes, said):
    (key,) = attributes
    with pytest.raises(InputError, match=f'channel "run/x": attribute "{key}": found .*{said}'):
        channel_values(packed(COUNTS, **attributes), "x")


def test_samples_that_no_bytes_hold_are_refused(tmp_path):
    h5py = pytest.importorskip("h5py")
    file = tmp_path / "claims.h5"
    with h5py.File(file, "w") as stored:
        stored.create_dataset("x", (10**12,), "f4", chunks=(4096,), compression="gzip")[:4096] = 1.0
    with pytest.raises(InputError, match=r'channel "x": found 1e\+12 samples claimed by \d+ bytes'):
        channel_values(file, "x")


@pytest.mark.parametrize("form", [".mat", ".h5", ".tdms"])
def test_complex_numbers_are_two_channels(tmp_path, form):
    file, values = tmp_path / f"response{form}", np.array([1 + 2j, 3 - 4j, 0.5j])
    if form == ".mat":
        scipy.io.savemat(file, {"f": np.arange(3.0), "run": {"G": values}})
    elif form == ".h5":
        with pytest.importorskip("h5py").File(file, "w") as stored:
            stored["run/G"] = values
    else:
        nptdms = pytest.importorskip("nptdms")
        with nptdms.TdmsWriter(file) as stored:
            stored.write_segment([nptdms.ChannelObject("run", "G", values)])
    names = [channel.name for channel in open_file(file).channels()]
    assert [name.replace("/", ".") for name in names][-2:] == ["run.G.real", "run.G.imag"]
    np.testing.assert_array_equal(channel_values(file, names[-2]), values.real)
    np.testing.assert_array_equal(channel_values(file, names[-1]), values.imag)


def two_clocks(file, **other):
    """A TDMS file of a voltage and a motion, whose clock differs in some properties."""
    nptdms = pytest.importorskip("nptdms")
    begun = np.datetime64("2026-03-04T05:06:07.250000", "us")
    clock = {"wf_start_time": begun, "wf_increment": 1e-3, "wf_start_offset": 0.0}
    changed = {key: begun + np.timedelta64(v, "us") if key == "wf_start_time" else v for key, v in other.items()}
    channels = [("u", clock), ("x", clock | changed)]
    with nptdms.TdmsWriter(file) as stored:
        made = [nptdms.ChannelObject("run", n, np.arange(9.0), {"unit_string": "V", **c}) for n, c in channels]
        stored.write_segment(made)
    return file


@pytest.mark.parametrize(
    ("other", "start", "interval"),
    [
        ({"wf_start_time": 12_500}, 0.0125, 1e-3),
        ({"wf_start_offset": 0.25}, 0.25, 1e-3),
        ({"wf_increment": 2e-3}, 0.0, 2e-3),
    ],
)
def test_channels_of_different_clocks_are_not_simultaneous(tmp_path, other, start, interval):
    file = two_clocks(tmp_path / "run.tdms", **other)
    si = {"time": "s", "u": "V", "x": "V"}
    read = read_columns(file, Layout({"x": "x"}, si, {}))
    np.testing.assert_allclose(read.data["time"], start + interval * np.arange(9))
    assert read_columns(file, Layout({"u": "u"}, si, {})).data["time"][0] == 0.0
    for told in ({}, {"interval": 1e-3}):
        with pytest.raises(InputError, match=r'clocks that differ.*"run/u" from 0 s on.*"run/x" from'):
            read_columns(file, Layout({"u": "u", "x": "x"}, si, {}, **told))


def test_an_earlier_start_counts_from_the_earliest_in_the_file(tmp_path):
    file = two_clocks(tmp_path / "run.tdms", wf_start_time=-500_000)
    assert [channel.start for channel in open_file(file).channels()] == [0.5, 0.0]


def test_series_of_one_name_are_told_apart_by_their_path_and_x_is_their_clock(tmp_path):
    kinds = [(key, object) for key in ("Name", "Path", "Data", "Unit")]
    series = [("Out1", f"Model Root/Gain{k}", np.arange(6.0) * k, "") for k in (1, 2)]
    series.append(("u", "Model Root/Sine", np.arange(6.0), "V"))
    clock = np.array([("", "Host", 0.5 * np.arange(6.0))], [(key, object) for key in ("Name", "Raster", "Data")])
    file = tmp_path / "capture.mat"
    scipy.io.savemat(file, {"capture": {"X": clock, "Y": np.array(series, kinds)}})
    channels = open_file(file).channels()
    assert [(c.name, c.unit) for c in channels] == [("time", "s"), ("Gain1/Out1", ""), ("Gain2/Out1", ""), ("u", "V")]
    np.testing.assert_array_equal(channel_values(file, "Gain2/Out1"), 2.0 * np.arange(6))


@pytest.mark.parametrize(
    "first", [b"    -1\n    58\n", b"    -1  \r\n   151\r\n", b"    -1\n    58b     1     2          11\n"]
)
def test_a_universal_file_is_named_with_what_to_export(tmp_path, first):
    file = tmp_path / "scan.unv"
    file.write_bytes(first + b"plate\n         0         1\n")
    with pytest.raises(InputError, match=r"Universal File .*dataset (58|151).*exported as CSV"):
        open_file(file)
    (tmp_path / "numbers.csv").write_text("-1\n151\n3\n4\n")
    assert len(open_file(tmp_path / "numbers.csv").channels()) == 1


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes with names here")
def test_a_pipe_is_refused_before_it_is_waited_for(tmp_path):
    os.mkfifo(tmp_path / "run.csv")
    with pytest.raises(InputError, match="found a pipe or a device"):
        open_file(tmp_path / "run.csv")
