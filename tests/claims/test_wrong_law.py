"""A wrong law, a wrong voltage and coloured noise: how the experiment makes them and counts what errors cover."""

import dataclasses

import numpy as np
import pytest

from experiments import wrong_law


@pytest.fixture
def study(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return wrong_law.planned("lugre", wrong_law.RIGHT)


def test_the_voltage_falls_in_a_time_and_rings_on(study):
    step, forward, backward = map(wrong_law.ringing, study.records)
    assert step.drive == study.records[0].drive
    period = 1.0 / wrong_law.FREQUENCY
    for record, ends in ((forward, (1.0, 0.0)), (backward, (0.0, 1.0))):
        times, volts = record.drive.times, record.drive.voltages
        plain = dataclasses.replace(
            next(r for r in study.records if r.name == record.name).drive, fall_time=wrong_law.FALL
        ).at(times)
        ring = (volts - plain) / wrong_law.VOLTAGE
        after = (times > 2 * period) & (times < 3 * period) & (ring != 0.0)
        assert times[after][0] > 2 * period + wrong_law.FALL
        first = np.argmax(np.abs(ring[after]))
        # On beyond the end of the flank, first, by what decays in a quarter of a cycle.
        assert np.sign(ring[after][first]) == ends[1] - ends[0]
        assert 0.05 < np.abs(ring[after]).max() < wrong_law.OVERSHOOT
        at = lambda t, times=times, volts=volts: volts[np.flatnonzero(np.isclose(times, t))[0]] / wrong_law.VOLTAGE
        assert (at(2 * period), at(2 * period + wrong_law.FALL)) == pytest.approx(ends)
    first = forward.drive.times < period
    assert np.all(np.diff(forward.drive.voltages[first]) > 0.0), "the first cycle rises only"


def test_neighbouring_noise_is_alike():
    noise = wrong_law.coloured(200_000, np.random.default_rng(0)) / wrong_law.NOISE
    assert np.std(noise) == pytest.approx(1.0, rel=0.02)
    assert np.mean(noise[1:] * noise[:-1]) == pytest.approx(wrong_law.CORRELATION, rel=0.02)


def test_coverage_is_counted_by_model_and_parameter():
    random = np.random.default_rng(1)
    told = lambda: [1.0 + 0.1 * random.standard_normal(), 0.05, 0.1, 0.2]
    results = [
        {"pseudo": {"a": 1.0, "b": 1.0}, "converged": True, "parameters": {"a": told(), "b": told()}}
        for _ in range(3000)
    ]
    np.testing.assert_allclose(wrong_law.coverage(results), [[0.673] * 2, [0.95] * 2, [0.9999] * 2], atol=0.03)
    rows = {row.name: row for row in wrong_law.rows(results)}
    assert list(rows)[:2] == ["a: white, coloured, with-misfit", "a: with misfit over coloured"]
    assert rows["a: with misfit over coloured"].ours == pytest.approx(2.0)
    # What the last model covers follows from how much wider it is than the one that is right.
    for ratio, follows in wrong_law.widths(results).values():
        assert (ratio, follows) == (pytest.approx(2.0), pytest.approx(0.9999, abs=1e-4))
