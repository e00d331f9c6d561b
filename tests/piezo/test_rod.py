"""The distributed rod against its equations: roots, sums, orthogonality, and a solution by the method of lines."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import TransferFunction, freqresp, lsim

from pdssjax import InputError, piezo
from pdssjax.core import quantities, to_si
from pdssjax.piezo import Modes, Rod, modes_needed, roots, step_response, truncation_error

modes, shapes = (jax.jit(function, static_argnums=1) for function in (piezo.modes, piezo.shapes))
truncation_transfer = jax.jit(piezo.truncation_transfer, static_argnums=(1, 3))
"""Compiled whole, not operation by operation."""
RATIOS = [0.0, 1e-6, 0.01, 0.3, 1.0, 24.7, 138.8, 1e4, 1e8]


def of_ratio(ratio: float, **others) -> Rod:
    """A rod of the nominal stack, 4 g, under a platform `ratio` times as heavy."""
    return Rod(platform_mass=0.004 * ratio, **others)


def lightly_damped(ratio: float) -> Rod:
    """First damping ratio 0.02, so that some ten modes ring."""
    rod = of_ratio(ratio)
    slow = float(modes(rod, 1).natural_frequency[0])
    return dataclasses.replace(rod, viscosity=0.04 * rod.modulus / slow)


@pytest.mark.parametrize("ratio", RATIOS)
def test_roots_solve_the_characteristic_equation_to_rounding(ratio):
    x = np.asarray(roots(ratio, 30))
    assert np.all(np.floor(x / math.pi) == np.arange(30)), "one root in each branch of the tangent"
    assert np.abs(x - math.pi * np.arange(30) - np.arctan2(1.0, ratio * x)).max() < 1e-12
    # As printed, beside the largest of its terms: sin x alone is off by the rounding of x.
    assert (np.abs(ratio * x * np.sin(x) - np.cos(x)) / (1.0 + ratio * x)).max() < 1e-12


def test_without_a_platform_the_rod_is_a_quarter_wave_resonator():
    np.testing.assert_allclose(roots(0.0, 12), math.pi * (np.arange(12) + 0.5), rtol=1e-15)
    found = modes(of_ratio(0.0), 3)
    speed = math.sqrt(Rod.modulus / Rod.density)
    np.testing.assert_allclose(found.natural_frequency, speed / Rod.length * math.pi * np.array([0.5, 1.5, 2.5]))
    np.testing.assert_allclose(found.mass, 0.004 / 2)


def test_under_a_heavy_platform_the_rod_is_a_spring_with_a_third_of_its_mass():
    for ratio in (1e3, 1e5):
        found = modes(of_ratio(ratio), 1)
        stiffness = Rod.modulus * Rod.area / Rod.length
        moving = 0.004 * (ratio + 1.0 / 3.0)
        # Rayleigh's estimate is off by the square of the small 1 / ratio.
        assert found.natural_frequency[0] == pytest.approx(math.sqrt(stiffness / moving), rel=0.1 / ratio**2 + 1e-13)
        assert found.mass[0] == pytest.approx(moving, rel=0.1 / ratio**2 + 1e-13)
        assert found.gain[0] == pytest.approx(Rod.strain * Rod.length, rel=0.1 / ratio**2 + 1e-13)
        damper = Rod.viscosity * Rod.area / Rod.length
        expected = damper / (2.0 * math.sqrt(stiffness * moving))
        assert found.damping_ratio[0] == pytest.approx(expected, rel=1e-6)


def test_a_negative_mass_has_no_modes_and_says_so():
    """By NaN where it is traced, else when the rod is made."""
    assert np.isnan(roots(-0.5, 3)).all()
    with pytest.raises(InputError, match="platform_mass"):
        of_ratio(-0.5)


def test_units_of_the_parameters_are_known_to_the_unit_reader():
    for name, declared in quantities(Rod).items():
        assert to_si(f"2 {declared.unit}", declared.unit, name) == 2.0


@pytest.mark.parametrize("ratio", [0.0, 0.3, 138.8])
def test_modes_are_orthogonal_with_the_mass_at_the_tip(ratio):
    rod, count = of_ratio(ratio), 5
    line = rod.density * rod.area

    def shape(i, y):
        return float(shapes(rod, count, np.array([y]))[i, 0])

    points, weights = np.polynomial.legendre.leggauss(60)
    positions, weights = rod.length * (points + 1.0) / 2.0, rod.length * weights / 2.0
    inside = np.asarray(shapes(rod, count, positions))
    tip = np.asarray(shapes(rod, count, np.array([rod.length])))
    mass = line * (inside * weights) @ inside.T + rod.platform_mass * tip @ tip.T
    scale = np.sqrt(np.outer(np.diag(mass), np.diag(mass)))
    assert np.abs((mass - np.diag(np.diag(mass))) / scale).max() < 1e-12
    np.testing.assert_allclose(np.diag(mass), modes(rod, count).mass, rtol=1e-11)
    # And once without the shared quadrature.
    spread = quad(lambda y: line * shape(1, y) ** 2, 0.0, rod.length, epsabs=0.0, epsrel=1e-10)[0]
    assert spread + rod.platform_mass == pytest.approx(float(modes(rod, 2).mass[1]), rel=1e-9)


@pytest.mark.parametrize("ratio", [0.0, 0.1, 1.0, 138.8])
def test_gains_sum_to_the_displacement_at_rest_and_the_rest_is_as_documented(ratio):
    rod, count = of_ratio(ratio), 1000
    missing = 1.0 - float(modes(rod, count).gain.sum() / rod.static_gain)
    expected = 2.0 / (math.pi**2 * count) if ratio == 0.0 else 2.0 / (3.0 * math.pi**4 * ratio**2 * count**3)
    assert missing == pytest.approx(expected, rel=2e-3, abs=1e-14)


def test_compliances_of_the_modes_sum_to_that_of_the_stack():
    rod = of_ratio(2.0)
    found = modes(rod, 1000)
    compliance = float((1.0 / (found.mass * found.natural_frequency**2)).sum())
    assert compliance == pytest.approx(rod.length / (rod.modulus * rod.area), rel=1e-9)


@pytest.mark.parametrize("damping", [0.01, 0.2083, 0.97, 1.0, 1.0 + 1e-9, 1.02, 3.0, 400.0])
def test_a_mode_of_any_damping_steps_like_its_transfer_function(damping):
    ones = jnp.ones(1)
    times = np.linspace(0.0, 20.0, 400)
    found = step_response(Modes(ones, ones, damping * ones, ones, ones), 1.0, times)
    system = TransferFunction([1.0], [1.0, 2.0 * damping, 1.0])
    np.testing.assert_allclose(found, lsim(system, np.ones_like(times), times)[1], atol=1e-9)
    assert step_response(Modes(ones, ones, damping * ones, ones, ones), 1.0, np.array([-1.0, 0.0])).tolist() == [
        0.0,
        0.0,
    ]


def test_high_modes_far_beyond_critical_damping_neither_overflow_nor_lose_their_gradient():
    rod = of_ratio(138.8)
    times = np.linspace(0.0, 0.1, 50)
    slope = jax.jacfwd(lambda e: step_response(modes(dataclasses.replace(rod, modulus=e), 200), 48.2, times))
    assert np.isfinite(slope(rod.modulus)).all()


@pytest.mark.parametrize("excitation", ["strain", "equal"])
def test_gradients_in_every_parameter_match_differences_both_ways(excitation):
    rod = of_ratio(5.0, excitation=excitation)
    names = list(quantities(Rod))
    start = np.log([getattr(rod, name) for name in names])
    times = np.linspace(0.0, 3e-3, 40)

    def tip(logs):
        numbers = dict(zip(names, jnp.exp(logs), strict=True))
        return step_response(modes(Rod(**numbers, excitation=excitation), 6), 48.2, times) * 1e6

    forward, reverse = jax.jit(jax.jacfwd(tip))(start), jax.jit(jax.jacrev(tip))(start)
    step = 1e-5
    quick = jax.jit(tip)
    pairs = [(quick(start + step * unit), quick(start - step * unit)) for unit in np.eye(len(names))]
    differences = np.stack([(high - low) / (2.0 * step) for high, low in pairs], axis=1)
    np.testing.assert_allclose(forward, differences, atol=1e-7)
    np.testing.assert_allclose(reverse, forward, atol=1e-12)


@pytest.mark.parametrize("ratio", [0.0, 0.3, 138.8, 1e6])
def test_slope_of_a_root_is_that_of_the_implicit_function(ratio):
    slope = jax.jacfwd(roots)(ratio, 4)
    x = np.asarray(roots(ratio, 4))
    # d(r x sin x - cos x) = 0, written with tan x = 1 / (r x)
    expected = -x / (1.0 + ratio + (ratio * x) ** 2)
    np.testing.assert_allclose(slope, expected, rtol=1e-12)
    if ratio:
        step = 1e-5 * ratio
        differences = (roots(ratio + step, 4) - roots(ratio - step, 4)) / (2.0 * step)
        np.testing.assert_allclose(slope * ratio, differences * ratio, atol=1e-9)


@pytest.mark.parametrize("kept", [0, 1, 4])
def test_truncation_error_is_the_full_sum_less_the_modes_kept(kept):
    rod, times = of_ratio(3.0), np.linspace(0.0, 3e-3, 50)
    whole = step_response(modes(rod, 200), 48.2, times)
    part = step_response(modes(rod, kept), 48.2, times) if kept else 0.0
    np.testing.assert_allclose(truncation_error(rod, kept, 48.2, times), whole - part, atol=1e-20)


def test_truncation_transfer_is_the_printed_sum_for_the_thesis_reading():
    rod = of_ratio(24.7, excitation="equal")
    first = modes(rod, 1)
    p = np.asarray(roots(24.7, 30)) / rod.length
    height = float(first.gain[0]) / math.sin(p[0] * rod.length)
    frequencies = np.geomspace(1e2, 1e7, 30)
    expected = np.zeros(30, complex)
    for pj in p[1:]:
        squared = rod.modulus * pj**2 / rod.density
        system = TransferFunction(
            [height * squared * math.sin(pj * rod.length)], [1.0, rod.viscosity * pj**2 / rod.density, squared]
        )
        expected += freqresp(system, frequencies)[1]
    np.testing.assert_allclose(truncation_transfer(rod, 1, frequencies, 30), expected, rtol=1e-9)


@pytest.mark.parametrize("ratio", [0.5, 24.7, 138.8])
def test_the_sum_of_all_modes_is_the_transfer_function_of_the_rod_in_closed_form(ratio):
    rod = of_ratio(ratio)
    frequencies = np.geomspace(10.0, 3e6, 40)
    s = 1j * frequencies
    stiffness = rod.modulus + rod.viscosity * s
    wave = s * np.sqrt(rod.density / stiffness)
    bend = np.tanh(wave * rod.length)
    push = rod.modulus * rod.area * rod.strain
    expected = push * bend / (stiffness * rod.area * wave + rod.platform_mass * s**2 * bend)
    found = truncation_transfer(rod, 0, frequencies, 2000)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())


def test_truncation_transfer_at_rest_is_the_truncation_error_long_after_the_step():
    rod = of_ratio(3.0)
    late = float(truncation_error(rod, 2, 48.2, np.array([1.0]))[0])
    assert 48.2 * float(truncation_transfer(rod, 2, np.array([0.0]), 200)[0].real) == pytest.approx(late, rel=1e-12)


@pytest.mark.parametrize("ratio", [0.1, 1.0, 24.7])
@pytest.mark.parametrize("error", [1e-7, 1e-9])
def test_the_number_of_modes_needed_is_the_smallest_that_keeps_the_error(ratio, error):
    rod = lightly_damped(ratio)
    times = np.linspace(0.0, 2e-3, 3000)
    needed = modes_needed(rod, error, 48.2, times)

    def peak(kept):
        return float(jnp.abs(truncation_error(rod, kept, 48.2, times)).max())

    assert peak(needed) <= error
    assert needed == 1 or peak(needed - 1) > error


@pytest.mark.slow
def test_the_default_times_miss_no_peak_of_the_error():
    rod = lightly_damped(0.5)
    times = np.linspace(0.0, 1e-3, 20001)
    peaks = [float(jnp.abs(truncation_error(rod, kept, 48.2, times)).max()) for kept in (1, 2, 3, 5)]
    for kept, peak in zip((1, 2, 3, 5), peaks, strict=True):
        assert modes_needed(rod, 1.01 * peak, 48.2) == kept


@pytest.mark.parametrize(
    ("call", "given"),
    [
        (lambda: modes(Rod(), 0), "got 0"),
        (lambda: roots(1.0, -1), "got -1"),
        (lambda: truncation_error(Rod(), -1, 48.2, np.zeros(1)), "got -1"),
        (lambda: truncation_error(Rod(), 200, 48.2, np.zeros(1)), "got 200"),
        (lambda: modes_needed(Rod(), 0.0, 48.2), "got 0.0"),
        (lambda: modes_needed(of_ratio(0.0), 1e-15, 48.2), "got 1e-15"),
    ],
)
def test_what_cannot_be_met_is_refused_with_the_number_given(call, given):
    with pytest.raises(InputError, match=given):
        call()


def test_nominal_rod_has_the_first_mode_of_the_step_tests():
    first = modes(Rod(), 1)
    assert Rod().mass == pytest.approx(0.004) and Rod().mass_ratio == pytest.approx(138.8)
    assert first.natural_frequency[0] == pytest.approx(6527.0, rel=1e-4)
    assert first.damping_ratio[0] == pytest.approx(0.2083, rel=1e-3)
    assert first.gain[0] == pytest.approx(4.93e-7 * math.sin(10.0 * 0.02), rel=1e-3)
