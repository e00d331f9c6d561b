"""A contract that every format of file keeps: the same samples from all, in blocks, and one clear line where broken."""

import subprocess
import sys

import instrument_files as made
import numpy as np
import pytest

from pdssjax import InputError, InputWarning
from pdssjax.core import factor, member, members
from pdssjax.files.channel_samples import Clock, find_channel, open_file, read_samples
from pdssjax.files.readers import base
from pdssjax.files.record_columns import Layout, read_columns

SI = {"time": "s", "voltage": "V", "displacement": "m"}


def written(folder, name):
    """A file of the dialect or format `name`."""
    ending, write = made.FORMATS[name] if name in made.FORMATS else (".csv", {**made.TEXTS, **made.SCOPES}[name])
    file = folder / f"file{ending}"
    write(file)
    return file


def reader_of(file):
    """The reader of `file` in this process, where it can be patched and its memory be measured."""
    opened = open_file(file)
    return getattr(opened, "reader", opened)


def test_members_say_what_they_read():
    kinds = [member("files.readers", name) for name in members("files.readers")]
    assert len(kinds) >= 5
    assert all(issubclass(kind, base.AbstractReader) and kind.ending.startswith(".") for kind in kinds)
    of_files = {ending for ending, _ in made.FORMATS.values()}
    assert {".mat", ".tdms", ".h5"} <= of_files
    assert {kind.ending for kind in kinds} == {".csv", ".wfm"} | of_files


@pytest.mark.parametrize("name", [*made.TEXTS, *made.FORMATS])
def test_the_same_samples_come_from_every_format(tmp_path, name):
    file = written(tmp_path, name)
    channels = open_file(file).channels()
    assert len(channels) == 3
    bare = name.startswith(("no header", "LabVIEW", "LeCroy", "MATLAB 4", "MATLAB 5", "MATLAB 7"))
    assert [c.unit != "" for c in channels] == ([False] * 3 if bare else [True] * 3)
    units = {"time": "s", "voltage": "V", "displacement": "um"}
    numbers = dict(zip(SI, [c.number for c in channels], strict=True))
    scales = {"displacement": "1 um/V"} if channels[2].unit.lower() in ("v", "volt") else {}
    read = read_columns(file, Layout(numbers, SI, units if bare else {}, scales))
    np.testing.assert_allclose(read.data["time"], made.TIME, atol=1e-12)
    np.testing.assert_allclose(read.data["voltage"], made.VOLTAGE)
    np.testing.assert_allclose(read.data["displacement"], 1e-6 * made.MOTION, atol=1e-15)
    assert read.begin == pytest.approx(made.START)


def set_block(monkeypatch, reader, samples):
    """Give blocks so many `samples`, in the module of the `reader` and in its base, which cuts arrays in memory."""
    for module in (type(reader).__module__, base.__name__):
        monkeypatch.setattr(sys.modules[module], "BLOCK", samples, raising=False)


@pytest.mark.parametrize("name", [*made.TEXTS, *made.FORMATS])
def test_blocks_join_to_the_whole_and_may_begin_anywhere(tmp_path, name, monkeypatch):
    file = written(tmp_path, name)
    reader = reader_of(file)
    numbers = [channel.number for channel in reader.channels()][::-2]
    whole = [block.values for block in reader.blocks(numbers)]
    apart = [block.values for block in open_file(file).blocks(numbers)]
    np.testing.assert_array_equal(apart, whole)
    assert len(whole) == 1 and whole[0].shape == (made.COUNT, 2)
    set_block(monkeypatch, reader, 70)
    for first in (0, 69, 70, 200):
        parts = list(reader.blocks(numbers, first))
        assert len(parts) > 3
        np.testing.assert_array_equal(np.concatenate([part.values for part in parts]), whole[0][first:])
        places = np.concatenate([part.places for part in parts])
        assert np.all(np.diff(places) > 0) and places.size == made.COUNT - first


@pytest.mark.parametrize("name", [*made.TEXTS, *made.FORMATS])
def test_a_window_keeps_what_lies_in_it(tmp_path, name):
    file = written(tmp_path, name)
    reader = open_file(file)
    time, _, motion = reader.channels()
    clock = Clock(time.number, factor(time.unit or "s", "s", ""))
    window = (0.0, 1e-3)
    read = read_samples(reader, file, [motion.number], clock, window)
    keep = (window[0] - 1e-12 <= made.TIME) & (window[1] + 1e-12 >= made.TIME)
    np.testing.assert_allclose(read.values[:, 0], made.MOTION[keep])
    counted = read_samples(reader, file, [motion.number], Clock(None, 1.0, made.START, made.INTERVAL), window)
    assert abs(counted.time.size - keep.sum()) <= 1  # a sample on the edge, by rounding


def test_a_waveform_of_labview_brings_its_clock(tmp_path):
    file = written(tmp_path, "TDMS")
    read = read_columns(file, Layout({"displacement": "x"}, SI, {}))
    np.testing.assert_allclose(read.data["time"], made.TIME, atol=1e-12)
    assert [c.name for c in open_file(file).channels()] == ["run/t", "run/u", "run/x"]


@pytest.mark.parametrize("name", made.SCOPES)
def test_exports_of_oscilloscopes_with_a_layout_of_their_own(tmp_path, name):
    file = written(tmp_path, name)
    channels = open_file(file).channels()
    if name == "Rigol":
        assert [c.name for c in channels] == ["X", "CH1", "CH2"]
        read = read_columns(file, Layout({"displacement": "CH2"}, SI, {}, {"displacement": "1 um/V"}))
    else:
        assert [(c.name, c.unit) for c in channels] == [("time", "s"), ("CH1", "V")]
        read = read_columns(file, Layout({"time": "time", "displacement": "CH1"}, SI, {}, {"displacement": "1 um/V"}))
    np.testing.assert_allclose(read.data["time"], made.TIME, atol=1e-9)
    np.testing.assert_allclose(read.data["displacement"], 1e-6 * made.MOTION, atol=1e-12)


def test_a_binary_file_of_an_oscilloscope(tmp_path):
    pytest.importorskip("RigolWFM.wfm")
    file = tmp_path / "scope.isf"
    made.isf(file)
    (channel,) = open_file(file).channels()
    assert channel.unit == "V" and channel.samples == made.COUNT
    read = read_columns(file, Layout({"voltage": 1}, SI, {}))
    np.testing.assert_allclose(read.data["time"], made.TIME, atol=1e-9)
    np.testing.assert_allclose(read.data["voltage"], made.VOLTAGE, atol=1e-3)


BROKEN = {
    "TDMS that ends early": (".tdms", made.broken_tdms(), "a TDMS file"),
    "TDMS in name only": (".tdms", b"time_s,u_V\n0,1\n", "a TDMS file"),
    "HDF5 that ends early": (".h5", b"\x89HDF\r\n\x1a\n" + bytes(200), "an HDF5 file"),
    "HDF5 in name only": (".h5", b"hello", "an HDF5 file"),
    "MATLAB that ends early": (".mat", b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM\x0f\0\0\0\xff", "a MATLAB file"),
    "MATLAB in name only": (".mat", b"time_s,u_V\n0,1\n", "a MATLAB file"),
    "oscilloscope": (".wfm", b"\xa5\xa5\x00\x00" + bytes(100), "export it as CSV"),
    "oscilloscope's text": (".isf", b":WFMPRE:BYT_NR 2;CURVE #", "export it as CSV"),
    "Excel": (".xlsx", b"PK\x03\x04" + bytes(100), "saved as CSV"),
    "bytes": (".csv", bytes(range(256)) * 4, "expected text"),
    "unknown": (".xyz", bytes(range(256)) * 4, ".tdms"),
    "prose": (".csv", b"Dear colleague,\nhere are the data.\n", "a row of numbers"),
    "empty": (".txt", b"", "is empty"),
}


@pytest.mark.parametrize(("ending", "content", "expected"), BROKEN.values(), ids=BROKEN)
def test_a_broken_file_is_refused_in_one_line(tmp_path, ending, content, expected):
    file = tmp_path / f"broken{ending}"
    file.write_bytes(content)
    with pytest.raises(InputError) as caught:
        reader = open_file(file)
        list(reader.blocks([reader.channels()[0].number]))
    message = str(caught.value)
    assert message.startswith(f"{file}: ") and "\n" not in message
    assert expected in message and ("expected" in message or "empty" in message)


def test_a_tdms_file_whose_names_claim_more_than_memory_has_is_refused(tmp_path, monkeypatch):
    nptdms = pytest.importorskip("nptdms")
    file = written(tmp_path, "TDMS")

    def exhausted(*arguments):
        raise MemoryError

    # As Python does where a length that is read is beyond what the system gives.
    monkeypatch.setattr(nptdms.TdmsFile, "open", exhausted)
    with pytest.raises(InputError, match=r"more data than memory can hold.*expected a TDMS file"):
        reader_of(file).channels()


@pytest.mark.filterwarnings("ignore:.*the file ends before its samples do:pdssjax.core.errors.InputWarning")
@pytest.mark.parametrize("name", made.FORMATS)
def test_a_file_cut_short_is_refused_or_read_as_far_as_it_goes(tmp_path, name):
    file = written(tmp_path, name)
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])
    try:
        reader = open_file(file)
        read = np.concatenate([block.values for block in reader.blocks([reader.channels()[0].number])])
    except InputError as error:
        assert str(error).startswith(f"{file}: found") and "\n" not in str(error)
    else:
        np.testing.assert_allclose(read[:, 0], made.TIME[: len(read)], atol=1e-12)


def test_a_tdms_file_that_was_broken_off_says_so_in_one_line(tmp_path, capfd):
    nptdms = pytest.importorskip("nptdms")
    file = tmp_path / "run.tdms"
    with nptdms.TdmsWriter(file) as stored:
        stored.write_segment([nptdms.ChannelObject("run", name, np.arange(500.0)) for name in "ab"])
    file.write_bytes(file.read_bytes()[:-4100])
    with pytest.warns(InputWarning, match='the part before is read, which is nothing of "run/b"'):
        (channel,) = open_file(file).channels()
    assert channel.name == "run/a" and 400 < channel.samples < 500
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("name", "module", "line"),
    [("MATLAB 7.3", "h5py", "[hdf5]"), ("HDF5", "h5py", "[hdf5]"), ("TDMS", "nptdms", "[tdms]")],
)
def test_a_missing_library_is_named_with_the_line_that_installs_it(tmp_path, monkeypatch, name, module, line):
    file = written(tmp_path, name)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError, match=r'not installed; expected: pip install "pdssjax') as caught:
        reader_of(file).channels()
    assert module in str(caught.value) and line in str(caught.value)


def test_text_and_older_matlab_need_no_library_of_an_extra(tmp_path, monkeypatch):
    for module in ("h5py", "nptdms", "RigolWFM", "RigolWFM.wfm"):
        monkeypatch.setitem(sys.modules, module, None)
    for name in ("comma", "MATLAB 5"):
        assert len(reader_of(written(tmp_path, name)).channels()) == 3
    (tmp_path / "scope.wfm").write_bytes(b"\xa5\xa5")
    with pytest.raises(InputError, match=r'RigolWFM.*pip install "pdssjax\[oscilloscope\]"'):
        reader_of(tmp_path / "scope.wfm").channels()


@pytest.mark.parametrize(("header", "unit"), [("t,u,s", ""), ("time [ms],u,s", ""), ("s,u,V", "s")])
def test_beside_a_clock_that_is_called_so_s_is_a_displacement(tmp_path, header, unit):
    (tmp_path / "a.csv").write_text(header + "\n" + "".join(f"{0.1 * k},{k},{2 * k}\n" for k in range(20)))
    assert {c.name: c.unit for c in open_file(tmp_path / "a.csv").channels()}["s"] == unit


def test_channels_are_found_by_name_by_number_and_by_the_end_of_a_path(tmp_path):
    file = written(tmp_path, "HDF5")
    reader = open_file(file)
    channels = reader.channels()
    for given in ("run/x", "x", 3):
        assert find_channel(reader, file, channels, given).name == "run/x"
    for given, told in (("y", "there is no channel"), (4, "there is no channel 4"), (0, "expected one of 1, 2, 3")):
        with pytest.raises(InputError, match=told):
            find_channel(reader, file, channels, given)


@pytest.mark.parametrize("name", ["HDF5", "MATLAB 5", "TDMS"])
def test_channels_of_different_lengths_are_refused(tmp_path, name):
    file = written(tmp_path, name)
    reader = open_file(file)
    if name == "HDF5":
        import h5py

        with h5py.File(file, "a") as stored:
            stored["run/short"] = np.arange(5.0)
    elif name == "TDMS":
        import nptdms

        with nptdms.TdmsWriter(file, "a") as stored:
            stored.write_segment([nptdms.ChannelObject("run", "short", np.arange(5.0))])
    else:
        import scipy.io

        scipy.io.savemat(file, {"t": made.TIME, "short": np.arange(5.0)})
    by_name = {channel.name.rpartition("/")[2]: channel.number for channel in reader.channels()}
    with pytest.raises(InputError, match=r"found 600 in .*, 5 in .*short"):
        list(reader.blocks([by_name["t"], by_name["short"]]))


def big(file, count):
    """A CSV file of `count` samples, made in parts."""
    with file.open("w") as stream:
        stream.write("time_s;u_V;x_um\n")
        for begin in range(0, count, 100_000):
            here = np.arange(begin, min(begin + 100_000, count))
            stream.writelines(f"{k}e-6;{k % 977};{k % 1013},5\n" for k in here)


RESIDENT = """
import resource, sys
from pathlib import Path
from pdssjax.files.channel_samples import Clock, open_file, read_samples
file = Path(sys.argv[1])
reader = open_file(file)
numbers = [channel.number for channel in reader.channels()]
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
read = read_samples(reader, file, numbers[1:], Clock(numbers[0]), (19.0, 19.001))
print(read.time.size, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""
"""How many samples are read from a window of a file, and by how much the process grows [KiB]."""


def peak_memory(file, window):
    """Samples read from a window, and the largest memory [bytes] that it took."""
    import tracemalloc

    reader = reader_of(file)
    numbers = [channel.number for channel in reader.channels()]
    tracemalloc.start()
    try:
        read = read_samples(reader, file, numbers[1:], Clock(numbers[0]), window)
        return read, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("ending", [".csv", ".h5", ".tdms"])
def test_memory_is_that_of_a_block_and_of_the_window_alone(tmp_path, ending, monkeypatch):
    count, block = 120_000, 5_000
    file = tmp_path / f"long{ending}"
    if ending == ".csv":
        big(file, count)
    elif ending == ".h5":
        import h5py

        with h5py.File(file, "w") as stored:
            for name in "tux":
                stored.create_dataset(name, data=1e-6 * np.arange(count), chunks=(block,))
    else:
        import nptdms

        with nptdms.TdmsWriter(file) as stored:
            for begin in range(0, count, block):
                part = 1e-6 * np.arange(begin, begin + block)
                stored.write_segment([nptdms.ChannelObject("run", name, part) for name in "tux"])
    set_block(monkeypatch, reader_of(file), block)
    read, peak = peak_memory(file, (0.0999995, 0.1009995))
    assert read.time.size == 1000
    assert read.time[0] == pytest.approx(0.1) and read.begin == 0.0
    # All of it would be 2.9 MB as numbers alone; lines of text take some 120 bytes each, twice.
    assert peak < 2.2e6 if ending == ".csv" else peak < 1.2e6


@pytest.mark.slow
def test_twenty_million_samples_are_read_with_a_window(tmp_path):
    file = tmp_path / "long.csv"
    big(file, 20_000_000)
    told = subprocess.run([sys.executable, "-c", RESIDENT, str(file)], capture_output=True, text=True, check=True)
    count, grown = map(int, told.stdout.split())
    assert count in (1000, 1001)
    assert grown < 150_000
