"""The same number of samples, the thesis's plan against a designed one; and whether what a plan promises holds.

The thesis fitted three step responses of the platform (50 us) and two walks at 5 Hz (1 ms), 5605 samples in all, of
which the packaged records are the counterpart.  A plan of as many records and samples, within the same voltages,
frequencies, least interval and noise, is chosen for the six friction parameters, first at the nominal truth.  Then it
is chosen for a prior (every parameter known to a tenth, or to 0.3, on a logarithmic scale), and compared at truths that
are drawn from this prior.

Noise of 1 ms correlation time and free zeros: the information matrix of a plan against a Monte Carlo of refits.  The
quick refit is a step of Gauss and Newton with whitened residuals, which at this noise is where a whole fit ends;
`--refit N` makes N whole ones, by `identify` and white noise.

    python -m experiments.experiment_design [--refit N]
"""

import argparse
import dataclasses
import json
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

import pdssjax
from experiments.common import Row, print_table, write
from pdssjax import Aim, Limits, Plan, Resources, Study, prepare_jax
from pdssjax.design import Knowledge, Noise, record_information, rehearse
from pdssjax.files import EXAMPLE
from pdssjax.inference import pose

NAME = "experiment_design"
TRUTHS, SCATTERS = 20, (0.1, 0.3)
"""Truths drawn from each prior, and the priors' standard deviations of the logarithm of each parameter."""
PRIOR_DRAWS = 8
"""Of a prior, over which a plan is judged."""
CORRELATION_TIME = 1e-3
DRAWS = 2000
"""Of the noise in the Monte Carlo."""


def nominal() -> tuple[Study, dict[str, float]]:
    """The packaged study, and the parameters that its records were made with [SI]."""
    study = pdssjax.load_study(EXAMPLE / "study.toml")
    known = json.loads((EXAMPLE / "truth.json").read_text(encoding="utf-8"))["parameters"]
    return study, {path: known[path]["value"] for path in study.parameters}


def friction_paths(study: Study) -> tuple[str, ...]:
    """The free parameters of the contact."""
    return tuple(path for path, p in study.parameters.items() if p.free and path.startswith("friction."))


def designed(study: Study, truth: Mapping[str, float], scatter: float = 0.0) -> Plan:
    """A plan of as many samples and records as the thesis's, best for the friction parameters.

    With a `scatter` it is best for parameters that are known to so much, on a logarithmic scale: the ranges of the
    study are three standard deviations either way.
    """
    fitted = [record for record in study.records if record.role == "fit"]
    budget = Resources(sum(record.time.size for record in fitted), len(fitted))
    factor = float(np.exp(3.0 * scatter))
    ends = lambda path: {"low": truth[path] / factor, "high": truth[path] * factor} if scatter else {}
    parameters = {path: dataclasses.replace(p, **ends(path)) if p.free else p for path, p in study.parameters.items()}
    return pdssjax.design_experiment(
        dataclasses.replace(study, parameters=parameters),
        budget,
        knowledge=Knowledge(dict(truth)),
        limits=Limits(),
        aim=Aim("parameter", friction_paths(study)),
        draws=PRIOR_DRAWS if scatter else 1,
        progress=print,
    )


def linearised(study: Study, truth: Mapping[str, float]) -> tuple[tuple[str, ...], list[Float[np.ndarray, "n p"]]]:
    """Paths of the free parameters, and each fitted record's whitened Jacobian on the fit's scale, its zero free."""
    starting = study.with_starts({path: n for path, n in truth.items() if study.parameters[path].free})
    problem = pose(starting, dict(truth), study.accuracy)
    jacobian = np.asarray(problem.jacobian(problem.encode(dict(truth))))
    return problem.residual.transform.paths, [jacobian[rows] for rows in problem.rows]


def relative_errors(study: Study, truth: Mapping[str, float]) -> dict[str, float]:
    """Relative standard errors by the fitted records of a study, white noise and free zeros."""
    paths, jacobians = linearised(study, truth)
    whole = np.concatenate(jacobians)
    return dict(zip(paths, np.sqrt(np.diag(np.linalg.inv(whole.T @ whole))), strict=True))


def geometric_mean(errors: Mapping[str, float], paths: Sequence[str]) -> float:
    """Of the errors of some parameters."""
    return float(np.exp(np.mean([np.log(errors[path]) for path in paths])))


def scattered(truth: Mapping[str, float], study: Study, scatter: float, seed: int) -> dict[str, float]:
    """A truth drawn from a prior: the logarithm of every free parameter off by `scatter`, one standard deviation."""
    random = np.random.default_rng(seed)
    factors = {p: float(np.exp(scatter * random.normal())) for p, q in study.parameters.items() if q.free}
    return {path: number * factors.get(path, 1.0) for path, number in truth.items()}


def at_drawn_truths(study: Study, truth: Mapping[str, float], scatter: float) -> Row:
    """The plan for a prior beside the thesis's, at truths drawn from it: geometric means of the errors [%]."""
    plan, paths = designed(study, truth, scatter).as_study(), friction_paths(study)
    drawn = [scattered(truth, study, scatter, seed) for seed in range(1, TRUTHS + 1)]
    thesis, ours = (
        np.array([geometric_mean(relative_errors(posed, here), paths) for here in drawn]) for posed in (study, plan)
    )
    before, after = (100.0 * float(np.exp(np.mean(np.log(errors)))) for errors in (thesis, ours))
    told = f"{before / after:.1f} times less, {np.min(thesis / ours):.1f} at the worst of {TRUTHS}"
    return Row(f"friction errors, truths drawn within {scatter:g}", before, after, "%", told)


def monte_carlo(plan: Plan, truth: Mapping[str, float]) -> dict[str, float]:
    """Standard deviations of refits over those of the information matrix, by path, with coloured noise.

    Each refit is a step of Gauss and Newton from the truth that whitens its residuals, zeros free, with noise drawn at
    the plan's own sample times.
    """
    study = plan.as_study()
    paths, centred = linearised(study, truth)
    random, columns, shots = np.random.default_rng(0), [], []
    information = np.zeros((len(paths), len(paths)))
    for planned, jacobian in zip(plan.records, centred, strict=True):
        noise = Noise(1.0, CORRELATION_TIME)
        times = planned.times
        factor = np.linalg.inv(np.linalg.cholesky(_correlations(times)))
        white = factor @ np.column_stack([jacobian, np.ones(times.size)])
        zero = white[:, -1]
        free = white[:, :-1] - np.outer(zero, zero @ white[:, :-1] / (zero @ zero))
        information += record_information(jacobian, times, noise)
        columns.append(free)
        drawn = np.array([noise.drawn(times, random) for _ in range(DRAWS)])
        shots.append(drawn @ factor.T)
    whole = np.concatenate(columns)
    moved = np.concatenate(shots, axis=1) @ whole @ np.linalg.inv(whole.T @ whole)
    promised = np.sqrt(np.diag(np.linalg.inv(information)))
    return dict(zip(paths, np.std(moved, axis=0) / promised, strict=True))


def _correlations(times: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n n"]:
    """Of the noise between all samples."""
    return np.exp(-np.abs(times[:, None] - times) / CORRELATION_TIME) + 1e-12 * np.eye(times.size)


def carried_out(plan: Plan, truth: Mapping[str, float], seeds: int) -> list[Row]:
    """What fits of the plan's records have, over what it promised: their standard errors, and how far they are off."""
    found = [rehearse(plan, seed) for seed in range(seeds)]
    ratios = [rehearsal.ratio for rehearsal in found]
    off = {
        path: [(rehearsal.estimate.parameters[path].value - truth[path]) / error for rehearsal in found]
        for path, error in found[0].promised.items()
    }
    scatter = {path: float(np.sqrt(np.mean(np.square(each)))) for path, each in off.items()}
    mean = float(np.exp(np.mean(np.log(list(scatter.values())))))
    return [
        Row("standard errors over promised, least", 1.0, min(ratios), "", f"{seeds} seeds, mean of all parameters"),
        Row("standard errors over promised, most", 1.0, max(ratios)),
        Row("distance from the truth over promised, geometric mean", 1.0, mean, "", f"root mean square of {seeds}"),
        *(Row(f"the same, {path}", 1.0, each) for path, each in scatter.items()),
    ]


def main(refits: int = 0) -> None:
    """Print the tables."""
    prepare_jax(dedicated=True)
    study, truth = nominal()
    plan, paths = designed(study, truth), friction_paths(study)
    thesis, ours = (geometric_mean(relative_errors(posed, truth), paths) for posed in (study, plan.as_study()))
    rows = [Row("friction errors, nominal truth", 100 * thesis, 100 * ours, "%", f"{thesis / ours:.1f} times less")]
    rows += [at_drawn_truths(study, truth, scatter) for scatter in SCATTERS]
    what = "; ".join(f"{planned.name} ({planned.schedule.count})" for planned in plan.records)
    text = [print_table(f"{plan.samples} samples in {len(plan.records)} records", rows, notes=[f"The plan: {what}."])]
    ratios = monte_carlo(plan, truth)
    rows = [Row(path, 1.0, ratio, "", f"{DRAWS} refits") for path, ratio in ratios.items()]
    text.append(print_table("Errors of refits over those of the information, noise of 1 ms, zeros free", rows))
    if refits:
        text.append(
            print_table(
                "The plan carried out on the virtual rig, fitted without starts", carried_out(plan, truth, refits)
            )
        )
    write("\n\n".join(text), NAME)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--refit", type=int, default=0, metavar="N", help="whole fits of the plan's records")
    main(parser.parse_args().refit)
