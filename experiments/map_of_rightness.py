"""Are derivatives right away from the published actuator, for every law, piezo, waveform, part and record?

Actuators are drawn at random, so many of every structure that a study can have; every column of the Jacobian at the
default accuracy is judged by central differences of values at the tightest one, values by these, and reverse mode by
forward mode.  Every actuator's verdict is a file; after a change of the package begin with an empty folder.

    python -m experiments.map_of_rightness        # resumes where it was left
    python -m experiments.map_of_rightness 200    # so many of every structure, a quarter more of the published ones
    python -m experiments.map_of_rightness 5 0 60 # so many of each of the combinations 0 to 59 of everything
"""

import sys
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import jax
import numpy as np
from matplotlib.figure import Figure

from experiments.common import BLUE, ORANGE, OUT, VERMILION, save, styled, write
from experiments.derivative_judge import ASKED, REVERSE, VALUES, Judge, Verdict
from experiments.draws import numbered_results
from experiments.random_actuators import PUBLISHED, STRUCTURES, named
from pdssjax import prepare_jax

NAME = "map_of_rightness"
COUNT = 20
HEADER = (
    "structure",
    "actuators",
    f"above {ASKED:.0e}",
    "at a cliff",
    "not finished",
    "worst column",
    "worst value",
    "forward - reverse",
)


def drawn(judge: Judge, number: int) -> dict[str, Any]:
    """The verdict on one actuator of a structure, as JSON holds it."""
    return judge.verdict(judge.structure.draw(np.random.default_rng([9, number])))._asdict()


def verdicts(name: str, count: int) -> list[Verdict]:
    """Of the first so many actuators of a structure."""
    print(f"\n{name}")
    folder = OUT / NAME / "".join(letter if letter.isalnum() else "-" for letter in name)
    found = numbered_results(count, partial(drawn, Judge(named(name))), folder)
    jax.clear_caches()  # compiled code of dozens of structures would fill the memory
    return [Verdict(**each) for each in found]


def row(name: str, found: Sequence[Verdict]) -> list[str]:
    """What the actuators of a structure came to; the worst are those that no cliff explains."""
    finished = [verdict for verdict in found if not verdict.failure]
    judged = [verdict for verdict in finished if not verdict.is_cliff]
    worst = lambda numbers: f"{max(numbers, default=np.nan):.0e}"
    return [
        name,
        f"{len(found)}",
        f"{sum(not verdict.error <= ASKED for verdict in judged)}",
        f"{len(finished) - len(judged)}",
        f"{len(found) - len(finished)}",
        worst(verdict.error for verdict in judged),
        f"{worst(verdict.value for verdict in judged)} {named(name).unit}",
        worst(verdict.reverse for verdict in finished),
    ]


def table(results: Mapping[str, Sequence[Verdict]]) -> str:
    """A row a structure, and below it every actuator of which something is not as asked."""
    lines = [HEADER, ("---", *["--:"] * (len(HEADER) - 1)), *(row(name, found) for name, found in results.items())]
    notes = [
        f"{name} {number}: {told}"
        for name, found in results.items()
        for number, told in enumerate(wrongs(name, found))
        if told
    ]
    count = sum(map(len, results.values()))
    title = f"## {count} random actuators of {len(results)} structures"
    return "\n".join([title, "", *(f"| {' | '.join(line)} |" for line in lines), "", *(f"- {note}" for note in notes)])


def wrongs(name: str, found: Sequence[Verdict]) -> list[str]:
    """What is not as asked of each actuator; empty where all is right."""
    return [wrong(verdict, VALUES[named(name).unit]) for verdict in found]


def wrong(verdict: Verdict, allowed: float) -> str:
    """What is not as asked of an actuator whose record may be wrong by `allowed` [its unit]."""
    if verdict.failure:
        return f"did not finish at {verdict.failure} accuracy"
    said = []
    if not verdict.error <= ASKED:
        by = "at a cliff" if verdict.is_cliff else f"{verdict.above} above, differences agree to"
        said.append(
            f"{verdict.column} off by {verdict.error:.1e} ({verdict.weight:.1e} of the largest column; "
            f"{by} {verdict.discontinuity:.1e}; at the tightest accuracy {verdict.tight:.1e})"
        )
    if not (verdict.value <= allowed or verdict.is_cliff):
        said.append(f"value off by {verdict.value:.1e}")
    if not verdict.reverse <= REVERSE:
        said.append(f"forward less reverse {verdict.reverse:.1e}")
    return "; ".join(said)


def draw(results: Mapping[str, Sequence[Verdict]]) -> Figure:
    """The worst column of every actuator, a line a structure."""
    figure = Figure(figsize=(7.4, 1.2 + 0.17 * len(results)), layout="constrained")
    axes = figure.subplots()
    kinds = {"right": BLUE, "at a cliff": ORANGE, "above what is asked": VERMILION}
    for place, found in enumerate(results.values()):
        finished = [verdict for verdict in found if not verdict.failure]
        kind = [
            "at a cliff" if v.is_cliff else "right" if v.error <= ASKED else "above what is asked" for v in finished
        ]
        errors = np.array([max(verdict.error, 1e-12) for verdict in finished])
        for label, colour in kinds.items():
            chosen = errors[[each == label for each in kind]]
            marker = "|" if label == "right" else "o"
            axes.plot(chosen, np.full(chosen.size, place), marker, ms=5, color=colour, label=None if place else label)
    axes.axvline(ASKED, color="0.4", linewidth=0.8)
    axes.set_xscale("log")
    axes.set_yticks(range(len(results)), list(results), fontsize=6.5)
    axes.set_ylim(len(results) - 0.5, -0.5)
    axes.set_xlabel("largest error of a column, relative to its norm")
    axes.set_title(f"{sum(map(len, results.values()))} random actuators: Jacobian against differences", loc="left")
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def main(count: int = COUNT, first: int = 0, last: int = 0) -> None:
    """Print the table and draw the figure; of combinations, if a `last` is given."""
    prepare_jax(dedicated=True)
    combined = [f"combination {number}" for number in range(first, last)]
    results = {name: verdicts(name, count * 5 // 4 if name in PUBLISHED else count) for name in combined or STRUCTURES}
    text, kept = table(results), f"{NAME}_combined" if combined else NAME
    print(f"\n{text}")
    write(text, kept)
    with styled():
        save(draw(results), kept)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:4]))
