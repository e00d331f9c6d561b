"""Files that oscilloscopes wrote, against what is known of them from elsewhere (PROVENANCE.md in their archive)."""

import zipfile
from pathlib import Path

import instrument_files as made
import numpy as np
import pytest
from scipy.optimize import curve_fit

from pdssjax import InputError
from pdssjax.files.channel_samples import open_file
from pdssjax.files.record_columns import Layout, read_columns

pytest.importorskip("RigolWFM.wfm")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("oscilloscopes")
    zipfile.ZipFile(Path(__file__).parents[1] / "data" / "oscilloscopes.zip").extractall(place)
    return place


def volts(file):
    """Samples of all channels."""
    reader = open_file(file)
    return next(iter(reader.blocks([channel.number for channel in reader.channels()]))).values


@pytest.mark.parametrize(
    ("name", "units", "count", "interval"),
    [
        ("rigol.bin", "VVVV", 1000, 5e-6),
        ("siglent.bin", "A", 2000, 1e-4),
        ("keysight.bin", "V", 1953, 1.024e-6),
        ("lecroy.trc", "V", 502, 1e-9),
        ("lecroy.000", "V", 5002, 1e-9),
        ("rohde_schwarz.bin", "VV", 4000, 1.25e-6),
        ("tektronix.wfm", "V", made.COUNT, made.INTERVAL),
    ],
)
def test_channels_of_every_make(folder, name, units, count, interval):
    channels = open_file(folder / name).channels()
    assert "".join(channel.unit for channel in channels) == units
    for channel in channels:
        assert channel.samples == count
        assert channel.interval == pytest.approx(interval, rel=1e-6)
        assert channel.start == pytest.approx(-0.5 * count * interval, rel=0.1) or name.startswith(("le", "tek"))
    assert volts(folder / name).shape == (count, len(units))


def test_two_channels_are_those_of_the_instrument_s_text(folder):
    text = np.loadtxt(folder / "rohde_schwarz.csv", delimiter=",")
    np.testing.assert_allclose(volts(folder / "rohde_schwarz.bin"), text, atol=1e-7)


def test_a_sine_is_what_the_instrument_measured(folder):
    """1.0000 kHz and 1.00 V from peak to peak, it says."""
    (measured,) = volts(folder / "keysight.bin").T
    time = 1.024e-6 * np.arange(measured.size)
    sine = lambda t, amplitude, frequency, phase, zero: amplitude * np.sin(2.0 * np.pi * frequency * t + phase) + zero
    (amplitude, frequency, _, _), _ = curve_fit(sine, time, measured, (0.4, 950.0, 0.0, 0.0))
    assert frequency == pytest.approx(1000.0, abs=0.5)
    assert 2.0 * abs(amplitude) == pytest.approx(1.0, abs=0.02)


def test_a_current_is_read_in_amperes(folder):
    """Of 300 mA, its name says."""
    (current,) = volts(folder / "siglent.bin").T
    assert np.median(current[current > 0.15]) == pytest.approx(0.3, rel=0.02)
    with pytest.raises(InputError, match="expected a unit that converts to V"):
        read_columns(folder / "siglent.bin", Layout({"voltage": 1}, {"voltage": "V"}, {}))


def test_a_file_of_tektronix_s_library(folder):
    read = read_columns(folder / "tektronix.wfm", Layout({"voltage": 1}, {"voltage": "V", "time": "s"}, {}))
    np.testing.assert_allclose(read.data["time"], made.TIME, atol=1e-12)
    np.testing.assert_allclose(read.data["voltage"], made.VOLTAGE, atol=1e-5)


def test_the_two_files_of_one_measurement_belong_together(folder, tmp_path):
    with pytest.raises(InputError, match=r"rohde_schwarz.Wfm.bin: .*expected rohde_schwarz.bin, which describes"):
        open_file(folder / "rohde_schwarz.Wfm.bin").channels()
    alone = tmp_path / "alone.bin"
    alone.write_bytes((folder / "rohde_schwarz.bin").read_bytes())
    with pytest.raises(InputError, match=r"alone.Wfm.bin"):
        open_file(alone).channels()
