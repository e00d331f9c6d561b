"""The experiments on performance (chapters 2 and 3) give their key numbers; whole programs are behind `slow`."""

import jax.numpy as jnp
import numpy as np
import pytest

from experiments import (
    friction_tests,
    isotropic_anisotropic,
    output_force,
    performance,
    published,
    reconciliation,
    rival_models,
)


def test_the_published_speeds_and_efficiencies_imply_a_stroke_2_and_5_per_cent_below_the_published_gain():
    rows = isotropic_anisotropic.consistency()
    assert [row.difference for row in rows] == ["-1.97 %", "-4.84 %"]


@pytest.mark.slow
def test_the_published_parameters_walk_much_better_in_direction_a_than_measured():
    found = isotropic_anisotropic.calculate("deflection")
    np.testing.assert_allclose(found.efficiency, [0.8861, 0.1900, 0.5337, 0.5337], atol=2e-4)
    np.testing.assert_allclose(found.speed[[0, 2]], [28.55e-6, 17.20e-6], rtol=1e-3)
    assert found.efficiency[0] > 1.7 * published.WALKS[0].efficiency


def test_no_normal_force_reconciles_both_coefficients_with_both_breakaway_forces():
    need_a, need_b = friction_tests.reconciling()
    assert (need_a, need_b) == pytest.approx((1.609, 1.263), abs=1e-3)
    # The ratio of the forces over the ratio of the coefficients, whatever presses.
    assert need_a / need_b == pytest.approx((0.7964 / 0.5458) / (0.495 / 0.432))
    assert friction_tests.weight() == pytest.approx(0.8434, abs=1e-4)


@pytest.mark.slow
def test_a_static_platform_throws_the_end_effector_back_by_what_newton_says():
    """Coulomb's force F accelerates it for the fall time tf and stops it again: F tf^2 / m, but for the slow flank."""
    pohl = rival_models.rivals()[0]
    fall = 0.5e-3
    cycles = rival_models.calculate(pohl, (0.0, fall))
    force, mass = published.law(published.ISOTROPIC).f_ss_a, pohl.actuator.effector.mass
    back = published.STROKE - cycles[fall, 1.0].net_step
    # The platform creeps on during the slip, at which it ends a little sooner.
    creep = published.STROKE / (rival_models.PERIOD - fall)
    assert back == pytest.approx(force / mass * fall**2, abs=3.0 * creep * fall)
    assert cycles[0.0, 1.0].efficiency == pytest.approx(1.0, abs=1e-6), "a jump carries nothing along"
    assert cycles[fall, -1.0].net_step == pytest.approx(cycles[fall, 1.0].net_step, rel=1e-6)


@pytest.mark.slow
def test_a_sensor_that_stops_the_end_effector_feels_the_breakaway_force_and_a_softer_one_less():
    stiff, softer = output_force.calculate("force", [3e6, 1e5], 4).steady[1, 0]
    assert stiff == pytest.approx(0.7964, rel=5e-3)
    assert softer < 0.7 * stiff


@pytest.mark.slow
def test_the_walks_of_the_fit_are_those_of_the_experiment_where_the_parameters_are_the_published_ones():
    predicted = np.asarray(performance.walks(jnp.zeros(len(performance.PARAMETERS)), "deflection"))
    np.testing.assert_allclose(predicted[:4], [88.61, 19.00, 53.37, 53.37], atol=0.02)
    np.testing.assert_allclose(predicted[4:], 0.01 * predicted[[0, 2]] * 1e6 * published.STROKE * 5.0, rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("reading", published.READINGS)
def test_a_fall_of_some_tenths_of_a_millisecond_reconciles_the_walks_and_less_anisotropy_than_published(reading):
    case = next(s for s in reconciliation.CASES if s.name == reconciliation.WALKS_ALONE)
    found, _ = reconciliation.best(case, reading)
    assert found.chi2 < found.degrees
    assert 0.4 < found.values[performance.FALL] < 0.9
    assert 80.0 < found.values[performance.MASS] < 110.0
    assert 1.15 < found.values[performance.F_A] / found.values[performance.F_B] < 1.42
    assert reconciliation.gradient_error(found, reading) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize(
    "experiment",
    [friction_tests, isotropic_anisotropic, output_force, rival_models, reconciliation],
    ids=lambda module: module.NAME,
)
def test_experiments_write_their_table_and_their_figure(experiment, elsewhere):
    experiment.main()
    out = elsewhere / "out/experiments"
    assert (out / f"{experiment.NAME}.png").read_bytes().startswith(b"\x89PNG")
    assert "| thesis | ours | difference | why |" in (out / f"{experiment.NAME}.md").read_text(encoding="utf-8")
