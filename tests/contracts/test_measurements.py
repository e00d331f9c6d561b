"""A contract that every measurement keeps, found by itself: told, read, predicted, differentiated, made."""

import functools

import jax
import jax.numpy as jnp
import measured_study
import numpy as np
import pytest

from pdssjax import Study, load_study
from pdssjax.cli.main import main
from pdssjax.core import factor
from pdssjax.study import MOVING, Samples, make_recordings

VARIANTS = measured_study.variants()
every = pytest.mark.parametrize("measurement", VARIANTS, ids=measured_study.label)


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    """The study of a measurement, planned, loaded once."""
    folder = tmp_path_factory.mktemp("planned")

    @functools.cache
    def load(name):
        measurement = next(variant for variant in VARIANTS if measured_study.label(variant) == name)
        file = folder / f"{name}.toml"
        file.write_text(measured_study.study(measured_study.record(measurement)))
        return load_study(file, virtual=True)

    return lambda measurement: load(measured_study.label(measurement))


@every
def test_columns_have_units_and_are_shown_in_units_of_the_same_kind(measurement):
    first, *between, last = measurement.columns.items()
    assert first == ("time", "s")
    assert set(between) <= {("motion", "m"), ("velocity", "m/s")}
    assert [quantity for quantity, _ in between] == [measurement.prescribed] * len(between)
    assert last == (measurement.quantity, measurement.unit)
    assert factor(measurement.unit, measurement.unit, "") == pytest.approx(1.0)
    display = measurement.display
    assert display.scale * factor(display.unit, measurement.unit, "") == pytest.approx(1.0)
    assert display.quantity and display.plural


@every
def test_the_parts_that_move_are_parts_of_a_study(measurement, planned):
    parts = measurement.parts()
    assert parts and parts <= MOVING
    assert parts <= {path.split(".")[0] for path in planned(measurement).legal()}
    assert measurement.driven == (measurement.prescribed is None)
    assert measurement.effector_moves <= bool(measurement.at_a_jump())


@every
def test_what_moves_has_to_be_listed_and_nothing_else(measurement, tmp_path):
    paths = {path for path in measured_study.PARAMETERS if path.split(".")[0] in measurement.parts()}
    text = measured_study.study(measured_study.record(measurement))
    lines = [line for line in text.splitlines() if not line.startswith('"') or line.split('"')[1] in paths]
    (tmp_path / "study.toml").write_text("\n".join(lines))
    assert set(load_study(tmp_path / "study.toml", virtual=True).parameters) == paths


@every
def test_a_planned_record_has_the_keys_and_columns_told(measurement, planned):
    (record,) = planned(measurement).records
    assert record.measurement == measurement
    assert record.measures == measurement.name
    assert (record.drive is not None) == measurement.driven
    assert (record.motion is not None) == (measurement.prescribed is not None)


@every
def test_what_is_told_before_a_fit_has_a_number_for_every_sample_or_is_not_told(measurement):
    time = np.linspace(-0.01, 0.1, 200)
    samples = Samples(time, np.sin(time), np.where(time < 0, 0.0, 1.0), None)
    for told in (measurement.displacement(samples), measurement.force(samples)):
        assert told is None or (told.shape == time.shape and np.isfinite(told).all())


def dear(measurement):
    """Slow where `tests/integration/test_sensitivities.py` judges the motion of the same system, or a walk is held."""
    marks = pytest.mark.slow if measurement.driven and not measurement.platform_alone else ()
    return pytest.param(measurement, marks=marks, id=measured_study.label(measurement))


@pytest.mark.parametrize("measurement", [dear(variant) for variant in VARIANTS])
def test_a_record_is_predicted_with_right_derivatives(measurement, planned):
    study = planned(measurement)
    values = {path: jnp.asarray(number) for path, number in study.values().items()}
    moving = [path for path in values if path.split(".")[0] in measurement.parts()]
    # A parameter each its own part, so that none hides behind another.
    shares = {path: 0.3 + 0.7 * k / len(moving) for k, path in enumerate(moving)}
    tangent = {path: shares.get(path, 0.0) * value for path, value in values.items()}

    @jax.jit
    def shown_and_slope(by):
        """One program for both."""
        at = {path: value + by * tangent[path] for path, value in values.items()}
        return jax.jvp(lambda values: study.predict(values)[0], (at,), (tangent,))

    shown, slope = shown_and_slope(0.0)
    assert np.isfinite(shown).all() and float(np.ptp(shown)) > 0.0
    step = 1e-6
    moved = lambda by: np.asarray(shown_and_slope(by)[0])
    differences = (moved(step) - moved(-step)) / (2.0 * step)
    wrong = np.abs(np.asarray(slope) - differences)
    # Where an event falls between the two, a difference straddles it.
    assert np.mean(wrong > 1e-4 * np.abs(differences).max()) < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("measurement", [m for m in VARIANTS if m.effector_free and m.driven], ids=measured_study.label)
def test_a_contact_that_sticks_below_a_ringing_platform_is_seen_as_if_every_moment_were_stepped(measurement, tmp_path):
    """A platform so heavy that it feels no friction moves as one without feedback, but no closed form is used."""
    record = measured_study.record(measurement, measured_study.SLOW_FALL)
    seen = []
    for place, kind in enumerate(({}, {"feedback": True, "mass": "1e9 kg"})):
        file = tmp_path / f"{place}.toml"
        file.write_text(measured_study.study(record, sticks=True, **kind))
        seen.append(np.asarray(load_study(file, virtual=True).predict()[0]))
    assert np.ptp(seen[0]) > 0.0
    # Where the acceleration jumps, a sample may fall between the two instants.
    assert np.mean(np.abs(seen[0] - seen[1]) > 1e-5 * np.ptp(seen[0])) < 0.01


@every
def test_a_virtual_rig_makes_the_record_and_it_is_read_back(measurement, planned, tmp_path, monkeypatch):
    """Of a made-up prediction: those of the model are judged above."""
    study = planned(measurement)
    size = 5.0 / measurement.display.scale
    made_up = lambda study: [jnp.asarray(size * np.sin(300.0 * record.time)) for record in study.records]
    monkeypatch.setattr(Study, "predict", made_up)
    (made,) = make_recordings(study, 1)
    assert main(["record", str(study.path), "--out", str(tmp_path / "out"), "--seed", "1"]) == 0
    (record,) = load_study(tmp_path / "out" / "records" / study.path.name).records
    assert record.measurement == measurement
    scale = np.abs(made.record.measured).max()
    np.testing.assert_allclose(record.measured, made.record.measured, rtol=0.0, atol=1e-8 * scale)
    if record.motion is not None:
        np.testing.assert_allclose(record.motion, made.record.motion, rtol=1e-8, atol=1e-15)
