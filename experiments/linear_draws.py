"""What first order predicts for the Monte Carlo of `three_ways`, a hundred draws from one Jacobian.

The first step is taken for real: step records are made in closed form, with noise, and read by least squares or by
their peaks.  The second step is one Gauss-Newton step from the truth.  With the walks' whitened Jacobian J, its columns
of the stack a and of the friction b, noise n of unit size and an error e of the stack, the friction comes out wrong by
-(J_b' J_b)^-1 J_b' (n + J_a e).  Joint: the same in all parameters, with the steps' residuals beside the walks'.
Where the errors are large this is wrong, and by how much the real fits tell.
"""

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

import pdssjax
from experiments.three_ways import (
    AFTER,
    BEFORE,
    KEPT,
    NOISE,
    SCENARIOS,
    WAYS,
    Scenario,
    is_step,
    known_truth,
    rig_of,
    with_measured,
)
from pdssjax import Record, Study
from pdssjax.files import EXAMPLE
from pdssjax.inference import pick_peaks, with_piezo_held

DRAWS = 100
STACK = ("piezo.gain", "piezo.natural_frequency", "piezo.damping_ratio")
_ROUNDS = 5
"""Gauss-Newton steps of the first step's least squares."""
_SMALL = 1e-6
"""Of a logarithm, for differences."""


def walks_jacobian() -> tuple[Float[np.ndarray, "n p"], tuple[str, ...]]:
    """At the truth and the usual noise, on the scale of logarithms, of the records of the end-effector; and its paths.

    The stack's columns come first.
    """
    rig = rig_of(SCENARIOS[0])
    problem = with_measured(rig.problem, list(rig.motions))
    fit = with_piezo_held(problem, problem.encode(known_truth()), lambda message: None)
    walks = np.repeat([not is_step(r) for r in problem.records], [r.time.size for r in problem.records])
    return np.asarray(fit.state.jacobian)[walks], problem.residual.transform.paths


def predicted(
    scenario: Scenario, jacobian: Float[np.ndarray, "n p"], draws: int = DRAWS
) -> dict[str, Float[np.ndarray, "draws p"]]:
    """Errors of all parameters by way, on the scale of logarithms, in the order of the Jacobian's columns."""
    walks = jacobian * (NOISE / scenario.noise)
    study, truth = _steps(scenario), _known_stack()
    steps = -np.concatenate([_slopes(truth, r.time, _volts(r)) for r in study.records]) / scenario.noise
    fixed = np.nan if scenario.damping is None else float(np.log(scenario.damping / truth[2]))
    second, joint = np.linalg.pinv(walks[:, 3:]), _Joint(steps, walks, fixed)
    found: dict[str, list[Float[np.ndarray, " p"]]] = {way: [] for way in WAYS}
    for number in range(draws):
        random = np.random.default_rng([21, number])
        drawn = _drawn(study, scenario, random)
        noise = random.standard_normal(len(walks))
        rest = np.concatenate([_centred(r.measured - response(truth, r.time, _volts(r))) for r in drawn.records])
        found["joint"].append(joint(rest / scenario.noise, noise))
        picked = np.log([pick_peaks(drawn).values[path] for path in STACK]) - np.log(truth)
        for way, error in (("sequential", _least_squares(drawn, truth, fixed)), ("peaks", picked)):
            stack = np.array([*error[:2], error[2] if np.isnan(fixed) else fixed])
            friction = -second @ (noise + walks[:, :3] @ stack)
            found[way].append(np.concatenate([stack, friction]))
    return {way: np.stack(errors) for way, errors in found.items()}


def table(jacobian: Float[np.ndarray, "n p"], paths: Sequence[str], draws: int = DRAWS) -> str:
    """Markdown: bias and spread of the stack and the friction in every scenario, in per cent of a logarithm."""
    names = [path.split(".")[1] for path in paths]
    lines = [
        f"## Predicted by first order: bias ± spread in per cent of a logarithm, {draws} draws",
        "",
        "| step tests | way | " + " | ".join(names) + " |",
        "|---|---|" + "--:|" * len(names),
    ]
    for scenario in SCENARIOS:
        for way, errors in predicted(scenario, jacobian, draws).items():
            pairs = zip(100.0 * errors.mean(axis=0), 100.0 * errors.std(axis=0), strict=True)
            lines.append(f"| {scenario.name} | {way} | " + " | ".join(f"{b:+.2f} ± {s:.2g}" for b, s in pairs) + " |")
    return "\n".join(lines)


def response(stack: Float[np.ndarray, "3"], time: Float[np.ndarray, " n"], voltage: float) -> Float[np.ndarray, " n"]:
    """The platform after a step at t = 0 [m] (4.2); `stack` is gain, natural frequency and damping ratio."""
    gain, rate, damping = stack
    elapsed, ring = np.maximum(time, 0.0), rate * np.sqrt(1.0 - damping**2)
    wave = np.cos(ring * elapsed) + damping * rate / ring * np.sin(ring * elapsed)
    return gain * voltage * (1.0 - np.exp(-damping * rate * elapsed) * wave)


class _Joint:
    """One Gauss-Newton step of everything; a damping ratio that is `fixed` is that far off."""

    def __init__(self, steps: Float[np.ndarray, "m 3"], walks: Float[np.ndarray, "n p"], fixed: float):
        self.whole = np.zeros((len(steps) + len(walks), walks.shape[1]))
        self.whole[: len(steps), :3], self.whole[len(steps) :] = steps, walks
        self.free = np.ones(walks.shape[1], bool)
        self.free[2] = np.isnan(fixed)
        self.given = np.where(self.free, 0.0, fixed)
        self.inverse = np.linalg.pinv(self.whole[:, self.free])

    def __call__(self, rest: Float[np.ndarray, " m"], noise: Float[np.ndarray, " n"]) -> Float[np.ndarray, " p"]:
        """The errors that residuals of the steps and of the walks make."""
        out = self.given.copy()
        out[self.free] = -self.inverse @ (np.concatenate([rest, noise]) + self.whole @ self.given)
        return out


def _least_squares(drawn: Study, truth: Float[np.ndarray, "3"], fixed: float) -> Float[np.ndarray, "3"]:
    """Error of the logarithms by least squares on the step records, each with its zero."""
    logs = np.log(truth)
    free = [0, 1, 2] if np.isnan(fixed) else [0, 1]
    if not np.isnan(fixed):
        logs[2] += fixed
    for _ in range(_ROUNDS):
        stack = np.exp(logs)
        slopes = np.concatenate([_slopes(stack, r.time, _volts(r)) for r in drawn.records])[:, free]
        rest = [_centred(r.measured - response(stack, r.time, _volts(r))) for r in drawn.records]
        logs[free] += np.linalg.lstsq(slopes, np.concatenate(rest), rcond=None)[0]
    return logs - np.log(truth)


def _slopes(stack: Float[np.ndarray, "3"], time: Float[np.ndarray, " n"], voltage: float) -> Float[np.ndarray, "n 3"]:
    """Derivatives of the response by the logarithms, the record's zero taken out."""
    ends = [[response(stack * np.exp(way * _SMALL * row), time, voltage) for row in np.eye(3)] for way in (1, -1)]
    return np.stack([_centred(up - down) / (2.0 * _SMALL) for up, down in zip(*ends, strict=True)], axis=1)


def _centred(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    return values - np.mean(values)


def _steps(scenario: Scenario) -> Study:
    """The packaged study with the step records that the scenario uses, still to be made."""
    study = pdssjax.load_study(EXAMPLE / "study.toml")
    records = [record for record in study.records if is_step(record) and (not scenario.one_step or record.name == KEPT)]
    time = scenario.interval * np.arange(round(BEFORE / scenario.interval), round(AFTER / scenario.interval))
    made = [dataclasses.replace(r, time=time, measured=np.zeros(time.size), noise=scenario.noise) for r in records]
    return dataclasses.replace(study, records=tuple(made))


def _drawn(study: Study, scenario: Scenario, random: np.random.Generator) -> Study:
    truth, behind = _known_stack(), scenario.interval if scenario.late else 0.0
    records = [
        dataclasses.replace(
            r,
            measured=response(truth, r.time - behind, _volts(r)) + scenario.noise * random.standard_normal(r.time.size),
        )
        for r in study.records
    ]
    return dataclasses.replace(study, records=tuple(records))


def _volts(record: Record) -> float:
    assert record.drive is not None
    return float(record.drive.peak())


@functools.cache
def _known_stack() -> Float[np.ndarray, "3"]:
    known = known_truth()
    return np.array([known[path] for path in STACK])
