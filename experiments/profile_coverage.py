"""Do intervals of the profile likelihood hold the truth where linear ones fall short?

The rigs of `experiments.blind_rigs`, from where their joint fits ended, with the noise told: linear 95 % intervals and
those of the profile likelihood beside each other.  Needs the results that `experiments.blind_rigs` keeps.

    python -m experiments.profile_coverage        # resumes where it was left
    python -m experiments.profile_coverage 193    # of so many rigs
"""

import sys
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import pdssjax
from experiments.blind_rigs import NAME as RIGS, missed, rig
from experiments.common import BLUE, GREEN, OUT, Row, print_table, save, styled
from experiments.coverage_figure import draw_coverage
from experiments.draws import numbered_results, read_tasks
from pdssjax import InputWarning, prepare_jax

NAME = "profile_coverage"
COUNT = 100
WAYS = {"linear": "linear", "profile": "profile likelihood"}

Result = dict[str, Any]
"""Of one rig, as JSON holds it: by way and parameter, an interval's ends; and the truth."""


def both_intervals(number: int) -> Result:
    """The intervals of a rig whose joint fit ended in its optimum, in both ways; empty where it did not."""
    prepare_jax(dedicated=True)  # in another process, too
    name = f"{number:04d}"
    ((_, kept),) = read_tasks({name: (number,)}, OUT / RIGS)
    if missed(kept, "joint"):
        return {}
    told, _ = rig(number)
    values = kept["truth"] | {path: found[0] for path, found in kept["joint"]["parameters"].items()}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        found = pdssjax.identify(told.with_starts(values), intervals="profile")
    parameters = {path: found.parameters[path] for path in found.names}
    return {
        "truth": kept["truth"],
        "linear": {path: list(parameter.errors["white"].interval) for path, parameter in parameters.items()},
        "profile": {path: list(parameter.interval) for path, parameter in parameters.items()},
    }


def coverage(results: Sequence[Result], way: str) -> dict[str, float]:
    """By parameter, how many intervals hold the truth [%]."""
    inside = [
        {path: low <= result["truth"][path] <= high for path, (low, high) in result[way].items()} for result in results
    ]
    return {path: 100.0 * float(np.mean([each[path] for each in inside])) for path in inside[0]}


def table(results: Sequence[Result]) -> list[Row]:
    """How many intervals hold the truth, by parameter and in all."""
    rows = []
    for way, name in WAYS.items():
        shares = coverage(results, way)
        rows += [Row(f"{name}: {path}", None, f"{share:.1f}", "%") for path, share in shares.items()]
        rows.append(Row(f"{name}: all", None, f"{np.mean(list(shares.values())):.1f}", "%"))
    return rows


def draw(results: Sequence[Result]) -> Figure:
    """Coverage of every parameter in both ways, with its uncertainty."""
    found = {name: coverage(results, way) for way, name in WAYS.items()}
    return draw_coverage(
        {name: np.array(list(shares.values())) for name, shares in found.items()},
        (BLUE, GREEN),
        list(next(iter(found.values()))),
        len(results),
        f"{len(results)} random rigs",
        "95 % intervals that hold the truth (%)",
    )


def main(count: int = COUNT) -> None:
    """Print the table and draw the figure."""
    # One at a time: the ends of a rig are searched for on all cores.
    results = [result for result in numbered_results(count, both_intervals, OUT / NAME, workers=1) if result]
    print_table(f"{len(results)} random rigs", table(results), NAME)
    with styled():
        save(draw(results), NAME)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
