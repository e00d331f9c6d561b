"""What do the three errors of a parameter cover when the friction law, the voltage and the noise are wrong?

A contact of LuGre with a Stribeck curve is driven by a sawtooth whose fall takes 0.3 ms and rings on at 1.5 kHz, and
recorded with autoregressive noise.  It is fitted by the simplified law with a sawtooth of straight flanks and a free
fall time.  Counted is how often the 95 % intervals hold the pseudo-true parameters, those of the fit without noise.

    python -m experiments.wrong_law [DRAWS]    # resumes where it was left
"""

import dataclasses
import functools
import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from scipy import stats

import pdssjax
from experiments.common import BLUE, GREEN, OUT, VERMILION, Row, print_table, save, styled
from experiments.coverage_figure import draw_coverage
from experiments.draws import numbered_results
from pdssjax import Estimate, Record, Study, prepare_jax
from pdssjax.drive.sampled import Sampled
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.inference import Evidence, joint, with_error_models

NAME = "wrong_law"
DRAWS = 60
NOISE, CORRELATION = 2e-8, 0.8
"""Of the records [m], and of neighbouring samples of it."""
FREQUENCY, VOLTAGE, CYCLES = 20.0, 60.0, 8
"""Of the walks [Hz, V]."""
FALL, RINGING, DECAY, OVERSHOOT = 3e-4, 1500.0, 2500.0, 0.1
"""The fall of the voltage [s], what it rings with [Hz], how that decays [1/s], and its height beside the voltage."""
MODELS = {"white": BLUE, "coloured": VERMILION, "with-misfit": GREEN}

TEXT = """\
format = "pdssjax-study/1"
title = "The wrong law"
[actuator]
piezo = "second-order"
friction = "{law}"
[parameters]
"effector.mass" = {{ value = "86 g" }}
"piezo.gain" = {{ start = "0.1 um/V" }}
"piezo.natural_frequency" = {{ start = "6700 rad/s" }}
"piezo.damping_ratio" = {{ start = 0.18 }}
{more}
[[record]]
name = "step"
file = "step.csv"
columns = {{ time = "time_ms", displacement = "y_um" }}
measures = "platform"
sampling = {{ start = "-1 ms", end = "20 ms", interval = "50 us" }}
drive = {{ waveform = "step", voltage = "60 V" }}
"""
WALK = """
[[record]]
name = "{direction}"
file = "{direction}.csv"
columns = {{ time = "time_s", displacement = "x_um" }}
measures = "effector"
sampling = {{ end = "{end} s", interval = "0.5 ms" }}
drive = {{ waveform = "sawtooth", direction = "{direction}", voltage = "{voltage} V", frequency = "{frequency} Hz" }}
"""
RIGHT = {"sigma0": "1 N/um", "sigma1": "45 N s/m", "f_c": "0.55 N", "f_s": "0.65 N", "v_s": "1 mm/s"}
WRONG = {"sigma0": "1 N/um", "sigma1": "45 N s/m", "f_ss": "0.6 N"}

Result = dict[str, Any]
"""Of one draw: by parameter, its value and three standard errors."""


def planned(law: str, contact: dict[str, str], more: str = "") -> Study:
    """The study with one of the laws, its records still to be made."""
    listed = "".join(f'"friction.{name}" = {{ start = "{start}" }}\n' for name, start in contact.items())
    numbers = dict(end=CYCLES / FREQUENCY, voltage=VOLTAGE, frequency=FREQUENCY)
    walks = "".join(WALK.format(direction=direction, **numbers) for direction in ("forward", "backward"))
    folder = OUT / NAME
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{law}.toml"
    file.write_text(TEXT.format(law=law, more=listed + more) + walks, encoding="utf-8")
    return pdssjax.load_study(file, virtual=True)


def ringing(record: Record) -> Record:
    """The record under a voltage that falls in a time and rings on; as it is where that does not walk."""
    drive = record.drive
    if not isinstance(drive, Sawtooth):
        return record
    falls = dataclasses.replace(drive, fall_time=FALL)
    starts = np.arange(CYCLES + 1) / FREQUENCY
    after = np.linspace(0.0, 2e-3, 41)
    times = np.unique(np.concatenate([starts, (starts[:, None] + FALL + after).ravel()]))
    since = np.mod(times, 1.0 / FREQUENCY) - FALL
    forward = float(drive.direction) > 0
    rings = (since > 0) & (since < 2e-3) & ((times > 1.0 / FREQUENCY) | (not forward))
    sign = -1.0 if forward else 1.0
    ring = OVERSHOOT * VOLTAGE * np.exp(-DECAY * since) * np.sin(2.0 * np.pi * RINGING * since)
    volts = np.asarray(falls.at(jnp.asarray(times))) + np.where(rings, sign * ring, 0.0)
    return dataclasses.replace(record, drive=Sampled(times, volts))


class Made(NamedTuple):
    """What all draws share."""

    study: Study
    """The one to fit."""
    motions: tuple[Float[np.ndarray, " n"], ...]
    """What there is to be measured [m]."""
    clean: Estimate
    """Of records without noise: its parameters are the pseudo-true ones."""

    @property
    def pseudo(self) -> dict[str, float]:
        """The pseudo-true parameters that are fitted [SI]."""
        return {path: p.value for path, p in self.clean.parameters.items() if p.free}


@functools.cache
def made() -> Made:
    """What all draws share, made once."""
    prepare_jax(dedicated=True)  # in another process, too
    right = planned("lugre", RIGHT)
    right = dataclasses.replace(right, records=tuple(map(ringing, right.records)))
    truth = {path: float((p.start if p.free else p.value) or 0.0) for path, p in right.parameters.items()}
    motions = tuple(np.asarray(motion) for motion in right.predict(truth))
    study = planned("simplified-lugre", WRONG, '"drive.fall_time" = { start = "0.3 ms" }\n')
    return Made(study, motions, pdssjax.identify(measured(study, motions)))


def measured(study: Study, motions: Sequence[Float[np.ndarray, " n"]]) -> Study:
    """The study with its records, and the size of their noise."""
    records = tuple(
        dataclasses.replace(record, measured=motion, noise=NOISE)
        for record, motion in zip(study.records, motions, strict=True)
    )
    return dataclasses.replace(study, records=records)


def coloured(size: int, random: np.random.Generator) -> Float[np.ndarray, " n"]:
    """Autoregressive noise [m]."""
    out = random.standard_normal(size)
    for i in range(1, size):
        out[i] = CORRELATION * out[i - 1] + np.sqrt(1.0 - CORRELATION**2) * out[i]
    return NOISE * out


def drawn(number: int) -> Result:
    """A draw of the noise, fitted from the pseudo-true parameters on: no search, which is another matter."""
    study, motions, clean = made()
    random = np.random.default_rng([24, number])
    quiet = lambda message: None
    pseudo = made().pseudo
    noisy = measured(study.with_starts(pseudo), [motion + coloured(motion.size, random) for motion in motions])
    problem, starts = pdssjax.pose_problem(noisy)
    fit = joint(problem, problem.decode(np.asarray(starts)), quiet)
    samples = sum(motion.size for motion in motions)
    reduced = fit.chi2 / (samples - fit.free.size - len(motions))
    estimate = dataclasses.replace(
        clean, statistics=dataclasses.replace(clean.statistics, chi2=fit.chi2, reduced_chi2=reduced)
    )
    found, values = with_error_models(estimate, Evidence(problem, fit), quiet), problem.decode(fit.free)
    errors = {path: [found.parameters[path].errors[m].standard_error for m in MODELS] for path in pseudo}
    return {
        "pseudo": pseudo,
        "converged": bool(fit.success),
        "parameters": {path: [float(values[path]), *errors[path]] for path in pseudo},
    }


def coverage(results: Sequence[Result]) -> Float[np.ndarray, "models p"]:
    """Share of the 95 % intervals that hold the pseudo-true parameter."""
    inside = [
        [[abs(value - each["pseudo"][path]) < 1.96 * error for error in errors] for path, (value, *errors) in told]
        for each in results
        for told in [each["parameters"].items()]
    ]
    return np.mean(inside, axis=0).T


def widths(results: Sequence[Result]) -> dict[str, tuple[float, float]]:
    """By parameter, errors with misfit over coloured ones, and the coverage of the pseudo-true one that follows.

    The misfit is the same in every draw, so that estimates scatter by the coloured errors alone.
    """
    told = [[each["parameters"][path][2:] for each in results] for path in results[0]["parameters"]]
    ratios = [float(np.sqrt(np.divide(*np.mean(np.square(errors), axis=0)[::-1]))) for errors in told]
    return {
        path: (ratio, float(2.0 * stats.norm.cdf(1.96 * ratio) - 1.0))
        for path, ratio in zip(results[0]["parameters"], ratios, strict=True)
    }


def rows(results: Sequence[Result]) -> list[Row]:
    """Coverage of every parameter by every model, per cent, and what errors with misfit let one expect."""
    shares = coverage(results)
    out = []
    for i, (path, (ratio, follows)) in enumerate(widths(results).items()):
        held = " / ".join(f"{100 * share:.0f}" for share in shares[:, i])
        out.append(Row(f"{path}: {', '.join(MODELS)}", None, held, "%"))
        out.append(Row(f"{path}: with misfit over coloured", None, ratio, "", f"{100 * follows:.1f} % follow"))
    return out


def draw(results: Sequence[Result]) -> Figure:
    """The same as a picture."""
    return draw_coverage(
        {model.replace("-", " "): 100.0 * shares for model, shares in zip(MODELS, coverage(results), strict=True)},
        list(MODELS.values()),
        list(results[0]["parameters"]),
        len(results),
        f"LuGre and a ringing voltage, fitted by the simplified law; {len(results)} draws",
        "95 % intervals that hold\nthe pseudo-true parameter (%)",
    )


def main(draws: int = DRAWS) -> None:
    """Print the table and draw the figure."""
    made()  # before threads ask for it
    results = numbered_results(draws, drawn, OUT / NAME)
    print_table(f"Coverage of the pseudo-true parameters, {draws} draws", rows(results), NAME)
    with styled():
        save(draw(results), NAME)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
