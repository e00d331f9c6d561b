"""Fits start where the records' voltage, motion and sampling say, whatever the member."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from fabricated import step_motion

from pdssjax import Accuracy, InputError, Record
from pdssjax.actuator import PARTS
from pdssjax.core import member, members, quantities
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.drive.sine import Sine
from pdssjax.drive.step import Step
from pdssjax.drive.triangle import Triangle
from pdssjax.inference import guess_starts
from pdssjax.inference.initial_values import search
from pdssjax.study import Models, Parameter, Predictor, predicted

SIZES = [(3.6, 2e-3), (64.0, 6e-6), (1000.0, 5e-9)]
"""Voltages, and how far the platform goes [m]."""
ELECTRONICS = "amplifier.bandwidth", "amplifier.slew", "sensor.bandwidth"
LAWS = members("friction")
PIEZOS = members("piezo")


def record(name, drive, time, measured, measures="platform"):
    measurement = member("study.measurement", measures)()
    return Record(name, None, "fit", measurement, drive, frozenset(), time, measured, None, None)  # pyright: ignore[reportArgumentType]


def stretched(volts, stroke, samples=250, until=0.25):
    """A platform that goes up and down with the voltage, and after it a step."""
    time = np.linspace(0.0, until, samples)
    loop = Triangle(voltage=volts, frequency=2.0 / until)
    return record("loop", loop, time, stroke / volts * np.asarray(loop.at(time)))


def free(models, *families):
    """All parameters of the members, free and without a start."""
    chosen = {family: getattr(models, family) for family in families}
    declared = {f"{family}.{name}": q for family, model in chosen.items() for name, q in quantities(model).items()}
    return {path: Parameter(path, q.unit, q) for path, q in declared.items() if path != "piezo.mass"}


def choose(piezo="second-order", friction="coulomb"):
    return Models(member("piezo", piezo), member("friction", friction), "deflection", False)


def moved(predictor, values):
    """What the one record shows; numbers as arrays, which are not compiled anew."""
    numbers = {path: np.asarray(number) for path, number in values.items()}
    return np.asarray(predicted(predictor, numbers, Accuracy())[0])


def legal(starts, parameters):
    for path, number in starts.items():
        declared = parameters[path].quantity
        assert math.isfinite(number) and declared.low <= number < declared.high, path
        assert number > 0.0 or not declared.positive, path


@pytest.mark.parametrize("piezo", PIEZOS)
def test_every_start_of_a_stack_is_legal_and_has_the_gain_that_the_records_show(piezo):
    models = choose(piezo)
    parameters = free(models, "piezo")
    for volts, stroke in SIZES:
        starts, _ = guess_starts(models, parameters, [stretched(volts, stroke)])
        legal(starts, parameters)
        found = models.actuator(starts).piezo
        assert found.broken_conditions() == ()
        assert float(found.static_gain()) == pytest.approx(stroke / volts, rel=0.1)


INTEGRATED = [pytest.param(p, marks=[] if member("piezo", p).closed else [pytest.mark.slow]) for p in PIEZOS]


@pytest.mark.parametrize("piezo", INTEGRATED)
def test_every_parameter_of_a_stack_shows_where_a_fit_of_it_starts(piezo):
    models = choose(piezo)
    parameters = free(models, "piezo")
    for volts, stroke in SIZES:
        posed = stretched(volts, stroke)
        starts, _ = guess_starts(models, parameters, [posed])
        predictor = Predictor(models, [posed])
        motion = lambda values, predictor=predictor: moved(predictor, values)
        reached = motion(starts)
        assert np.ptp(reached) == pytest.approx(stroke, rel=0.4), (volts, stroke)
        for path, number in starts.items():
            # What begins at zero is a voltage before the record.
            change = motion(starts | {path: 1.1 * number if number else 0.1 * volts}) - reached
            # Ringing and damping hardly show in a slow loop, and no loop tells a peak before; what is not linear must.
            linear = path.removeprefix("piezo.") in ("natural_frequency", "damping_ratio", "creep_time", "initial_peak")
            linear |= piezo == "distributed-rod"
            # An element without weight begins at a thousandth of the gain, and slow creep shows a part of its tenth.
            assert linear or np.ptp(change) > 1e-5 * stroke, (path, volts, stroke)


def test_elements_of_maxwell_slip_do_slip_at_a_small_voltage():
    models = choose("maxwell-slip")
    starts, _ = guess_starts(models, free(models, "piezo"), [stretched(3.6, 5e-7)])
    thresholds = [starts[f"piezo.threshold_{i}"] for i in range(1, 5)]
    assert 0.0 < min(thresholds) < 0.3
    assert max(thresholds) < 0.5 * 3.6


def test_a_rod_starts_with_the_mode_that_a_step_shows():
    gain, rate, damping = 4e-6, 900.0, 0.15
    time = np.arange(-0.01, 0.2, 2e-4)
    ring, elapsed = rate * math.sqrt(1.0 - damping**2), np.maximum(time, 0.0)
    fade = np.exp(-damping * rate * elapsed) * (np.cos(ring * elapsed) + damping * rate / ring * np.sin(ring * elapsed))
    models = choose("distributed-rod")
    starts, _ = guess_starts(models, free(models, "piezo"), [record("s", Step(3.0), time, 3.0 * gain * (1.0 - fade))])
    piezo = models.actuator(starts).piezo
    assert float(piezo.static_gain()) == pytest.approx(gain, rel=0.05)
    assert float(piezo.modes.natural_frequency[0]) == pytest.approx(rate, rel=0.1)
    assert float(piezo.modes.damping_ratio[0]) == pytest.approx(damping, rel=0.1)


POWERS = {
    "N": (1, 1, -2),
    "m": (0, 1, 0),
    "m/s": (0, 1, -1),
    "N/m": (1, 0, -2),
    "N s/m": (1, 0, -1),
    "N/s": (1, 1, -3),
    "": (0, 0, 0),
}
"""Of mass, length and time in the units of the laws' parameters."""


@pytest.mark.parametrize("law", LAWS)
def test_ranges_of_a_law_scale_with_mass_motion_and_time(law):
    model = member("friction", law)
    mass, acceleration, rate = 0.086, 300.0, 6736.0
    before = model.search_ranges(mass, acceleration, rate)
    assert set(before) == set(quantities(model))
    for power, after in enumerate(
        [
            model.search_ranges(10.0 * mass, acceleration, rate),
            model.search_ranges(mass, 10.0 * acceleration, rate),
            model.search_ranges(mass, acceleration / 100.0, rate / 10.0),
        ]
    ):
        for name, declared in quantities(model).items():
            factor = 10.0 ** POWERS[declared.unit][power]
            np.testing.assert_allclose(after[name], np.multiply(before[name], factor), err_msg=name)


def walk(volts, stroke, interval=1e-3, drive=None):
    """An end-effector that walks by a quarter of its stroke in every period of 0.2 s."""
    drive = drive or Sawtooth(voltage=volts, frequency=5.0)
    time = np.arange(0.2, 1.2, interval)
    follows = stroke / volts * np.asarray(drive.at(time))
    return record("walk", drive, time, follows + 1.25 * stroke * time, "effector")


@pytest.mark.parametrize("law", LAWS)
def test_a_contact_starts_with_forces_that_go_with_the_motion(law):
    models = choose(friction=law)
    parameters = free(models, "piezo", "friction")
    forces = {}
    for (volts, stroke), interval in itertools.product(SIZES, (1e-3, 2e-2)):
        starts, searched = guess_starts(models, parameters, [walk(volts, stroke, interval)])
        legal(starts, parameters)
        assert searched
        for path, number in starts.items():
            if parameters[path].unit == "N":
                forces.setdefault(path, []).append(number / stroke)
    for path, ratios in forces.items():
        assert max(ratios) < 3.0 * min(ratios), path


def test_a_contact_under_a_voltage_without_jumps_starts_with_weaker_forces():
    models = choose()
    parameters = free(models, "piezo", "friction")
    force = lambda posed: guess_starts(models, parameters, [posed])[0]["friction.f_c"]
    sharp = force(walk(64.0, 6e-6))
    assert force(walk(64.0, 6e-6, drive=Sawtooth(64.0, 5.0, 1e-3))) == pytest.approx(sharp / 6.736, rel=0.05)
    # A sine of 100 Hz accelerates the platform by C V/2 (2 pi f)^2 once it is on its way.
    assert force(walk(64.0, 6e-6, drive=Sine(64.0, 100.0))) < 0.1 * sharp


@pytest.mark.parametrize("slower", [1.0, 20.0, 0.05])
def test_amplifier_and_sensor_start_where_they_change_what_a_platform_of_any_speed_shows(slower):
    models, rate = choose(), 6700.0
    listed = free(models, "piezo")
    parts = {f"{part}.{name}": q for part, kind in PARTS.items() for name, q in quantities(kind).items()}
    electronics = {path: Parameter(path, q.unit, q) for path, q in parts.items() if path in ELECTRONICS}
    time = slower * np.arange(-1e-3, 2e-2, 2e-5)
    shown = record("step", Step(voltage=60.0), time, step_motion(time, 6e-6, rate / slower, 0.15))
    starts, _ = guess_starts(models, listed | electronics, [shown])
    ringing = rate / (2.0 * math.pi * slower)
    assert starts["piezo.natural_frequency"] == pytest.approx(rate / slower, rel=0.05)
    assert 3.0 * ringing < starts["amplifier.bandwidth"] < 10.0 * ringing
    assert 0.3 * ringing < starts["sensor.bandwidth"] < 3.0 * ringing
    # Below it the platform still follows the jump in a few of its periods, beyond it nothing limits what it sees.
    assert 60.0 * ringing / 3.0 < starts["amplifier.slew"] < 60.0 * ringing * 3.0
    known = {"piezo.natural_frequency": dataclasses.replace(listed["piezo.natural_frequency"], start=2.0 * rate)}
    given, _ = guess_starts(models, listed | electronics | known, [shown])
    assert given["sensor.bandwidth"] == pytest.approx(min(2.0 * rate / (2.0 * math.pi), 0.25 / (2e-5 * slower)))


def test_a_slow_record_of_a_step_does_not_make_up_a_frequency():
    time = np.arange(0.0, 10.0, 0.01)
    noisy = 6e-6 * (time > 0) + np.random.default_rng(1).normal(0.0, 1e-8, time.size)
    models = choose()
    starts, _ = guess_starts(models, free(models, "piezo"), [record("slow", Step(60.0), time, noisy)])
    assert starts["piezo.gain"] == pytest.approx(1e-7, rel=0.02)
    assert starts["piezo.natural_frequency"] > 100.0


@pytest.mark.parametrize("drive", [Step(48.2), Sawtooth()])
def test_a_clock_in_unix_time_is_refused(drive):
    good = stretched(48.2, 5e-6)
    late = dataclasses.replace(good, drive=drive, time=good.time + 1.7e9)
    with pytest.raises(InputError, match=r"1\.7e\+09 s"):
        guess_starts(choose(), free(choose(), "piezo"), [late])


def scattered(monkeypatch, models, parameters, records, around, held=(), **how):
    """What `scatter_starts` finds where chi-square is the distance from `around`, on logarithmic scales."""

    distance = lambda trial: sum(np.log(trial[path] / around[path]) ** 2 for path in trial if trial[path] > 0.0)
    monkeypatch.setattr(search, "_trial_costs", lambda *given: np.array([distance(trial) for trial in given[-1]]))
    found = search.scatter_starts(models, parameters, records, around, held, **how)
    return found, [path for path in parameters if len({start[path] for start in found}) > 1]


def test_scattered_starts_differ_in_all_that_is_free_and_positive_and_the_best_come_first(monkeypatch):
    models = choose(friction="simplified-lugre")
    parameters = free(models, "piezo", "friction")
    gain, bound = parameters["piezo.gain"], parameters["friction.f_ss"]
    parameters["piezo.gain"] = dataclasses.replace(gain, low=0.9e-7)  # above a factor of 1.5 below
    parameters["friction.f_ss"] = dataclasses.replace(bound, start=0.5, high=0.6)
    parameters["piezo.damping_ratio"] = dataclasses.replace(parameters["piezo.damping_ratio"], value=0.2)
    around = {path: p.value or p.start or p.quantity.nominal for path, p in parameters.items()}
    around["piezo.gain"] = 1e-7
    posed = [walk(64.0, 6e-6)]
    starts, searched = scattered(monkeypatch, models, parameters, posed, around, ["piezo.natural_frequency"])
    assert len(starts) == search.TRIALS and set(searched) == set(parameters) - {
        "piezo.damping_ratio",
        "piezo.natural_frequency",
    }
    values = {path: np.array([begun[path] for begun in starts]) for path in parameters}
    for path in parameters:
        if path in searched:
            assert len(np.unique(values[path])) == search.TRIALS, path
        else:
            assert (values[path] == around[path]).all(), path
    # No range of its own: a factor either way, within the bounds.
    assert 0.9e-7 <= values["piezo.gain"].min() < 0.905e-7 and 1.49e-7 < values["piezo.gain"].max() <= 1.5e-7
    # A range of the law's, whatever the start given, within the bounds.
    law = guess_starts(models, parameters, posed)[0]["friction.sigma0"]
    assert values["friction.sigma0"].min() < 0.5 * law and values["friction.sigma0"].max() > 2.0 * law
    assert values["friction.f_ss"].max() <= 0.6
    costs = sum(np.log(values[path] / around[path]) ** 2 for path in searched)
    assert (np.diff(costs) > -1e-9).all()


@pytest.mark.parametrize("high", [None, 2.0])
def test_forces_are_scattered_up_to_where_nothing_slips_under_the_shortest_fall(monkeypatch, high):
    monkeypatch.setattr(search, "TRIALS_OF_ONE", search.TRIALS)  # the highest of them is near the end of the range
    models = choose()
    parameters = free(models, "piezo", "friction")
    fall = Parameter("drive.fall_time", "s", quantities(Sawtooth)["fall_time"], low=1e-4)
    parameters |= {fall.path: fall, "friction.f_c": dataclasses.replace(parameters["friction.f_c"], high=high)}
    gain, rate, mass = 1e-7, 6000.0, 0.2
    around = {path: p.quantity.nominal for path, p in parameters.items()}
    around |= {"piezo.gain": gain, "piezo.natural_frequency": rate, "effector.mass": mass, fall.path: 3e-3}
    held = [path for path in parameters if path.startswith("piezo.")]
    time = np.arange(0.0, 0.6, 1e-3)
    posed = [record("walk", Sawtooth(64.0, 5.0), time, 6e-6 * time, "effector")]
    highest = lambda **how: max(
        begun["friction.f_c"] for begun in scattered(monkeypatch, models, parameters, posed, around, held, **how)[0]
    )
    # A platform's peak acceleration where the voltage falls at once, nearly reached where it takes 0.6 / rate.
    largest = mass * 64.0 * gain * rate**2
    assert highest(to_sticking=True) == pytest.approx(high or largest, rel=0.03)
    assert highest() < 0.06 * largest


def test_nothing_is_scattered_without_a_record_of_the_contact_or_anything_free(monkeypatch):
    models = choose()
    parameters = free(models, "piezo", "friction")
    around = {path: p.quantity.nominal for path, p in parameters.items()}
    for records, held in [([stretched(64.0, 6e-6)], []), ([walk(64.0, 6e-6)], list(parameters))]:
        assert scattered(monkeypatch, models, parameters, records, around, held)[0] == []


def test_only_records_to_be_fitted_are_searched_with_where_there_are_some(monkeypatch):
    models = choose()
    parameters = free(models, "piezo", "friction")
    around = {path: p.quantity.nominal for path, p in parameters.items()}
    kept = dataclasses.replace(walk(64.0, 6e-6), role="validate")
    assert len(scattered(monkeypatch, models, parameters, [kept], around)[0]) == search.TRIALS
    assert scattered(monkeypatch, models, parameters, [kept, stretched(64.0, 6e-6)], around)[0] == []
