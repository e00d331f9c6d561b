"""A made-up estimate with every feature a report, a plot or a file must cope with."""

import dataclasses
import math
from typing import Literal

import numpy as np

from pdssjax import Estimate
from pdssjax.study import (
    Amplification,
    Draws,
    ErrorAdvice,
    FittedParameter,
    FittedRecord,
    Multistart,
    ParameterDraws,
    ParameterError,
    Profile,
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


def profiles(parameters) -> tuple[Profile, ...]:
    """Of three of the `parameters` of `estimate`: a parabola, a bent one, and one with a flat side."""
    along = np.linspace(-1.0, 1.0, 25)
    shapes = {
        "piezo.gain": (3.84 * along**2, "bounded"),
        "friction.sigma0_a": (3.84 * along**2 * (1.0 - 0.4 * along) / 0.6, "bounded"),
        "friction.sigma1_a": (np.where(along < 0, 3.84 * along**2, 1.0 - np.exp(-2 * along**2)), "one-sided"),
    }
    return tuple(
        Profile(
            path=path,
            value=parameters[path].value + 1.96 * parameters[path].standard_error * along,
            excess=excess,
            linear=3.84 * along**2,
            computed=np.arange(25) % 3 == 0,
            threshold=3.84,
            verdict=verdict,
            quality=0.97,
            evaluations=12,
        )
        for path, (excess, verdict) in shapes.items()
    )


def multistart(parameters) -> Multistart:
    """Ends of 20 starts: 12 in the best optimum, 4 and 2 in others, 1 not converged, 1 that failed."""
    free = [p for p in parameters.values() if p.free and p.value]
    best = np.array([p.value for p in free])
    random = np.random.default_rng(11)
    optimum = np.array([0] * 12 + [1] * 4 + [2] * 2 + [-1] * 2)
    factors = np.array([1.0, 1.06, 0.7, 1.5])[optimum]
    chi2 = 5590.0 + np.array([1e-4, 31.0, 420.0, 9000.0])[optimum] + 1e-3 * random.random(20)
    chi2[-1] = np.inf
    return Multistart(
        names=tuple(p.path for p in free),
        chi2=np.sort(chi2),
        converged=optimum >= 0,
        starts=best * random.uniform(0.5, 2.0, (20, len(free))),
        ends=best * factors[:, None] ** random.normal(size=len(free)),
        optimum=optimum,
        iterations=np.full(20, 9),
        ranges={p.path: (0.5 * p.value, 2.0 * p.value) for p in free[:-1]},
    )


def draws(parameters, kind: Literal["bootstrap", "posterior"]) -> Draws:
    """Normal ones of two of the `parameters` of `estimate`."""
    names = "piezo.gain", "friction.sigma1_a"
    shape = (1, 40) if kind == "bootstrap" else (4, 25)
    random = np.random.default_rng(7)
    centre, errors = (np.array([getattr(parameters[n], what) for n in names]) for what in ("value", "standard_error"))
    values = centre + errors * random.normal(size=(*shape, 2))
    chains = {} if kind == "bootstrap" else {"rhat": 1.004, "effective": 812.0, "effective_tails": 644.2}
    summaries = tuple(
        ParameterDraws(
            name,
            float(np.mean(values[:, :, i])),
            float(np.std(values[:, :, i])),
            (float(centre[i] - 2 * errors[i]), float(centre[i] + 2 * errors[i])),
            (float(centre[i] - 1.8 * errors[i]), float(centre[i] + 2.2 * errors[i])) if kind == "bootstrap" else None,
            **chains,
        )
        for i, name in enumerate(names)
    )
    statistics = {"lp": np.full(shape, -7.0), "accepted": np.ones(shape, bool)}
    more = {} if kind == "bootstrap" else statistics
    failure = "did not converge and are left out" if kind == "bootstrap" else "proposals refused by the model"
    return Draws(kind, "white noise", names, values, 3, failure, 5, summaries, more)
