"""What records tell before any model is fitted."""

import pytest
from quick_blocks import example_study

from pdssjax.drive import base
from pdssjax.inference.initial_values.record_features import peak_bend


def test_a_drop_bends_the_voltage_by_its_height_and_rates_near_each_other_compile_once(monkeypatch):
    record = next(r for r in example_study().records if r.drive is not None and r.drive.cycle_frequency() is not None)
    sizes, voltage = [], base._at
    monkeypatch.setattr(base, "_at", lambda drive, time: sizes.append(time.size) or voltage(drive, time))
    for rate in (5000.0, 5010.0, 5100.0):
        # An ideal sawtooth drops by its voltage at once.
        assert peak_bend(record, rate, {}) == pytest.approx(record.drive.voltage * rate**2, rel=0.01)
    assert len(sizes) == 3 and len(set(sizes)) == 1
