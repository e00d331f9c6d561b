"""The Monte Carlo behind the thesis's question can be killed and run again, on any executor; its numbers hold."""

import concurrent.futures
import json

import numpy as np
import pytest

from experiments import common, error_propagation, linear_draws, moved_stack, three_ways, three_ways_report
from experiments.draws import read_tasks, run_tasks
from experiments.three_ways import SCENARIOS, WAYS, Scenario

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


def test_results_of_other_arguments_do_not_count(tmp_path):
    run_tasks(TASKS, seeded, tmp_path, Immediately())
    changed = TASKS | {"root-03": (30,)}
    again = Immediately()
    assert run_tasks(changed, seeded, tmp_path, again) == 1
    assert again.done == [(30,)]
    results = dict(read_tasks(changed, tmp_path))
    assert results["root-03"] == seeded(30) and results["root-04"] == seeded(4)


def test_any_executor_gives_the_same_and_no_more_is_asked_of_it_than_may_be(tmp_path):
    run_tasks(TASKS, seeded, tmp_path / "one", Immediately())
    with concurrent.futures.ThreadPoolExecutor(3) as pool:
        counted = Counted(pool)
        run_tasks(TASKS, seeded, tmp_path / "threads", counted, ahead=4)
    assert files(tmp_path / "one") == files(tmp_path / "threads")
    assert counted.most <= 4


class Counted(concurrent.futures.Executor):
    """Hands on to another executor, and counts what is not finished."""

    def __init__(self, inner):
        self.inner, self.futures, self.most = inner, [], 0

    def submit(self, task, /, *arguments, **named):
        self.futures.append(self.inner.submit(task, *arguments, **named))
        self.most = max(self.most, sum(not future.done() for future in self.futures))
        return self.futures[-1]


def test_a_task_that_fails_ends_the_run_and_leaves_what_was_done(tmp_path):
    def fails(number: int) -> dict[str, float]:
        if number == 4:
            raise ArithmeticError("four")
        return seeded(number)

    with concurrent.futures.ThreadPoolExecutor(1) as pool, pytest.raises(ArithmeticError, match="four"):
        run_tasks(TASKS, fails, tmp_path, pool, ahead=1)
    assert sorted(files(tmp_path)) == [f"root-{n:02d}.json" for n in range(4)]
    with pytest.raises(FileNotFoundError, match=r"root-04\.json: found no result"):
        list(read_tasks(TASKS, tmp_path))


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


def test_the_scenarios_differ_in_what_they_say_and_share_their_noise():
    assert len({s.name for s in SCENARIOS}) == len(SCENARIOS)
    assert {s.interval for s in SCENARIOS} == {50e-6, 10e-6}
    assert {s.one_step for s in SCENARIOS} == {s.late for s in SCENARIOS} == {True, False}


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
def test_what_is_drawn_does_not_depend_on_what_was_drawn_before():
    scenario = Scenario("50 us, one step", one_step=True)
    assert json.dumps(three_ways.draw(scenario, 1)) == json.dumps(three_ways.draw(scenario, 1))


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
