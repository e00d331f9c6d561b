"""Monte Carlo experiments on errors: they can be killed and run again, and cover what the documentation says."""

import concurrent.futures
import dataclasses

import numpy as np
import pytest

from experiments import (
    common,
    error_coverage,
    error_propagation,
    linear_draws,
    moved_stack,
    three_ways,
    three_ways_report,
    wrong_law,
)
from experiments.draws import run_tasks
from experiments.three_ways import SCENARIOS, WAYS

TASKS = {f"root-{n:02d}": (n,) for n in range(12)}


def seeded(number: int) -> dict[str, float]:
    """A draw that costs nothing; at the top of its module, so that other processes find it."""
    return {"number": float(np.random.default_rng(number).standard_normal())}


class Immediately(concurrent.futures.Executor):
    """Runs what it is given at once, and is killed at its last."""

    def __init__(self, last: int = 1000):
        self.left, self.done = last, []

    def submit(self, task, /, *arguments, **named):
        if not self.left:
            raise KeyboardInterrupt
        self.left -= 1
        future = concurrent.futures.Future()
        future.set_result(task(*arguments, **named))
        self.done.append(arguments)
        return future


def files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_a_run_that_was_killed_ends_as_if_it_had_not_been(tmp_path):
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    assert run_tasks(TASKS, seeded, whole, Immediately()) == 12
    with pytest.raises(KeyboardInterrupt):
        run_tasks(TASKS, seeded, broken, Immediately(5), ahead=2)
    (broken / "root-07.unfinished").write_text('{"arguments": "(7', encoding="utf-8")
    (broken / "root-01.json").write_text('{"arguments": "(1', encoding="utf-8")
    again = Immediately()
    run_tasks(TASKS, seeded, broken, again, ahead=2)
    assert (1,) in again.done and (0,) not in again.done
    assert files(whole) == files(broken)
    assert run_tasks(TASKS, seeded, broken, Immediately(0)) == 0


def test_bias_spread_and_coverage_are_those_of_known_errors():
    random = np.random.default_rng(1)
    error = np.expm1(0.02 + 0.1 * random.standard_normal((4000, 1)))
    said = np.full((4000, 1), 0.1)
    cell = three_ways_report.Cell("x", "peaks", error, error / 2, said, said / 2, np.ones(4000, bool))
    assert cell.bias[0] == pytest.approx(0.02, abs=0.005)
    assert cell.spread[0] == pytest.approx(0.1, rel=0.06)
    assert cell.covered(said, [0]) == pytest.approx(0.95, abs=0.01)
    assert cell.covered(said / 2, [0]) == pytest.approx(0.67, abs=0.02)
    row = three_ways_report.bias_table([cell], ["friction.sigma0"]).splitlines()[-1]
    assert row == f"| x | peaks | {100 * cell.bias[0]:+.1f} ({50 * cell.bias[0]:+.1f}) |"


@pytest.mark.parametrize(
    ("scenario", "sequential", "peaks"),
    [
        (SCENARIOS[0], 0.0, 0.003),
        (SCENARIOS[1], 0.0, 0.0),
        (SCENARIOS[4], -0.0603, -0.0396),
        (SCENARIOS[5], -0.0119, -0.0087),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_a_sample_of_delay_is_six_per_cent_of_the_frequency_for_least_squares_and_four_for_peaks(
    scenario, sequential, peaks
):
    """And the friction follows the stack as the matrix says: the walks' Jacobian here is made up."""
    random = np.random.default_rng(8)
    jacobian = 100.0 * random.standard_normal((300, 9))
    found = linear_draws.predicted(scenario, jacobian, 4)
    assert np.mean(found["sequential"][:, 1]) == pytest.approx(sequential, abs=2e-4)
    assert np.mean(found["peaks"][:, 1]) == pytest.approx(peaks, abs=6e-3)
    matrix = -np.linalg.pinv(jacobian[:, 3:]) @ jacobian[:, :3]
    apart = found["peaks"] - found["sequential"]
    np.testing.assert_allclose(apart[:, 3:], apart[:, :3] @ matrix.T, atol=1e-12)


@pytest.mark.slow
def test_the_monte_carlo_at_a_small_size_gives_its_table_and_figure_and_resumes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PDSSJAX_FIGURES", raising=False)
    chosen = SCENARIOS[0], SCENARIOS[4]
    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        cells = error_propagation.monte_carlo(2, chosen, pool)
    again = error_propagation.monte_carlo(2, chosen, Immediately(0))
    paths = list(three_ways.rig_of(chosen[0]).problem.residual.transform.paths)
    assert three_ways_report.table(cells, paths) == three_ways_report.table(again, paths)
    assert {(cell.scenario, cell.way) for cell in cells} == {(s.name, way) for s in chosen for way in WAYS}
    by = {(cell.scenario, cell.way): cell for cell in cells}
    rate = paths.index("piezo.natural_frequency")
    assert np.all(np.abs(by[chosen[0].name, "sequential"].error[:, rate]) < 1e-3)
    assert np.all(by[chosen[1].name, "peaks"].error[:, rate] < -0.03), "a sample late is 4 % of the frequency"
    late = by[chosen[1].name, "sequential"]
    assert np.all(np.sign(late.carried[:, 3:]) == np.sign(late.carried[:1, 3:])), "the same in every draw"
    assert np.all(by[chosen[0].name, "peaks"].said[:, 3:] > by[chosen[0].name, "peaks"].naive[:, 3:])
    with common.styled():
        assert common.save(three_ways_report.draw(cells, paths), "small").exists()


@pytest.mark.slow
def test_a_stack_moved_a_little_moves_the_friction_as_the_amplification_says():
    """Every entry within 2 %; the friction starts at the truth, to which the records are exact."""
    rig = three_ways.rig_of(SCENARIOS[0])
    problem = three_ways.with_measured(rig.problem, list(rig.motions))
    # Large beside what a fit leaves at its end, a thousandth of a standard error; central, so that bends cancel; and
    # small beside the bends by the gain, which moves friction by up to a hundred times as much.
    truth = three_ways.known_truth()
    little = {path: 2e-4 if path == "piezo.gain" else 5e-4 for path in moved_stack.BETWEEN}
    ways = [
        [moved_stack.follow(path, problem, truth, {path: 1.0 + way * step}, 1) for path, step in little.items()]
        for way in (1, -1)
    ]
    moves, steps = ways[0], np.array(list(little.values()))
    linear = np.stack([moved.linear for moved in moves], axis=1) / steps
    ends = [np.stack([moved.refitted[-1] for moved in side], axis=1) for side in ways]
    refitted = (ends[0] - ends[1]) / (2.0 * steps)
    np.testing.assert_allclose(refitted, linear, rtol=0.02)
    np.testing.assert_allclose(moves[0].base, [truth[path] for path in moves[0].paths], rtol=1e-6)


def test_it_counts_and_draws():
    few = error_coverage.SITUATIONS[1]._replace(scattered=True)
    found = {"few": error_coverage.coverage(few, 2)}
    assert found["few"].shape == (2, 3, 4)
    assert len(error_coverage.rows(found)) == 6
    error_coverage.draw(found).draw_without_rendering()


@pytest.mark.slow  # a minute a situation
@pytest.mark.parametrize("situation", error_coverage.SITUATIONS, ids=lambda situation: situation.name)
def test_the_pseudo_true_parameters_are_covered_whatever_the_misfit_and_the_colour(situation):
    pseudo, physical = error_coverage.coverage(situation, 150)
    white, coloured, whole = pseudo
    assert np.all((coloured > 0.90) & (coloured < 0.99))  # 0.95 within three standard deviations of chance
    assert np.all(whole >= coloured)
    if situation.correlation:
        assert white.min() < 0.86
    if situation.name == "smooth":
        assert np.all((physical[2] > 0.90) & (physical[2] < 0.99))
        assert np.all(physical[1] < 0.7)


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
