"""A sweep is many single runs, labelled: each point is its own simulation, and one that fails says so."""

import dataclasses
import itertools

import jax
import numpy as np
import pytest
import xarray
from parts import AnisotropicLuGre, Cycloidal, Sawtooth, SecondOrder, Sine, Triangle
from quick_blocks import study as study

import pdssjax
from pdssjax import Accuracy, Actuator, InputError, InputWarning, Taylor
from pdssjax.cli.main import main
from pdssjax.cli.option_values import read_axis
from pdssjax.files import EXAMPLE, write_sweep
from pdssjax.sweeps import Listed, find_border

UM, QUICK = 1e6, Accuracy(method=Taylor(8))
GRID = {"drive.voltage": [30.0, 64.0, 75.0], "drive.frequency": [5.0, 23.0], "friction.f_ss_a": [0.5, 0.8]}
FURTHER = ("peak_friction", "reversals", "settled", "grazing")


@pytest.fixture(scope="module")
def data(study):
    return pdssjax.sweep(study, GRID, metrics=FURTHER, workers=2, accuracy=QUICK)


@jax.jit
def walked(voltage, frequency, f_ss_a):
    """End-effector, relative velocity and friction force in the fourth cycle and at three phases of the next."""
    actuator = Actuator(SecondOrder(), AnisotropicLuGre(f_ss_a=f_ss_a))
    phases = np.append(3.0 + np.linspace(0.0, 1.0, 40_001)[1:-1], [4.2, 4.5, 4.8])
    run = pdssjax.simulate(actuator, Sawtooth(voltage, frequency), phases / frequency, QUICK)
    return run.effector, run.platform_velocity - run.effector_velocity, run.friction


def test_every_point_agrees_with_its_own_single_run(data):
    for voltage, frequency, f_ss_a in itertools.product(*GRID.values()):
        point = data.sel(drive_voltage=voltage, drive_frequency=frequency, friction_f_ss_a=f_ss_a)
        motion = np.asarray(walked(voltage, frequency, f_ss_a)[0])
        # At the middle and the ends of the fitted part of the slow flank, and at the middle of the next.
        low, middle, high, following = UM * motion[[7_999, 19_999, 31_999, -2]]
        assert float(point.net_step) * UM == pytest.approx(following - middle, abs=1e-3)
        assert float(point.stroke) * UM == pytest.approx((high - low) / 0.6, abs=3e-3)
        assert float(point.speed) == pytest.approx(float(point.net_step) * frequency)
        assert float(point.efficiency) == pytest.approx(float(point.net_step / point.stroke))
        assert float(point.back_slip) == pytest.approx(float(point.stroke - point.net_step))


def test_further_metrics_are_those_of_a_single_run_sampled_densely(study):
    drives = {"drive.voltage": [64.0, 120.0], "drive.frequency": [50.0, 150.0], "friction.f_ss_a": [0.7964, 0.7]}
    data = pdssjax.sweep(study, Listed(drives), metrics=FURTHER, workers=2, accuracy=QUICK)
    assert not data.failure.any() and (data.settled == 0).all()
    for i, numbers in enumerate(zip(*drives.values(), strict=True)):
        _, velocity, friction = (np.asarray(part)[:-3] for part in walked(*numbers))
        # The drop turns the motion by its jump at the opening, which the samples begin behind.
        turns = np.count_nonzero(np.diff(np.sign(velocity)))
        assert float(data.reversals[i]) in (turns, turns + 1)
        assert float(data.peak_friction[i]) == pytest.approx(np.abs(friction).max(), rel=1e-5)
        assert 0.0 < float(data.grazing[i]) <= 1.0


def test_points_are_labelled_with_units_and_say_what_was_held(data):
    assert dict(data.sizes) == {"drive_voltage": 3, "drive_frequency": 2, "friction_f_ss_a": 2}
    assert data.drive_voltage.attrs["units"] == "V" and data.net_step.attrs["units"] == "m"
    assert data.attrs["piezo.gain"] == pytest.approx(1.007e-7)
    assert not data.failure.any()


def test_a_point_that_fails_is_nan_and_says_why(study):
    # A contact that yields within an atom's width takes more steps than there is room for.
    data = pdssjax.sweep(study, GRID | {"friction.f_ss_a": [0.8, 1e-9]}, workers=2, accuracy=QUICK)
    assert not data.failure.sel(friction_f_ss_a=0.8).any() and data.failure.sel(friction_f_ss_a=1e-9).all()
    failed = data.failure.values != 0
    assert np.isnan(data.net_step.values[failed]).all() and np.isfinite(data.net_step.values[~failed]).all()
    assert "ran out of steps" in data.failure.attrs["meanings"]


def driven_by(study, drive):
    """The study with that drive in its first record whose end-effector moves, alone."""
    record = next(record for record in study.records if record.measurement.effector_free)
    return dataclasses.replace(study, records=(dataclasses.replace(record, drive=drive, overrides={}),))


# By default strokes of straight flanks are held against single runs.
@pytest.mark.slow
def test_the_stroke_of_a_curved_flank_is_what_is_moved_along_it(study):
    """A straight line through the middle of a cycloid is twice as steep, and made 1.6 times the stack's stroke of it.

    The referee reads the stroke off the motion, from the ring-down's end to the drop.
    """
    drive = Cycloidal(60.0, 5.0)
    data = pdssjax.sweep(driven_by(study, drive), {"drive.voltage": [60.0]})
    actuator = Actuator(SecondOrder(), AnisotropicLuGre())
    time = np.linspace(0.6, 0.8, 4001)[:-1]
    motion = np.asarray(pdssjax.simulate(actuator, drive, time).effector)
    along = np.polyfit(np.asarray(drive.at(time))[800:3200], motion[800:3200], 1)[0]
    assert float(data.stroke[0]) == pytest.approx(along * 60.0, rel=2e-3)
    assert float(data.stroke[0]) == pytest.approx(1.007e-7 * 60.0, rel=0.02)
    assert float(data.efficiency[0]) == pytest.approx(float(data.net_step[0] / data.stroke[0]))


@pytest.mark.slow
def test_a_cycle_without_a_slow_and_a_fast_flank_has_no_stroke(study):
    with pytest.warns(InputWarning, match="without a slow and a fast flank: stroke, back-slip and efficiency are NaN"):
        data = pdssjax.sweep(driven_by(study, Triangle(60.0, 5.0, 0.998)), {"drive.voltage": [60.0]})
    assert not data.failure.any() and float(data.net_step[0]) > 1e-7
    assert float(data.speed[0]) == pytest.approx(5.0 * float(data.net_step[0]))
    assert all(np.isnan(data[name]).all() for name in ("stroke", "back_slip", "efficiency"))
    with (
        pytest.warns(InputWarning),
        pytest.raises(InputError, match=r'found the metric "efficiency", expected one that a drive without a slow'),
    ):
        find_border(driven_by(study, Sine(60.0, 5.0)), "drive.voltage", (20.0, 80.0), {}, tolerance=1.0)


@pytest.mark.slow
def test_a_fast_flank_counts_the_same_whether_duty_or_fall_time_makes_it(study):
    over = {"drive.duty": [0.8, 1.0], "drive.fall_time": [0.0, 0.04]}
    coarse = Accuracy(tolerance=1e-9, method=Taylor(4))
    data = pdssjax.sweep(study, over, cycles=2, accuracy=coarse)
    by_duty, by_fall = data.sel(drive_duty=0.8, drive_fall_time=0.0), data.sel(drive_duty=1.0, drive_fall_time=0.04)
    for name in ("stroke", "net_step", "back_slip"):
        assert float(by_duty[name]) == pytest.approx(float(by_fall[name]), rel=1e-9, abs=1e-15)


def test_progress_is_told_block_by_block_and_the_cycle_is_the_same_without_further_metrics(study, data):
    told = []
    plain = pdssjax.sweep(study, GRID, accuracy=QUICK, progress=lambda done, count: told.append((done, count)))
    assert told[-1] == (12, 12)
    np.testing.assert_array_equal(data.net_step, plain.net_step)
    assert data.peak_friction.attrs["units"] == "N" and data.reversals.attrs["units"] == "1"


@pytest.mark.parametrize(
    ("over", "essential"),
    [
        ({"drive.voltag": [1.0]}, 'did you mean "drive.voltage"'),
        ({"drive.frequency": [0.0]}, "above 0"),
        ({"drive.frequency": []}, "expected some values"),
        ({"drive.frequency": [np.nan]}, "finite"),
        ({"drive.frequency": np.arange(1.0, 1e6), "drive.voltage": np.arange(1.0, 1e6)}, "GB of memory"),
    ],
)
def test_what_cannot_be_swept_is_refused(study, over, essential):
    with pytest.raises(InputError, match="sweep") as refused:
        pdssjax.sweep(study, over)
    assert essential in str(refused.value)


def test_a_study_without_a_walk_is_refused(study):
    steps = dataclasses.replace(study, records=study.records[:1])
    with pytest.raises(InputError, match="expected one whose drive to vary"):
        pdssjax.sweep(steps, {})
    with pytest.raises(InputError, match="did you mean"):
        pdssjax.sweep(study, {}, record="5 Hz C")


def test_axes_are_read_with_units_and_spacing(study):
    legal = study.legal()
    np.testing.assert_allclose(read_axis("drive.fall_time", "0 ms:2 ms:3", legal), [0.0, 1e-3, 2e-3])
    np.testing.assert_allclose(read_axis("drive.frequency", "1:100:3:log", legal), [1.0, 10.0, 100.0])
    np.testing.assert_allclose(read_axis("drive.voltage", "64 V", legal), [64.0])


@pytest.mark.parametrize(
    "text",
    ["1:2", "1:2:0", "1:2:x", "1:2:3:lin", "1:2:100000000000", "0:2:3:log", "1 kg:2 kg:3", "a:b:3", "1:2:²", "1e400"],
)
def test_an_axis_at_fault_is_refused(study, text):
    with pytest.raises(InputError, match=r"drive\.voltage"):
        read_axis("drive.voltage", text, study.legal())


def test_the_command_writes_a_dataset_and_a_map(tmp_path, capsys, monkeypatch, data):
    monkeypatch.setitem(vars(pdssjax), "sweep", lambda study, over, **how: data)
    arguments = ["sweep", str(EXAMPLE / "study.toml"), "--voltage", "30:75:3", "--vary", "friction.f_ss_a=0.5:0.8:2"]
    assert main([*arguments, "--out", str(tmp_path)]) == 0
    assert "average speed" in capsys.readouterr().out
    with xarray.open_dataset(tmp_path / "sweep.nc", engine="scipy") as kept:
        xarray.testing.assert_allclose(kept, data)
        assert kept.net_step.attrs == data.net_step.attrs
    assert (tmp_path / "sweep.png").stat().st_size > 10_000
    assert main([*arguments, "--out", str(tmp_path)]) == 2
    assert main([*arguments[:-1], "friction.f_ss_a", "--out", str(tmp_path / "new")]) == 2
    assert "--vary" in capsys.readouterr().err


def test_the_dataset_can_be_kept_as_zarr_that_opens_without_a_warning(tmp_path, data):
    write_sweep(data, tmp_path / "out", "zarr")
    with xarray.open_zarr(tmp_path / "out" / "sweep.zarr") as kept:
        assert kept.attrs.pop("digest")
        xarray.testing.assert_identical(kept.load(), data)
        assert kept.net_step.attrs == data.net_step.attrs


def test_a_store_that_is_not_installed_is_refused_before_the_sweep(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    monkeypatch.setitem(vars(pdssjax), "sweep", lambda *given, **how: pytest.fail("swept for nothing"))
    out = tmp_path / "out"
    command = ["sweep", str(EXAMPLE / "study.toml"), "--voltage", "30:75:3", "--store", "zarr"]
    assert main([*command, "--out", str(out)]) == 2
    assert "--store" in capsys.readouterr().err and not out.exists()
