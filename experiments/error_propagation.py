"""How much of the first step's error lands in the second? (thesis, section 6.2)

The thesis identified the piezo from step tests, held it, and then identified the friction.
If the piezo's parameters are wrong by a little, the friction's move to make up for it.  To
first order the shift is -(J2' J2)^-1 J2' J1, with the Jacobians of the sawtooth records
in the friction's and in the piezo's parameters, at the true values of the packaged example.

A Monte Carlo with real fits tells what that comes to: three ways of identification (`three_ways`), step tests good
and bad.  Then what the thesis's own two identifications of its stack imply, and a measured record (`moved_stack`).

    python -m experiments.error_propagation        # resumes where it was left
    python -m experiments.error_propagation 4      # so many draws a scenario, from scratch or a larger run's first
"""

import concurrent.futures
import dataclasses
import os
import sys
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import pdssjax
from experiments import common, linear_draws, moved_stack, three_ways_report
from experiments.common import BLUE, GREEN, VERMILION, save, styled, write
from experiments.draws import read_tasks, run_tasks
from experiments.three_ways import ACCURACY, SCENARIOS, WAYS, Scenario, draw, known_truth
from experiments.three_ways_report import Cell
from pdssjax import prepare_jax
from pdssjax.files import EXAMPLE
from pdssjax.inference import Residual, as_weights, least_squares_covariance, transform_of

NAME = "error_propagation"
DRAWS = 24
"""Of each scenario: some 600 fits."""
MEASURED_SPREAD = {"piezo.gain": 0.02, "piezo.natural_frequency": 0.03, "piezo.damping_ratio": 0.17}
"""Relative spread between the thesis's own two identifications of the piezo (chapters 4 and 5).

Natural frequency 6527 and 6736 rad/s, damping ratio 0.2083 and 0.1772, gain (read from chapter
4's H sin(pL)) 0.098 and 0.1007 um/V.
"""

LEGEND = "* first order, all three piezo parameters off by the spread of the thesis's own two identifications"


def main(draws: int = DRAWS, scenarios: Sequence[Scenario] = SCENARIOS) -> None:
    """Print the tables and draw the figures."""
    prepare_jax(dedicated=True)
    study, truth = pdssjax.load_study(EXAMPLE / "study.toml"), known_truth()
    shifts, tables = {}, []
    paths = np.array([])
    for reading in ("deflection", "force"):
        paths, shifts[reading] = shift(dataclasses.replace(study, friction_state=reading), truth)
        tables.append(show(reading, paths, shifts[reading]))
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as executor:
        cells = monte_carlo(draws, scenarios, executor)
    names = [str(path) for path in paths]
    tables = [three_ways_report.table(cells, names), three_ways_report.bias_table(cells, names), *tables]
    print("\n\n".join(tables[:2]))
    tables.insert(2, linear_draws.table(*linear_draws.walks_jacobian()))
    moved = moved_stack.thesis()
    tables.append(moved_stack.show_thesis(moved))
    tables.append(moved_stack.show_liu(*moved_stack.liu()))
    write("\n\n".join(tables), NAME)
    with styled():
        save(three_ways_report.draw(cells, names), NAME)
        save(moved_stack.draw(moved), f"{NAME}_thesis")
        save(draw_shifts(paths, shifts), f"{NAME}_amplification")


def monte_carlo(draws: int, scenarios: Sequence[Scenario], executor: concurrent.futures.Executor) -> list[Cell]:
    """Every way in every scenario; the draws are kept in out/experiments/error_propagation, done once."""
    folder = common.OUT / NAME
    # Scenarios in turn, so that what is there after a while says something of all of them.
    tasks = {f"{_slug(s.name)}-{n:04d}": (s, n) for n in range(draws) for s in scenarios}
    run_tasks(tasks, draw, folder, executor, report=lambda text: print(f"\r{text}", end="", flush=True))
    print()
    found: dict[tuple[str, str], list[Any]] = {(s.name, way): [] for s in scenarios for way in WAYS}
    for name, result in read_tasks(tasks, folder):
        for way in WAYS:
            found[tasks[name][0].name, way].append(result[way])
    return [_cell(*key, results) for key, results in found.items()]


def _cell(scenario: str, way: str, results: list[Any]) -> Cell:
    numbers = {key: np.array([result[key] for result in results]) for key in ("error", "carried", "said", "naive")}
    return Cell(scenario, way, **numbers, converged=np.array([result["converged"] for result in results]))


def _slug(text: str) -> str:
    return "".join(c if c.isalnum() else "-" for c in text)


def shift(study, truth):
    """Per cent by which each friction parameter moves for 1 % in each piezo parameter, shape (6, 3)."""
    records = [record for record in study.records if record.role == "fit" and record.measures == "effector"]
    free = transform_of(study.parameters, truth)
    fixed = {path: truth[path] for path, parameter in study.parameters.items() if not parameter.free}
    residual = Residual.of(study.models, records, free, fixed, ACCURACY)
    weights = as_weights([record.noise for record in records], [True] * len(records))
    jacobian = np.asarray(jax.jit(jax.jacfwd(lambda u: residual(u, weights)[0]))(jnp.asarray(free.encode(truth))))
    piezo = np.array([path.startswith("piezo.") for path in free.paths])
    second, first = jacobian[:, ~piezo], jacobian[:, piezo]
    inverse = least_squares_covariance(second, np.zeros(second.shape[1], bool)).matrix
    return np.array(free.paths), -inverse @ second.T @ first


def show(reading: str, paths: np.ndarray, shift: np.ndarray) -> str:
    """Print the table of one reading of (5.22); returns it as Markdown."""
    piezo = [path.split(".")[1] for path in paths if path.startswith("piezo.")]
    friction = [path for path in paths if not path.startswith("piezo.")]
    head = ["moves by (%)", *(f"per 1 % of {name}" for name in piezo), "thesis's spread*"]
    spread = np.abs(shift) @ [100 * MEASURED_SPREAD[f"piezo.{name}"] for name in piezo]
    rows = [
        [path, *(f"{value:.2f}" for value in row), f"{whole:.0f}"]
        for path, row, whole in zip(friction, shift, spread, strict=True)
    ]
    print(f"\n{reading} state")
    for line in (head, *rows):
        print(f"{line[0]:<20}" + "".join(f"{cell:>30}" for cell in line[1:]))
    print(LEGEND)
    lines = [f"## {reading} state", "", "| " + " | ".join(head) + " |", "|---|" + "--:|" * (len(head) - 1)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows), "", LEGEND])


def draw_shifts(paths: np.ndarray, shifts: dict[str, np.ndarray]) -> Figure:
    """Size of every shift, one panel a reading."""
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    friction = [path.split(".")[1] for path in paths if not path.startswith("piezo.")]
    names = [path.split(".")[1].replace("_", " ") for path in paths if path.startswith("piezo.")]
    panels = figure.subplots(1, len(shifts), sharey=True)
    for axes, (reading, values) in zip(panels, shifts.items(), strict=True):
        places = np.arange(len(friction))
        for i, (name, colour) in enumerate(zip(names, (BLUE, VERMILION, GREEN), strict=True)):
            axes.bar(places + 0.27 * (i - 1), np.abs(values[:, i]), 0.25, label=name, color=colour)
        axes.set_yscale("log")
        axes.set_xticks(places, friction, rotation=30, ha="right")
        axes.set_title(f"{reading} state")
        axes.grid(visible=False, axis="x")
    panels[0].set_ylabel("shift of the friction parameter (%)\nfor 1 % error of the piezo's")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, [f"1 % error in {label}" for label in labels], loc="outside lower center", ncols=3)
    return figure


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else DRAWS)
