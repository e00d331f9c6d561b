"""Do fits of random rigs, without starts, end in the right optimum, and do their 95 % intervals hold the truth?

The records of the packaged study (two walks of 5 Hz, three steps) are made anew with parameters scattered by 1.2 to
1.6 either way, by both readings of the friction's state, with noise that the study tells or not.  Each rig is
identified jointly and in two steps.  A fit has missed the optimum where the truth fits better than it by more than 10
in chi-square: a fit in two steps is no minimum of the whole.

    python -m experiments.blind_rigs        # resumes where it was left
    python -m experiments.blind_rigs 500    # so many
"""

import dataclasses
import functools
import sys
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy import stats

import pdssjax
from experiments.common import BLUE, GREEN, OUT, VERMILION, Row, print_table, save, styled
from experiments.coverage_figure import draw_coverage
from experiments.draws import numbered_results
from experiments.three_ways import NOISE, known_truth
from pdssjax import Estimate, InputWarning, Study, prepare_jax
from pdssjax.files import EXAMPLE
from pdssjax.inference import Method, Problem

NAME = "blind_rigs"
RIGS = 100
SCATTER = {"piezo.gain": 1.2, "piezo.natural_frequency": 1.2, "friction.f_ss_a": 1.3, "friction.f_ss_b": 1.3}
"""Largest factor either way."""
OTHERS = 1.6
"""The same of all that is not named."""
MISSED = 10.0
"""Chi-square above that of the truth."""
WAYS = {"joint": "joint", "sequential": "sequential, corrected", "naive": "sequential, naive"}

Result = dict[str, Any]
"""Of one rig, as JSON holds it."""


@functools.cache
def packaged() -> Study:
    """The packaged study, its free parameters without starts and the records that it fits."""
    study = pdssjax.load_study(EXAMPLE / "study.toml")
    fitted = tuple(record for record in study.records if record.role == "fit")
    return dataclasses.replace(study.with_starts(dict.fromkeys(study.parameters)), records=fitted)


def truth_of(number: int) -> dict[str, float]:
    """The parameters of a rig [SI]; what the packaged study does not fit is as it is there."""
    random, truth = np.random.default_rng([22, number]), known_truth()
    for path, parameter in packaged().parameters.items():
        if parameter.free:
            truth[path] *= SCATTER.get(path, OTHERS) ** random.uniform(-1.0, 1.0)
    return truth


def rig(number: int) -> tuple[Study, Study]:
    """A rig with its noise told, and what is identified; both without starts.

    Of four rigs in a row two have each reading, and one of these has its noise told.
    """
    random = np.random.default_rng([23, number])
    study = dataclasses.replace(packaged(), friction_state=("deflection", "force")[number % 2])
    motions = [np.asarray(motion) for motion in study.predict(truth_of(number))]
    measured = [motion + random.uniform(0.0, 2e-6) + NOISE * random.standard_normal(motion.size) for motion in motions]
    told = tuple(
        dataclasses.replace(record, measured=values, noise=NOISE)
        for record, values in zip(study.records, measured, strict=True)
    )
    noise = NOISE if number % 4 < 2 else None
    asked = tuple(dataclasses.replace(record, noise=noise) for record in told)
    return dataclasses.replace(study, records=told), dataclasses.replace(study, records=asked)


def identified(number: int, methods: Sequence[Method] = ("joint", "sequential")) -> Result:
    """A rig, identified in these ways."""
    prepare_jax(dedicated=True)  # in another process, too
    told, asked = rig(number)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        truth = truth_of(number)
        judge, _ = pdssjax.pose_problem(told.with_starts(truth))
        found = {method: pdssjax.identify(asked, method) for method in methods}
    fisher = _fisher_errors(judge, truth)
    return {
        "truth": truth,
        "chi2": _chi2(judge, truth),
        "reading": asked.friction_state,
        "told": number % 4 < 2,
        **{method: _told(estimate, judge, fisher) for method, estimate in found.items()},
    }


def _chi2(problem: Problem, values: Mapping[str, float]) -> float:
    return float(np.sum(np.asarray(problem.whitened(problem.encode(dict(values)))) ** 2))


def _fisher_errors(problem: Problem, truth: Mapping[str, float]) -> dict[str, float]:
    """Standard errors by the information at the truth, relative: all parameters are fitted by their logarithms."""
    jacobian = np.asarray(problem.jacobian(problem.encode(dict(truth))))
    sizes = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / sizes
    deviations = np.sqrt(np.diag(np.linalg.inv(scaled.T @ scaled))) / sizes
    return dict(zip(problem.residual.transform.paths, map(float, deviations), strict=True))


def _told(estimate: Estimate, judge: Problem, fisher: Mapping[str, float]) -> Result:
    """Of every parameter: the value, its standard error and the naive one, and the Fisher information's."""
    chosen = {path: estimate.parameters[path] for path in fisher}
    return {
        "chi2": _chi2(judge, {path: p.value for path, p in chosen.items()}),
        "converged": bool(estimate.success),
        "message": estimate.message,
        "iterations": estimate.statistics.iterations,
        "parameters": {
            path: [p.value, p.standard_error, p.naive_standard_error, list(p.interval), fisher[path] * p.value]
            for path, p in chosen.items()
        },
    }


def holds(result: Result, way: str) -> dict[str, bool]:
    """Whether the 95 % interval of each parameter holds the truth."""
    told = result["joint" if way == "joint" else "sequential"]["parameters"]
    out = {}
    for path, (value, error, naive, (low, high), _) in told.items():
        # Intervals are symmetric in the logarithm.
        half = 0.5 * np.log(high / low) * (naive / error if way == "naive" else 1.0)
        out[path] = bool(abs(np.log(result["truth"][path] / value)) <= half)
    return out


def missed(result: Result, method: str) -> bool:
    """The truth fits better."""
    return not result[method]["chi2"] < result["chi2"] + MISSED


def smallest_error(result: Result, method: str) -> float:
    """The least standard error over the Fisher information's at the truth."""
    errors = [error / fisher for _, error, _, _, fisher in result[method]["parameters"].values() if error is not None]
    return min(errors, default=np.nan)


def table(results: Sequence[Result]) -> list[Row]:
    """What the fits came to."""
    rows = []
    for method in ("joint", "sequential"):
        wrong = [result for result in results if missed(result, method)]
        unsaid = [result for result in wrong if result[method]["converged"]]
        rows.append(Row(f"{method}: missed the optimum", None, f"{len(wrong)} of {len(results)}"))
        rows.append(Row(f"{method}: and did not say so", None, f"{len(unsaid)}"))
        right = [result for result in results if not missed(result, method)]
        refused = sum(not result[method]["converged"] for result in right)
        rows.append(Row(f"{method}: in the optimum, said not to have converged", None, f"{refused}"))
        least = min(smallest_error(result, method) for result in results)
        rows.append(Row(f"{method}: least standard error over the Fisher information's", None, least))
    above, likely = distance_of_truth(results)
    count = len(results[0]["joint"]["parameters"])
    rows.append(Row("joint: chi-square of the truth less the fit's, mean", None, above, "", f"{count} expected"))
    rows.append(Row("joint: chance of such a distribution of it", None, likely, "", "Kolmogorov and Smirnov"))
    for way, name in WAYS.items():
        shares = coverage(results, way)
        rows.append(
            Row(f"{name}: 95 % intervals hold", None, f"{min(shares.values()):.1f} .. {max(shares.values()):.1f}", "%")
        )
    return rows


def distance_of_truth(results: Sequence[Result]) -> tuple[float, float]:
    """How far chi-square falls from the truth to the joint fit, on average; and how likely that is of a right fit.

    Then it is distributed as chi-square of as many degrees of freedom as there are parameters, whatever its shape
    nearby: all of them together, so to speak, are held as often as they should be.
    """
    fallen = np.array([r["chi2"] - r["joint"]["chi2"] for r in results if not missed(r, "joint")])
    expected = stats.chi2(len(results[0]["joint"]["parameters"]))
    return float(np.mean(fallen)), float(stats.kstest(fallen, expected.cdf).pvalue)


def coverage(results: Sequence[Result], way: str) -> dict[str, float]:
    """By parameter, how many intervals hold the truth [%]."""
    inside = [holds(result, way) for result in results]
    return {path: 100.0 * float(np.mean([each[path] for each in inside])) for path in inside[0]}


def draw(results: Sequence[Result]) -> Figure:
    """Coverage of every parameter in every way, with its own uncertainty."""
    found = {name: coverage(results, way) for way, name in WAYS.items()}
    return draw_coverage(
        {name: np.array(list(shares.values())) for name, shares in found.items()},
        (BLUE, GREEN, VERMILION),
        list(found[WAYS["joint"]]),
        len(results),
        f"{len(results)} random rigs, identified without starts",
        "95 % intervals that hold the truth (%)",
    )


def main(rigs: int = RIGS) -> None:
    """Print the table and draw the figure."""
    results = numbered_results(rigs, identified, OUT / NAME)
    print_table(f"{len(results)} random rigs, without starts", table(results), NAME)
    with styled():
        save(draw(results), NAME)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
