"""A made-up estimate with every feature a report, a plot or a file must cope with."""

import dataclasses
import math
from typing import Literal

import numpy as np

from pdssjax import Estimate
from pdssjax.study import (
    Amplification,
    ErrorAdvice,
    FittedParameter,
    FittedRecord,
    ParameterError,
    Statistics,
)

NAN = math.nan


def parameter(path, value, error, unit, **changes) -> FittedParameter:
    """A free, informed parameter; `changes` replace its fields."""
    plain = FittedParameter(
        path, value, error, (value - 2 * error, value + 2 * error), unit, True, 1.2 * value, False, True
    )
    return dataclasses.replace(plain, **changes)


def fixed(path, value, unit) -> FittedParameter:
    """A parameter that was held at `value`."""
    return FittedParameter(path, value, NAN, (NAN, NAN), unit, False, None, False, True)


def record(name, role, measures, time, motion, *, simulated=True, offset=1e-7) -> FittedRecord:
    """A record of `motion` [m] with noise; `simulated=False` stands for a failed simulation."""
    noise = 1.04e-8
    measured = motion + offset + np.random.default_rng(5).normal(0.0, noise, len(time))
    predicted = motion + offset if simulated else np.full(len(time), NAN)
    rmse = float(np.sqrt(np.mean((measured - predicted) ** 2)))
    r2 = 1.0 - rmse**2 / float(np.var(measured))
    return FittedRecord(
        name, role, measures, len(time), r2, rmse, rmse, noise, offset, 1e-9, time, measured, predicted, simulated
    )


def step_motion(time, height=4.8e-6, rate=6736.0, damping=0.1772):
    """The platform after a step at t = 0 [m]."""
    ring = rate * math.sqrt(1.0 - damping**2)
    phase = ring * np.maximum(time, 0.0)
    fade = np.exp(-damping * rate * np.maximum(time, 0.0))
    return height * (1.0 - fade * (np.cos(phase) + damping * rate / ring * np.sin(phase)))


def walk_motion(time, frequency=5.0, stroke=6.5e-6, back=2e-6):
    """An end-effector that walks: a ramp each cycle, then a slip that rings down [m]."""
    cycle, phase = np.divmod(time * frequency, 1.0)
    slip = np.where(cycle > 0, back * np.exp(-phase * 60) * np.cos(250 * phase), 0.0)
    return stroke * (cycle + phase) - back * cycle + slip


def estimate(method: Literal["joint", "sequential", "peaks"] = "joint", converged: bool = True) -> Estimate:
    """Nine parameters, four records; one parameter without information, one at its bound."""
    naive = {} if method == "joint" else {"naive_standard_error": 0.4}
    parameters = [
        parameter("piezo.gain", 1.00702e-7, 7.0e-12, "m/V"),
        parameter("piezo.natural_frequency", 6736.21, 0.77, "rad/s"),
        parameter("piezo.damping_ratio", 0.17717, 1.06e-4, ""),
        parameter("friction.sigma0_a", 1.1484e6, 5.1e4, "N/m"),
        parameter("friction.sigma1_a", 54.4, 6.2, "N s/m", **naive),
        parameter("friction.f_ss_a", 0.7964, 0.011, "N"),
        parameter("drive.fall_time", 0.0, 1e-6, "s", at_bound=True),
        parameter("effector.load", 0.1, NAN, "N", interval=(NAN, NAN), identifiable=False),
        fixed("effector.mass", 0.086, "kg"),
    ]
    names = tuple(p.path for p in parameters if p.free)
    scatter = np.random.default_rng(3).normal(size=(len(names), 12))
    correlation = np.atleast_2d(np.corrcoef(scatter))
    correlation[-1] = correlation[:, -1] = NAN
    errors = np.array([p.standard_error for p in parameters if p.free])
    fine = np.arange(-0.005, 0.035, 5e-5)
    coarse = np.arange(0.2, 1.8, 1e-3)
    return Estimate(
        title="Rig, July",
        method=method,
        converged=converged,
        message="The step became smaller than the tolerance." if converged else "No progress after 50 iterations.",
        parameters={p.path: p for p in parameters},
        names=names,
        correlation=correlation,
        covariance=correlation * np.outer(errors, errors),
        records=(
            record("step 48.2 V", "fit", "platform", fine, step_motion(fine)),
            record("5 Hz A", "fit", "effector", coarse, walk_motion(coarse)),
            record("20 Hz A", "validate", "effector", coarse, walk_motion(coarse, 20.0)),
            record("lost/run", "validate", "effector", coarse, walk_motion(coarse), simulated=False),
        ),
        statistics=Statistics(5590.1, 0.9987, -47920.3, -47841.1, 14, 9, 5605, 13),
        notes=("The data say nothing about effector.load; it stays at its start.",),
        seconds=4.81,
        amplification=amplification(),
    )


def with_errors(whole: Estimate) -> Estimate:
    """An estimate whose parameters have errors by three models, each twice as large as the one before."""
    parameters = {}
    for path, p in whole.parameters.items():
        errors = {
            name: ParameterError(factor * p.standard_error, (p.value - 2 * factor, p.value + 2 * factor))
            for name, factor in (("white", 1.0), ("coloured", 2.0), ("with-misfit", 4.0))
        }
        known = p.free and math.isfinite(p.standard_error)
        parameters[path] = dataclasses.replace(p, errors=errors) if known else p
    return dataclasses.replace(
        whole,
        parameters=parameters,
        error_advice=ErrorAdvice("with-misfit", 'Believe the errors with misfit: residuals in "5 Hz A" repeat.'),
        covariances={name: f**2 * whole.covariance for name, f in (("white", 1), ("coloured", 2), ("with-misfit", 4))},
    )


def amplification() -> Amplification:
    """A gain to which two friction parameters are sensitive; one entry far above the others."""
    return Amplification(
        ("friction.sigma0_a", "friction.sigma1_a", "friction.f_ss_a"),
        ("piezo.gain", "piezo.natural_frequency", "piezo.damping_ratio"),
        np.array([[-12.5, 0.31, 0.02], [98.7, -2.2, 0.4], [1.02, 0.0, -0.001]]),
    )
