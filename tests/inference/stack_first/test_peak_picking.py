"""Peaks of a step response give the system back, as well as sampling and noise allow, and say how well that is."""

import dataclasses
import math

import numpy as np
import pytest
from marks import slow
from platform_study import DAMPING, GAIN, NOISE_LINE, PLATFORM, RATE, write_platform
from record_tables import step_table

import pdssjax
from pdssjax import InputError
from pdssjax.core import quantities
from pdssjax.inference import pick_peaks
from pdssjax.inference.initial_values.step_peaks import Extremes, extremes, one_mode
from pdssjax.inference.stack_first.peak_picking import PATHS, PEAKS
from pdssjax.piezo.distributed_rod import DistributedRod

TRUTH = np.array([GAIN, RATE, DAMPING])
SEEN = PLATFORM.replace('"friction.sigma0" = {}', '"friction.sigma0" = { value = 1e6 }')


def response(gain, rate, damping, voltage, time):
    """The closed form of the step response (4.2), written down apart from the package [m]."""
    ring = rate * math.sqrt(1.0 - damping**2)
    phase = math.atan2(math.sqrt(1.0 - damping**2), damping)
    elapsed = np.maximum(time, 0.0)
    wave = np.exp(-damping * rate * elapsed) * np.sin(ring * elapsed + phase) / math.sin(phase)
    return gain * voltage * (1.0 - wave)


@pytest.fixture(scope="module")
def platform(tmp_path_factory):
    return pdssjax.load_study(write_platform(tmp_path_factory.mktemp("platform"), SEEN))


def stepped(study, truth, interval, noise, voltages=(50.0,), seed=0, end=0.035, begin=-0.005):
    """The study with records of steps sampled every `interval` [s], with noise [m]."""
    random = np.random.default_rng(seed)
    time = interval * np.arange(round(begin / interval), round(end / interval) + 1)
    records = []
    for number, voltage in enumerate(voltages):
        measured = response(*truth, voltage, time) + 3e-7 + noise * random.standard_normal(time.size)
        drive = dataclasses.replace(study.records[0].drive, voltage=voltage)
        new = {"name": f"step {number}", "time": time, "measured": measured, "drive": drive, "noise": noise or 1e-12}
        records.append(dataclasses.replace(study.records[0], **new))
    return dataclasses.replace(study, records=tuple(records))


def errors(study, truth):
    """Of the logarithms of what is picked, in the order of `PATHS`."""
    return np.log(np.array([pick_peaks(study).values[path] for path in PATHS]) / truth)


@pytest.mark.parametrize("damping", [0.02, 0.1772, 0.3])
@pytest.mark.parametrize("count", [2, 3, PEAKS])
def test_exact_extremes_give_the_system_back(damping, count):
    n = np.arange(1, count + 1)
    ratio = math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2))
    times = n * math.pi / (RATE * math.sqrt(1.0 - damping**2))
    found = one_mode(Extremes(times, 5e-6 * (1.0 - (-ratio) ** n)))
    np.testing.assert_allclose([found.final, found.natural_frequency, found.damping_ratio], [5e-6, RATE, damping], 1e-9)


def test_extremes_are_samples_highs_and_lows_in_turn():
    time = 1e-5 * np.arange(-100, 2000)
    found = extremes(time, response(*TRUTH, 50.0, time), PEAKS)
    n = np.arange(1, PEAKS + 1)
    exact = n * math.pi / (RATE * math.sqrt(1.0 - DAMPING**2))
    assert np.all(np.abs(found.times - exact) <= 0.5e-5 + 1e-12)
    assert np.all(np.diff(found.heights) * (-1.0) ** n[:-1] > 0)


@pytest.mark.parametrize("interval", [50e-6, 10e-6, 1e-6])
@pytest.mark.parametrize("damping", [0.1, 0.1772, 0.25])
def test_without_noise_the_truth_is_found_to_what_half_a_sample_allows(platform, interval, damping):
    """A peak is seen up to d = interval/2 off, and by y'' = K w^2 a^n too low by up to K w^2 a^n d^2 / 2.

    The half period, a mean of t_n / n, is off by d mean(1/n) at most; damping and final value follow heights whose
    relative loss is below (w d)^2 / 2 of their distance from the final value.
    """
    off, loss = 0.5 * interval, 0.5 * (RATE * 0.5 * interval) ** 2
    for shift in np.linspace(-0.02, 0.02, 7):
        truth = TRUTH * np.array([1.0, 1.0 + shift, 0.0]) + [0.0, 0.0, damping]
        gain, rate, ratio = errors(stepped(platform, truth, interval, 0.0), truth)
        half = math.pi / (truth[1] * math.sqrt(1.0 - damping**2))
        decrement = math.pi * damping / math.sqrt(1.0 - damping**2)
        # A distance too short by a share s moves its logarithm by s; the decrement is the mean of log/n and log 1.
        worst = math.log1p(-loss) / -decrement
        assert abs(gain) < loss + 1e-9
        assert abs(ratio) < 2.0 * worst + 1e-9
        assert abs(rate) < off / half * np.mean(1.0 / np.arange(1, PEAKS + 1)) * 1.02 + 2.0 * worst * damping**2 + 1e-9


@pytest.mark.parametrize(("interval", "noise"), [(50e-6, 1e-8), slow(10e-6, 1e-8), slow(50e-6, 5e-8)])
def test_errors_are_those_of_a_monte_carlo_over_noise_and_the_place_between_samples(platform, interval, noise):
    """Its 120 readings know an error to some 7 %; that of what is read once scatters itself."""
    random = np.random.default_rng(4)
    found, said = [], []
    for seed in range(120):
        truth = TRUTH * [1.0, 1.0 + 0.05 * random.uniform(-1.0, 1.0), 1.0]
        study = stepped(platform, truth, interval, noise, (40.0, 60.0), seed)
        found.append(errors(study, truth))
        if seed % 30 == 0:
            said.append(np.diag(pick_peaks(study).covariance))
    ratio = np.sqrt(np.mean(np.square(found), axis=0) / np.mean(said, axis=0))
    assert np.all((ratio > 0.8) & (ratio < 1.25)), ratio


def test_what_was_measured_apart_is_combined_with_the_peaks(platform):
    study = stepped(platform, TRUTH, 50e-6, 1e-8)
    alone = pick_peaks(study)
    told = {"piezo.gain": (1.001 * GAIN, 1e-4 * GAIN), "piezo.damping_ratio": (DAMPING, 0.02)}
    declared = {
        path: dataclasses.replace(study.parameters[path], start=number, standard_error=error)
        for path, (number, error) in told.items()
    }
    found = pick_peaks(dataclasses.replace(study, parameters=study.parameters | declared))
    # Weighted least squares of both, all at once.
    information, right = np.linalg.inv(alone.covariance), np.linalg.solve(alone.covariance, np.log(alone.read))
    for path, (number, error) in told.items():
        place = PATHS.index(path)
        information[place, place] += (number / error) ** 2
        right[place] += (number / error) ** 2 * np.log(number)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(information), rtol=1e-6, atol=1e-15)
    logarithms = np.log([found.values[path] for path in PATHS])
    np.testing.assert_allclose(logarithms, np.linalg.solve(information, right), rtol=1e-9)


def test_more_records_do_not_help_where_a_peak_lies_between_samples(platform):
    deviation = lambda voltages: np.sqrt(np.diag(pick_peaks(stepped(platform, TRUTH, 5e-5, 1e-9, voltages)).covariance))
    np.testing.assert_allclose(deviation((50.0,)), deviation((50.0, 60.0, 70.0)), rtol=0.1)
    assert deviation((50.0,))[1] > 3e-3


def test_where_noise_alone_counts_more_records_do_help(platform):
    # At 1 um of noise a peak wanders over hundreds of samples of 1 us.
    deviation = lambda voltages: np.sqrt(np.diag(pick_peaks(stepped(platform, TRUTH, 2e-6, 4e-8, voltages)).covariance))
    single, four = deviation((50.0,)), deviation((50.0,) * 4)
    assert 1.7 < single[1] / four[1] < 2.3


@pytest.mark.parametrize(("voltage", "offset"), [(-50.0, None), (50.0, 3e-7)])
def test_a_step_down_and_a_zero_that_is_known_are_read_as_well(platform, voltage, offset):
    study = stepped(platform, TRUTH, 1e-6, 0.0, (voltage,))
    study = dataclasses.replace(study, records=(dataclasses.replace(study.records[0], offset=offset),))
    np.testing.assert_allclose(errors(study, TRUTH), 0.0, atol=1e-3)


def refusal(study):
    with pytest.raises(InputError) as caught:
        pick_peaks(study)
    message = str(caught.value)
    assert message.count("\n") == 0 and "expected" in message and "found" in message
    return message


@pytest.mark.parametrize(
    ("truth", "how", "said"),
    [
        (TRUTH, dict(end=0.0006), 'record "step 0": found 0.6 ms after the step'),
        ([GAIN, RATE, 0.95], {}, "found no ringing above its noise of 0.01 um"),
        ([GAIN, RATE, 0.9999], {}, "found no ringing above its noise of 0.01 um"),
        (TRUTH, dict(noise=1e-6), "record too noisy"),
        (TRUTH, dict(interval=3e-4), "do not show the ringing"),
        (TRUTH * [1e-6, 1.0, 1.0], {}, "no motion above its noise"),
        (TRUTH, dict(begin=0.0001), "found its first sample 0.1 ms after the step, expected some before it"),
    ],
)
def test_a_record_that_shows_no_peaks_is_named_with_the_reason(platform, truth, how, said):
    assert said in refusal(stepped(platform, truth, **(dict(interval=5e-5, noise=1e-8) | how)))


_DELAYED = '"sensor.delay" = { value = 0 }\n"sensor.delay@warm" = { value = "9 us", standard_error = "5 us" }'
"""As `pdssjax new` writes it of a step between two samples."""


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            'waveform = "step", voltage = "50 V"',
            'waveform = "sine", voltage = "50 V", frequency = "100 Hz"',
            "ideal step",
        ),
        ('voltage = "50 V"', 'voltage = "50 V", rise_time = "1 ms"', "ideal step"),
        ('measures = "platform"', 'measures = "platform"\nrole = "validate"', "no fitted record"),
        ('"friction.sigma0"', '"sensor.bandwidth" = {}\n"friction.sigma0"', 'found "sensor.bandwidth"'),
        ('"friction.sigma0"', '"drive.rise_time" = { value = "0.1 ms" }\n"friction.sigma0"', 'found "drive.rise_time"'),
        ('"friction.sigma0"', _DELAYED + '\n"friction.sigma0"', 'found "sensor.delay@warm"'),
        ('"piezo.gain" = {}', '"piezo.gain" = {}\n"piezo.gain@warm" = {}', 'found "piezo.gain@warm"'),
        ('"piezo.gain" = {}', '"piezo.gain" = { start = 1e-8, max = 2e-8 }', "within its bounds, 0 to 2e-08"),
        ('piezo = "second-order"', 'piezo = "second-order"\nfeedback = true', "found feedback = true"),
    ],
)
def test_what_peaks_cannot_be_picked_from_is_said_in_a_line(tmp_path, old, new, said):
    text = SEEN.replace(old, new)
    assert text != SEEN
    if "warm" in new:
        text = text.replace('noise = "0.01 um"', 'noise = "0.01 um"\nconditions = ["warm"]')
    if "feedback" in new:
        text = text.replace(
            "[parameters]", '[parameters]\n"piezo.mass" = { value = 0.5 }\n"effector.mass" = { value = 0.1 }'
        )
    assert said in refusal(pdssjax.load_study(write_platform(tmp_path, text)))


def test_what_bends_other_records_or_nothing_leaves_peaks_as_they_are(tmp_path, platform):
    begun = "[parameters]\n" + _DELAYED.replace("warm", "later") + '\n"drive.rise_time" = { value = 0 }\n'
    later = step_table(NOISE_LINE).replace('name = "step"', 'name = "later"\nrole = "validate"\nconditions = ["later"]')
    text = SEEN.replace("[parameters]\n", begun) + later
    found = pick_peaks(pdssjax.load_study(write_platform(tmp_path, text)))
    assert found.values == pick_peaks(platform).values


def test_a_rod_has_more_than_one_mode(tmp_path):
    text = SEEN.replace('"second-order"', '"distributed-rod"')
    for name in ("gain", "natural_frequency", "damping_ratio"):
        text = text.replace(f'"piezo.{name}" = {{}}\n', "")
    study = pdssjax.load_study(
        write_platform(tmp_path, text.replace("[parameters]", "[parameters]\n" + rod_parameters()))
    )
    assert 'found piezo = "distributed-rod", expected "second-order"' in refusal(study)


def rod_parameters() -> str:
    return "\n".join(f'"piezo.{name}" = {{}}' for name, q in quantities(DistributedRod).items() if not q.optional)


def test_a_stack_that_is_given_leaves_nothing_to_pick(platform):
    fixed = platform.with_values(dict(zip(PATHS, TRUTH, strict=True)))
    assert "found none of piezo.gain" in refusal(fixed)
