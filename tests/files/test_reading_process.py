"""Files are read by another process: what they claim, or do to a library, becomes one line, and costs little."""

import os
import struct
import subprocess
import sys
from pathlib import Path

import fabricated
import instrument_files
import numpy as np
import pytest
import scipy.io
from answering import numbered
from marks import slow

from pdssjax import InputError, InputWarning
from pdssjax.files import channel_samples, list_channels, reading_process
from pdssjax.files.channel_samples import open_file
from pdssjax.files.draws_file import read_draws, write_draws
from pdssjax.files.readers.base import AbstractReader, Block, Channel
from pdssjax.files.reading_process import run_isolated

HERE = Path(__file__)


@pytest.fixture(scope="module", autouse=True)
def known_to_the_other_process():
    """The helpers of tests; a process that was started before does not know them."""
    reading_process._end_idle()
    paths = [str(HERE.parents[1] / "helpers"), os.environ.get("PYTHONPATH", "")]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join(paths))
        yield
    reading_process._end_idle()


@pytest.fixture
def limited(monkeypatch):
    """Give another process less time [s] or memory [bytes] than usual."""

    def limit(**limits):
        pytest.importorskip("resource")
        for name, most in limits.items():
            monkeypatch.setattr(reading_process, name, most)
        reading_process._end_idle()

    yield limit
    reading_process._end_idle()


def test_pairs_come_one_by_one_from_one_process():
    found = list(run_isolated(numbered, HERE, 3, "printed")) + list(run_isolated(numbered, HERE, 4))
    assert [item[:2] for item, _ in found] == [[HERE.name, k] for k in (0, 1, 2, 0, 1, 2, 3)]
    assert len({item[2] for item, _ in found}) == 1 and found[0][0][2] != os.getpid()
    for (_, number, _), values in found:
        np.testing.assert_array_equal(values, np.full((2, number), 0.1 * number))


def test_answers_that_are_interleaved_or_given_up_are_not_mixed():
    one, other = run_isolated(numbered, HERE, 5), run_isolated(numbered, HERE, 5)
    numbers = [(a[0][1], b[0][1]) for a, b in zip(one, other, strict=True)]
    assert numbers == [(k, k) for k in range(5)]
    for seen, same in ((1, False), (5, True)):
        given_up = run_isolated(numbered, HERE, 5)
        *_, ((_, _, pid), _) = [next(given_up) for _ in range(seen)]
        given_up.close()
        found = [item for item, _ in run_isolated(numbered, HERE, 2)]
        assert [number for _, number, _ in found] == [0, 1]
        assert (found[0][2] == pid) == same


def test_a_process_that_was_ended_meanwhile_is_replaced():
    ((_, _, pid), _), *_ = run_isolated(numbered, HERE, 1)
    (waiting,) = reading_process._idle[os.getpid()]
    waiting.kill()
    waiting.wait()
    (((_, _, other), _),) = run_isolated(numbered, HERE, 1)
    assert other != pid


@pytest.mark.parametrize(
    ("stop", "kind", "said"),
    [
        ("refused", InputError, r"test_reading_process.py: found nothing, expected all\.$"),
        ("broken", ValueError, "^no such thing$"),
        ("crashed", ValueError, "^the library that reads it crashed on what is in it$"),
        slow("endless", ValueError, "^the library that reads it came to no end in 1 s$"),  # by default an HDF5 file's
        ("much", ValueError, r"^it needs more than 0\.1 GiB of memory$"),
    ],
)
def test_what_ends_it_is_said_and_the_next_question_is_answered(stop, kind, said, limited):
    if stop in ("endless", "much"):
        limited(SECONDS=1, MEMORY=1 << 27)
    got = []
    with pytest.raises(kind, match=said) as caught:
        got.extend(run_isolated(numbered, HERE, 2, stop))
    assert len(got) == 2 and (type(caught.value) is kind)
    assert len(list(run_isolated(numbered, HERE, 3))) == 3


def test_a_reader_s_own_places_come_through(monkeypatch):
    class Text(AbstractReader):
        place = "line"
        expected = "a text"
        recognises = classmethod(lambda cls, file, head: True)

        def channels(self):
            return [Channel("x", 1, "um", None)]

        def blocks(self, numbers, first=0):
            yield Block(np.array([[1.0], [np.nan], [3.0]]), np.array([4, 7, 8]))

    monkeypatch.setattr(channel_samples, "members", lambda family: ["text"])
    monkeypatch.setattr(channel_samples, "member", lambda family, name: Text)
    monkeypatch.setattr(channel_samples, "run_isolated", lambda function, *given: function(*given))
    monkeypatch.setattr(Text, "kind", "text")
    reader = open_file(HERE)
    (block,) = reader.blocks([1])
    assert reader.place == "line" and block.places.tolist() == [4, 7, 8]
    np.testing.assert_array_equal(block.values, [[1.0], [np.nan], [3.0]])


def test_warnings_are_handed_on():
    with pytest.warns(InputWarning, match="the end is missing"):
        assert len(list(run_isolated(numbered, HERE, 1, "warned"))) == 1


def test_the_process_imports_little():
    modules = "".join(f"import pdssjax.files.readers.{n}; " for n in ("hdf5", "matlab", "tdms", "oscilloscope"))
    heavy = "[m for m in ('jax', 'pint', 'equinox', 'scipy', 'xarray', 'h5py') if m in sys.modules]"
    code = f"import sys; import pdssjax.files.reading_process, pdssjax.files.channel_samples; {modules}print({heavy})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def matlab_file(folder):
    file = folder / "one.mat"
    scipy.io.savemat(file, {"t": np.arange(4.0), "x": np.arange(4.0) ** 2})
    return file


@pytest.mark.parametrize("kind", [0x86, 0xFF, 0x1000])
def test_a_matlab_file_on_which_scipy_crashes_is_refused_in_one_line(tmp_path, kind):
    file = matlab_file(tmp_path)
    content = bytearray(file.read_bytes())
    tag = content.index(struct.pack("<II", 9, 32))  # an element of doubles
    content[tag : tag + 4] = struct.pack("<I", kind)
    file.write_bytes(content)
    with pytest.raises(InputError, match=r"found a broken file \(.*\), expected a MATLAB file") as caught:
        open_file(file).channels()
    assert "\n" not in str(caught.value)


def test_the_format_that_the_other_process_reads_is_named(tmp_path):
    kind, (time, _) = list_channels(matlab_file(tmp_path))
    assert kind == "matlab" and time.name == "t"


MORE = r"more data than memory can hold, as a broken file may claim, expected (a MATLAB|an HDF5) file"


def test_a_matlab_file_that_unpacks_to_more_than_it_may_is_refused(tmp_path, limited):
    limited(MEMORY=1 << 26)
    file = tmp_path / "bomb.mat"
    scipy.io.savemat(file, {"x": np.zeros(30_000_000, np.int8)}, do_compression=True)
    assert file.stat().st_size < 100_000
    with pytest.raises(InputError, match=MORE):
        open_file(file).channels()


def endless(file):
    """Sets the size of the first text in the heap of an HDF5 file to none, on which its library looks for the next."""
    content = bytearray(file.read_bytes())
    heap = content.index(b"GCOL")
    content[heap + 24 : heap + 32] = bytes(8)
    file.write_bytes(content)


@pytest.mark.parametrize("name", ["HDF5", slow("MATLAB 7.3")])
def test_an_hdf5_file_on_which_its_library_loops_is_refused_in_one_line(tmp_path, name, limited):
    h5py = pytest.importorskip("h5py")
    limited(SECONDS=1)
    ending, write = instrument_files.FORMATS[name]
    file = tmp_path / f"loop{ending}"
    write(file)
    with h5py.File(file, "a") as stored:
        stored["extra"] = np.arange(4.0)
        stored["extra"].attrs["units"] = "s"
    endless(file)
    with pytest.raises(InputError, match=r"came to no end in 1 s\), expected an HDF5 file\.$") as caught:
        open_file(file).channels()
    assert str(caught.value).startswith(f"{file}: ")


def test_an_hdf5_file_that_unpacks_to_more_than_it_may_is_refused(tmp_path, limited):
    h5py = pytest.importorskip("h5py")
    file = tmp_path / "bomb.h5"
    with h5py.File(file, "w") as stored:
        stored.create_dataset("x", data=np.zeros(100_000_000, np.int8), chunks=(100_000_000,), compression="gzip")
    limited(MEMORY=1 << 26)
    with pytest.raises(InputError, match=r"^.*bomb.h5: found .*, expected an HDF5 file\.$"):
        list(open_file(file).blocks([1]))


@pytest.mark.parametrize("what", ["endless", "cut"])
def test_a_posterior_that_is_damaged_is_told_in_a_line(tmp_path, what, limited):
    pytest.importorskip("h5netcdf")
    limited(SECONDS=3)
    draws = fabricated.draws(fabricated.estimate().parameters, "posterior")
    write_draws(draws, {"piezo.gain": "m/V", "friction.sigma1_a": "N s/m"}, tmp_path)
    file = tmp_path / "posterior.nc"
    if what == "endless":
        endless(file)
    else:
        file.write_bytes(file.read_bytes()[:3000])
    with pytest.raises(InputError, match=r"posterior.nc: cannot be read \(.*\), expected the draws"):
        read_draws(tmp_path / "estimate.json", "posterior")
