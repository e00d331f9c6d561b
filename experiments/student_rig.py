"""From the files of a student project's rig to its law, its parameters and a walk that was not fitted.

Such projects sample a walk of 15 s at 1 kHz, 20 samples a cycle of a function generator's ramp of 50 Hz that rises for
97 to 99 % of it; the force of the stack grows with the square of the voltage, too, and nobody weighed the slider.  Here
SciPy's LSODA makes the files, by equations that are written out below and share nothing with the package: a stack of
second order under c V + c2 V^2, and LuGre's law with Stribeck's curve.

Two ramps and two voltages are fitted, from no starts but the stack's ringing as a data sheet has it, 4 % off; the walk
under the third ramp is predicted over all its 15 s.  A friction law knows of a mass only ratios: the study's is 50 g
where the truth is 45, and forces are compared by the mass.

    python -m experiments.student_rig
    python -m experiments.student_rig --quick    # the simplified law alone, and 2 s to predict
"""

import argparse
import csv
import itertools
from collections.abc import Iterable
from concurrent.futures import Executor
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

import pdssjax
from experiments.common import BLUE, OUT, VERMILION, Row, print_table, save, styled, write
from pdssjax import Comparison, Estimate, prepare_jax

NAME = "student_rig"
LAWS = {
    "dahl": ("sigma0", "f_c"),
    "simplified-lugre": ("sigma0", "sigma1", "f_ss"),
    "lugre": ("sigma0", "sigma1", "f_c", "f_s", "v_s"),
}
SIMPLIFIED = "simplified-lugre"
FREQUENCY, INTERVAL = 50.0, 1e-3
"""Cycles a second [Hz], and between samples [s]."""
NOISE, MONITOR = 50e-9, 0.02
"""Standard deviation of the noise of the motion [m] and of the voltage in the files [V]."""
FITTED, PREDICTED = 1.0, 15.0
"""Seconds of the walks that are fitted, and of the one that is predicted."""

MASS, POSED_MASS = 0.045, 0.050
"""Of the slider, true and in the study [kg]."""
STACK = {"gain": 4.0e-8, "asymmetry_2": 3.0e-10, "natural_frequency": 5200.0, "damping_ratio": 0.08}
CONTACT = {"sigma0": 4.0e5, "sigma1": 60.0, "f_c": 0.14, "f_s": 0.17, "v_s": 2e-3}
"""The truth [SI]."""

WALKS = {"97": (0.97, 100.0), "99": (0.99, 100.0), "99 at 60 V": (0.99, 60.0), "98": (0.98, 100.0)}
"""Part of the cycle in which the ramp rises, and voltage [V], by name; the last is predicted."""

STUDY = """
format = "pdssjax-study/1"
title = "a student project's rig, {law}"

[actuator]
piezo = {{ dynamics = "second-order", hysteresis = {{ law = "none", asymmetry = 2 }} }}
friction = "{law}"

[parameters]
"effector.mass" = {{ value = "{mass} kg" }}
"piezo.gain" = {{}}
"piezo.asymmetry_*" = {{}}
"piezo.natural_frequency" = {{ start = "5000 rad/s" }}
"piezo.damping_ratio" = {{ start = 0.1 }}
{contact}
"""

RECORD = """
[[record]]
name = "ramp {name}"
file = "{file}"
columns = {{ time = "Time", displacement = "Slider" }}
measures = "effector"
role = "{role}"
noise = "0.05 um"
drive = {{ waveform = "triangle", voltage = "{voltage} V", frequency = "50 Hz", symmetry = {rises} }}
"""


def voltage(time: Float[np.ndarray, " n"], rises: float, peak: float) -> Float[np.ndarray, " n"]:
    """The ramp [V] at `time` [s]."""
    phase = np.mod(time * FREQUENCY, 1.0)
    return peak * np.where(phase < rises, phase / rises, (1.0 - phase) / (1.0 - rises))


def walk(rises: float, peak: float, seconds: float) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Sample times [s] and the slider's displacement [m], by LSODA from corner to corner of the ramp."""
    from scipy.integrate import solve_ivp

    stack, contact = STACK, CONTACT
    rate, damping = stack["natural_frequency"], stack["damping_ratio"]

    def motion(time: float, state: Float[np.ndarray, "5"]) -> list[float]:
        y, y_rate, _, x_rate, bristle = state
        volts = float(voltage(np.array(time), rises, peak))
        aim = stack["gain"] * volts + stack["asymmetry_2"] * volts**2
        sliding = y_rate - x_rate
        stribeck = (contact["f_s"] - contact["f_c"]) * np.exp(-((sliding / contact["v_s"]) ** 2))
        bends = sliding - abs(sliding) * contact["sigma0"] / (contact["f_c"] + stribeck) * bristle
        force = contact["sigma0"] * bristle + contact["sigma1"] * bends
        return [y_rate, rate**2 * (aim - y) - 2.0 * rate * damping * y_rate, x_rate, force / MASS, bends]

    time = np.arange(round(seconds / INTERVAL)) * INTERVAL
    begins = np.arange(0.0, seconds, 1.0 / FREQUENCY)
    corners = np.unique([*begins, *(begins + rises / FREQUENCY)])
    corners = np.append(corners[corners < seconds - 1e-9], seconds)
    state, shown, tiny = np.zeros(5), np.zeros(time.size), 1e-12
    for begin, end in itertools.pairwise(corners):
        here = (time >= begin - tiny) & (time < end - tiny)
        at = np.append(np.maximum(time[here], begin), end)
        found = solve_ivp(
            motion, (begin, end), state, "LSODA", at, rtol=1e-7, atol=[1e-11, 1e-7, 1e-11, 1e-7, 1e-11], max_step=4e-4
        )
        shown[here], state = found.y[2][:-1], found.y[:, -1]
    return time, shown


def write_walks(folder: Path, predicted: float = PREDICTED, seed: int = 5) -> str:
    """Write the files of all walks to a `folder`, the last of so many seconds; returns what a study says of them."""
    random, text = np.random.default_rng(seed), ""
    folder.mkdir(parents=True, exist_ok=True)
    for name, (rises, peak) in WALKS.items():
        last = name == [*WALKS][-1]
        time, shown = walk(rises, peak, predicted if last else FITTED)
        volts = voltage(time, rises, peak) + MONITOR * random.normal(size=time.size)
        shown = shown + NOISE * random.normal(size=time.size)
        file = folder / f"ramp_{name.replace(' ', '_')}.csv"
        with open(file, "w", newline="", encoding="utf-8") as stream:
            rows = zip(*(np.round(column, 4) for column in (time, volts, 1e6 * shown)), strict=True)
            csv.writer(stream).writerows([("Time (s)", "Drive (V)", "Slider (um)"), *rows])
        role = "validate" if last else "fit"
        text += RECORD.format(name=name, file=file.name, role=role, voltage=peak, rises=rises)
    return text


def write_study(folder: Path, records: str, law: str = SIMPLIFIED) -> Path:
    """Write the study of these `records` with a friction `law` beside their files; returns where it is."""
    contact = "\n".join(f'"friction.{name}" = {{}}' for name in LAWS[law])
    path = folder / "rig.toml"
    path.write_text(STUDY.format(law=law, mass=POSED_MASS, contact=contact) + records, encoding="utf-8")
    return path


def answered(path: Path, laws: Iterable[str] = LAWS, executor: Executor | None = None) -> Comparison:
    """Which law the files support."""
    return pdssjax.compare(pdssjax.load_study(path), friction=laws, executor=executor)


def rows(estimate: Estimate) -> list[Row]:
    """The fitted parameters beside the truth, and the walk that was not fitted."""
    share = POSED_MASS / MASS
    truths = {f"piezo.{name}": number for name, number in STACK.items()}
    truths |= {f"friction.{name}": share * CONTACT[name] for name in ("sigma0", "sigma1")}
    truths |= {f"friction.{name}": share * CONTACT["f_c"] for name in ("f_ss", "f_c")}
    out = []
    for path, parameter in estimate.parameters.items():
        if path in truths and parameter.free:
            away = f"+- {100 * parameter.standard_error / parameter.value:.2g} %, truth {truths[path]:.5g}"
            apart = 100 * (parameter.value / truths[path] - 1.0)
            out.append(Row(path, None, f"{parameter.value:.5g}", parameter.unit, f"{away}: {apart:+.2f} %"))
    for record in estimate.records:
        why = "not fitted" if record.role == "validate" else "fitted"
        out.append(Row(f"misfit of {record.name}", None, 1e6 * record.rmse, "um", f"{why}; noise 0.05 um"))
    return out


def draw(estimate: Estimate) -> Figure:
    """The walk that was not fitted: three of its last cycles, and all its residuals."""
    record = estimate.records[-1]
    figure = Figure(figsize=(7.0, 3.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    last = slice(-60, None)
    left.plot(record.time[last], 1e6 * record.measured[last], ".", color=BLUE, label="measured")
    left.plot(record.time[last], 1e6 * record.predicted[last], color=VERMILION, label="predicted")
    left.set(xlabel="time [s]", ylabel="displacement [um]", title=f"{record.name} %, not fitted")
    left.legend()
    right.plot(record.time, 1e6 * (record.measured - record.predicted), ".", ms=1.5, color=BLUE)
    right.set(xlabel="time [s]", ylabel="measured less predicted [um]", title="All of its residuals")
    return figure


def main() -> None:
    """Print the tables and save the figure."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true", help="the simplified law alone, and 2 s to predict")
    quick = parser.parse_args().quick
    prepare_jax(dedicated=True)
    folder, law, text = OUT / NAME, SIMPLIFIED, list[str]()
    records = write_walks(folder, 2.0 if quick else PREDICTED)
    if not quick:
        found = answered(write_study(folder, records))
        law = found.chosen or law
        names = [f"{r.name} ({'worse' if r.is_worse else 'as good'})" for r in found.results if r.name != law]
        row = Row("simplest law that is enough", None, found.chosen or "no fit", "", ", ".join(names))
        text.append(print_table("Which law", [row]))
    estimate = pdssjax.identify(pdssjax.load_study(write_study(folder, records, law)), progress=print)
    title = f"A student project's rig with the law {law}, from no starts"
    write("\n\n".join([*text, print_table(title, rows(estimate))]), NAME)
    with styled():
        save(draw(estimate), NAME)


if __name__ == "__main__":
    main()
