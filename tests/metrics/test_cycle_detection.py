"""Cycles in arrays of samples: frequency, slips, and which flanks count."""

import numpy as np
import pytest

from pdssjax import InputError
from pdssjax.metrics.cycle_detection import (
    _best_sawtooth,
    _coarse_frequency,
    _line_of_slips,
    _sawtooth,
    _similar_flanks,
    _slips,
    find_cycles,
)

INTERVAL = 1e-3
TIME = np.arange(0.0, 4.0, INTERVAL)


def sawtooth(time, frequency, phase=0.0):
    """Rises by 1 in a period, and drops by 1 where frequency * time - phase is a whole number."""
    return np.mod(frequency * time - phase, 1.0)


@pytest.mark.parametrize(("frequency", "phase", "sign"), [(3.0, 0.3, 1.0), (7.3, 0.81, -1.0)])
def test_an_ideal_sawtooth_is_explained_by_itself(frequency, phase, sign):
    values = sign * sawtooth(TIME, frequency, phase)
    share, found, way = _sawtooth(TIME, values - values.mean(), frequency)
    # Twelve harmonics hold sum 1/h^2 of pi^2/6 of the variance; the phase is looked for on a grid of 256.
    assert share == pytest.approx(np.sum(1.0 / np.arange(1, 13) ** 2) / (np.pi**2 / 6.0), abs=0.01)
    assert found == pytest.approx(phase, abs=1.0 / 256)
    assert way == sign


@pytest.mark.parametrize("rest", [0.07, 0.2])
def test_a_drive_that_begins_after_a_rest_begins_without_a_slip(rest):
    time = 2e-4 * np.arange(2500)
    after = np.maximum(time - rest, 0.0)
    values = np.mod(20.0 * after, 1.0) + 0.2 * np.floor(20.0 * after)
    values = values + 0.005 * np.random.default_rng(6).normal(size=time.size)
    found = find_cycles(time, values, None, "here")
    assert found.seen == pytest.approx(20.0, abs=0.05) and found.seen_error < 0.02


@pytest.mark.parametrize("ratio", [0.5, 2.0, 3.0])
def test_a_multiple_of_the_frequency_explains_less(ratio):
    values = sawtooth(TIME, 5.0) - 0.5
    assert _sawtooth(TIME, values, ratio * 5.0)[0] < 0.6 * _sawtooth(TIME, values, 5.0)[0]


@pytest.mark.parametrize(
    ("multiples", "found"),
    # By the sum of 1/h: 1/2 + 1/3 is less than 1 at either line alone, 1/2 + 1/3 + 1/5 + 1/7 is more.
    [((2, 3), (10.0, 15.0)), ((2, 3, 5, 7), (5.0,))],
)
def test_lines_of_a_spectrum_weigh_as_the_harmonics_of_a_sawtooth(multiples, found):
    lines = sum(np.sin(2 * np.pi * 5.0 * multiple * TIME) for multiple in multiples)
    told = _coarse_frequency(TIME, np.asarray(lines), 0.4, 125.0)
    assert min(abs(told - frequency) for frequency in found) < 1.0 / (TIME[-1] - TIME[0])


@pytest.mark.parametrize("frequency", [1.7, 5.0, 23.0])
def test_the_spectrum_tells_the_frequency_to_a_bin_not_half_nor_twice(frequency):
    found = _coarse_frequency(TIME, sawtooth(TIME, frequency) - 0.5, 0.4, 125.0)
    assert found == pytest.approx(frequency, abs=1.0 / (TIME[-1] - TIME[0]))


def test_the_best_sawtooth_is_found_under_a_steady_walk():
    share, frequency, phase, sign = _best_sawtooth(TIME, sawtooth(TIME, 6.1, 0.4) + 2.5 * TIME, None, 0.4, 125.0)
    assert frequency == pytest.approx(6.1, rel=1e-3)
    assert (phase, sign) == (pytest.approx(0.4, abs=0.01), 1.0)
    assert share > 0.9


def test_slips_are_located_between_the_samples_beside_them():
    true = np.arange(1, 20) / 5.0 + 0.0123
    values = sawtooth(TIME, 5.0, 5.0 * 0.0123)
    found = _slips(TIME, values, 5.0, true + 0.004, 1.0)
    np.testing.assert_allclose(found, true, rtol=0.0, atol=1.5 * INTERVAL)


def test_a_slip_beyond_the_record_or_cut_off_by_its_edge_is_not_there():
    # The drops at 0.003 s and 3.997 s lie within the record, but not with all that is beside them.
    at_edges = sawtooth(TIME, 5.0, 0.015) + sawtooth(TIME, 5.0, 4.985)
    assert np.isnan(_slips(TIME, at_edges, 5.0, np.array([-0.2, 0.003, 3.997, 4.2]), 1.0)).all()


def test_a_line_through_slips_gives_period_start_and_an_honest_error():
    random = np.random.default_rng(2)
    expected = 1.0 + np.arange(12) / 5.0
    noise = lambda: random.normal(0.0, 2e-3, expected.size)
    runs = [_line_of_slips(1.003 + np.arange(12) / 5.02 + noise(), expected, 5.0, 1e-4) for _ in range(300)]
    frequencies, starts, errors = np.array(runs).T
    assert frequencies.mean() == pytest.approx(5.02, abs=4 * frequencies.std() / np.sqrt(300))
    assert starts.mean() == pytest.approx(1.003, abs=4 * starts.std() / np.sqrt(300))
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(frequencies.std(), rel=0.15)


def test_slips_seen_between_two_samples_are_as_uncertain_as_that_however_well_they_fit():
    expected = np.arange(9) / 5.0
    error = _line_of_slips(expected, expected, 5.0, 1e-3)[2]
    # A uniform error of one interval has the variance interval^2 / 12; of the numbers -4 to 4 the squares sum to 60.
    assert error == pytest.approx(5.0**2 * 1e-3 / np.sqrt(12 * 60), rel=1e-12)


def test_what_lies_far_from_the_others_is_no_slip():
    expected = np.arange(10) / 5.0
    slips = expected.copy()
    slips[4] += 0.02  # a tenth of a period late
    slips[7] = np.nan
    frequency, start, error = _line_of_slips(slips, expected, 5.0, 1e-9)
    assert frequency == pytest.approx(5.0, rel=1e-12)
    assert start == pytest.approx(0.0, abs=1e-12)
    assert error < 1e-6


def test_without_two_slips_nothing_is_known_of_the_frequency():
    frequency, start, error = _line_of_slips(np.array([1.01, np.nan]), np.array([1.0, 1.2]), 5.0, 1e-3)
    assert (frequency, start, error) == (5.0, pytest.approx(1.01), np.inf)


def test_flanks_unlike_the_others_are_left_out():
    values = sawtooth(TIME, 5.0)
    values[TIME < 1.0] *= 0.1  # five flanks before the drive is on in full
    values[TIME >= 3.0] = 0.0  # it ends at 3 s
    np.testing.assert_array_equal(_similar_flanks(TIME, values, 5.0, 0.0, 20), np.arange(5, 15))


def test_a_larger_motion_before_the_drive_does_not_hide_its_flanks():
    values = sawtooth(TIME, 5.0)
    values[TIME < 0.2] *= 15.0  # a stage that is put down, say
    np.testing.assert_array_equal(_similar_flanks(TIME, values, 5.0, 0.0, 20), np.arange(1, 20))
    values[TIME >= 0.2] *= 0.01  # but a drift after a single large motion is no drive
    assert len(_similar_flanks(TIME, values, 5.0, 0.0, 20)) < 2


@pytest.mark.parametrize("given", [None, 5.0])
@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_cycles_are_found_whatever_the_spacing_of_the_samples(given, jitter):
    random = np.random.default_rng(1)
    time = TIME + jitter * INTERVAL * random.random(TIME.size)
    values = 3e-6 * sawtooth(time, 5.0, 0.25) + 1e-8 * random.normal(size=time.size)
    found = find_cycles(time, values, given, "here")
    assert found.frequency == pytest.approx(5.0, rel=1e-4) if given is None else found.frequency == given
    assert abs(found.seen - 5.0) < 5 * found.seen_error
    assert found.seen_error < 1e-3
    # The slips are at 0.05 s + n / 5 s: 20 of them, with 19 whole flanks between, of which the last only tells a slip.
    assert found.start == pytest.approx(0.05, abs=2e-3)
    assert (found.count, found.falls) == (18, False)
    assert found.fit > 0.9


@pytest.mark.parametrize(
    ("frequency", "said"),
    [(0.2, "found the frequency 0.2 Hz"), (400.0, "found the frequency 400 Hz"), (7.9, "found no cycles")],
)
def test_a_frequency_that_the_record_cannot_show_is_refused(frequency, said):
    with pytest.raises(InputError, match=said):
        find_cycles(TIME, sawtooth(TIME, 5.0) * 1e-6, frequency, "here")


def test_too_few_samples_are_refused():
    with pytest.raises(InputError, match="expected more: 8 in each of two cycles"):
        find_cycles(TIME[:9], sawtooth(TIME[:9], 500.0), None, "here")
