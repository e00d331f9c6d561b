"""Which friction law explains measured presliding loops? (thesis, section 5.2: its laws, each with one contact alone)

A reciprocating tribometer's record: a contact under 5 N, moved to and fro by 0.23 mm, with a rest of 1 s at
each end.  After a reversal the force follows over some 100 um before the contact slides: presliding,
with the compliance of the tester in it.  Only friction is measured here, so no other parameter can
make up for a wrong law.

The record is not part of this repository: examples/test_data_2.txt of github.com/jchristopherson/FrictionModels.jl
(MIT licence, "experimental data"; contact and instrument are not stated).  Put it at
experiments/reciprocating.tsv, or name its place.

What is done to it: means over 10 samples (50 ms, at most 13 um of motion), of motion and force alike; while it
rests, only the first and the last mean are kept; the force's sign is turned, so that it has
that of the motion.  The model begins undeflected, as the tester did before it was loaded: the sample of
the unloaded tester comes first, and then three cycles from the middle of a slide on.  Three cycles
at 100 s are fitted, three at 40 s and three at 160 s are predicted, each record with its own zero.

Speed hardly varies, so what a law says of the velocity is held or poorly known: sigma2 is 0, and exponents
and Stribeck velocities have the errors that they have.  Bristle friction is left out: with some
240 snaps a cycle, each an event, it takes longer than all others together.

    python -m experiments.tribometer [RECORD]
"""

import concurrent.futures
import dataclasses
import math
import multiprocessing
import os
import sys
import tempfile
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

import pdssjax
from experiments.common import BLUE, GREEN, ORANGE, VERMILION, Row, print_table, save, styled, write
from experiments.fits import Curves, Found
from pdssjax import Accuracy, Study, Taylor, prepare_jax
from pdssjax.core import member, quantities
from pdssjax.inference import guess_starts
from pdssjax.metrics import error_index

NAME = "tribometer"
PLACE = Path(__file__).with_name("reciprocating.tsv")
SOURCE = "github.com/jchristopherson/FrictionModels.jl, examples/test_data_2.txt (MIT)"
LAWS = {
    "generalized-maxwell-slip": ("generalized-maxwell-slip", "deflection"),
    "elastoplastic": ("elastoplastic", "deflection"),
    "dahl, n free": ("dahl", "deflection"),
    "lugre": ("lugre", "deflection"),
    "bliman-sorine": ("bliman-sorine", "deflection"),
    "anisotropic-lugre, force": ("anisotropic-lugre", "force"),
    "anisotropic-lugre, deflection": ("anisotropic-lugre", "deflection"),
    "reset-integrator": ("reset-integrator", "deflection"),
    "simplified-lugre": ("simplified-lugre", "deflection"),
}
"""Law and reading by name; the slowest to compile first."""
ACCURACY = Accuracy(method=Taylor(4), tolerance=1e-8)
"""A hundredth of a micrometre, a thousandth of the sampling."""
MEAN = 10
"""Samples averaged."""
RESTS = 0.25e-6
"""From one mean to the next, less is no motion [m]."""
CYCLES = {"fitted": 101.4, "earlier": 41.4, "later": 161.4}
"""Where three cycles begin [s], in the middle of a slide; only the first are fitted."""
LENGTH = 12.0
UNLOADED = 5.0
"""A moment [s] at which the tester was not loaded yet."""
HELD = {"sigma2": 0.0}
"""Viscous friction, which these data cannot tell."""
TRIES = 8
"""Starts of a law; the first is the middle of the ranges that the package finds from the record."""


def prepared(place: Path) -> dict[str, Float[np.ndarray, "n 3"]]:
    """Time [s], motion [m] and friction [N] of each part of the record."""
    time, _, position, friction = np.loadtxt(place, skiprows=1, delimiter="\t").T
    whole = time.size // MEAN * MEAN
    mean = lambda a: a[:whole].reshape(-1, MEAN).mean(axis=1)
    time, motion, force = mean(time), 1e-3 * mean(position), -1e-6 * mean(friction)
    motion -= motion[0]
    moved = np.abs(np.diff(motion)) > RESTS
    kept = np.concatenate([[False], moved]) | np.concatenate([moved, [False]])
    before = np.argmin(np.abs(time - UNLOADED))
    out = {}
    for name, begin in CYCLES.items():
        part = np.flatnonzero(kept & (time >= begin) & (time < begin + LENGTH))
        part = np.concatenate([[before], part])
        out[name] = np.column_stack([time, motion, force])[part]
    return out


def study(law: str, reading: str, parts: dict[str, Float[np.ndarray, "n 3"]]) -> Study:
    """The parts of the record with one law."""
    entries = {
        name: f"{{ value = {HELD[name]} }}" if name in HELD else "{}" for name in quantities(member("friction", law))
    }
    text = (
        f'format = "pdssjax-study/1"\n[actuator]\npiezo = "second-order"\nfriction = "{law}"\n'
        f'friction_state = "{reading}"\n[parameters]\n'
        + "\n".join(f'"friction.{name}" = {entry}' for name, entry in entries.items())
    )
    with tempfile.TemporaryDirectory() as folder:
        for name, columns in parts.items():
            file = Path(folder) / f"{name}.csv"
            np.savetxt(file, columns, delimiter=",", header="time_s,motion_m,force_N", comments="", fmt="%.9g")
            role = "fit" if name == "fitted" else "validate"
            text += (
                f'\n[[record]]\nname = "{name}"\nfile = "{file.name}"\nmeasures = "friction"\nrole = "{role}"\n'
                'columns = { time = "time_s", motion = "motion_m", force = "force_N" }\n'
            )
        path = Path(folder) / "study.toml"
        path.write_text(text, encoding="utf-8")
        return pdssjax.load_study(path)


@dataclasses.dataclass(frozen=True)
class Fitted:
    """One law's results."""

    law: str
    found: Found
    units: dict[str, str]
    index: dict[str, float]
    """Error index [N] of each part."""

    @property
    def out(self) -> float:
        """Error index over both predicted parts [N]."""
        return math.hypot(self.index["earlier"], self.index["later"]) / math.sqrt(2.0)


def fit(law: str, parts: dict[str, Float[np.ndarray, "n 3"]]) -> Fitted:
    """Everything about one law, in a process of its own."""
    prepare_jax(dedicated=True)
    posed = study(*LAWS[law], parts)
    middle, _ = guess_starts(posed.models, posed.parameters, posed.records)
    curves = Curves(posed, ACCURACY, middle)
    used = [np.full(record.time.size, record.role == "fit") for record in posed.records]
    free = [path for path, parameter in posed.parameters.items() if parameter.free]
    random = np.random.default_rng(0)
    tried = []
    for number in range(TRIES):
        spread = np.exp(random.uniform(-1.2, 1.2, len(free))) if number else np.ones(len(free))
        starts = middle | {path: middle[path] * float(factor) for path, factor in zip(free, spread, strict=True)}
        tried.append(curves.fit(starts, free, used, limit=12))
    found = curves.fit(min(tried, key=lambda fitted: fitted.squares).values, free, used, limit=60)
    index = {
        record.name: error_index(record.measured, predicted)
        for record, predicted in zip(posed.records, found.predicted, strict=True)
    }
    return Fitted(law, found, {path: p.unit for path, p in posed.parameters.items()}, index)


def fit_all(place: Path) -> list[Fitted]:
    """Every law, two processes at a time, the best first."""
    parts = prepared(place)
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(min(2, os.cpu_count() or 1), mp_context=context) as pool:
        return sorted(pool.map(fit, LAWS, [parts] * len(LAWS)), key=lambda fitted: fitted.found.squares)


def repeatability(part: Float[np.ndarray, "n 3"]) -> float:
    """Error index [N] of a cycle predicted by the one before, 4 s earlier: what a perfect law would leave."""
    time, _, force = part[1:].T
    again = time >= time[0] + 4.0
    return error_index(force[again], np.interp(time[again] - 4.0, time, force))


def by_eye(part: Float[np.ndarray, "n 3"]) -> tuple[float, float]:
    """Presliding stiffness [N/m] and force of sliding [N], read off the loops without any law.

    The stiffness is that of straight lines through the samples with less than half of the force; the force is half
    the distance between its 90th and 10th percentiles.
    """
    _, motion, force = part[1:].T
    level = 0.5 * float(np.subtract(*np.percentile(force, [90.0, 10.0])))
    low = np.abs(force) < 0.5 * level
    places = np.flatnonzero(low)
    runs = np.split(places, np.flatnonzero(np.diff(places) > 1) + 1)
    slopes = [np.polyfit(motion[run], force[run], 1)[0] for run in runs if run.size > 3]
    return float(np.median(slopes)), level


def main(arguments: list[str]) -> None:
    """Print the tables and draw the figure, or say where the record can be had."""
    place = Path(arguments[0]) if arguments else PLACE
    if not place.exists():
        print(
            f"tribometer: there is no record at {place}.\nIt can be had from {SOURCE}; name its place as the argument."
        )
        return
    results = fit_all(place)
    parts = prepared(place)
    text = [
        print_table(
            "A reciprocating tribometer's presliding loops: error index (4.14) of each law",
            indices(results, parts),
            notes=[
                "The thesis has no such record. Three cycles fitted, six predicted; amplitude of the force 2.35 N. "
                "Every law begins at starts found from the record.",
            ],
        ),
        print_table(
            "The parameters, with one standard error",
            parameters(results, by_eye(parts["fitted"])),
            notes=[
                "Stiffness is that of contact and tester together. Neighbouring residuals are correlated (the loops "
                "are not quite of any law's shape), so that true errors are larger.",
                '"not told": the data do not say, or the parameter is at a bound.',
            ],
        ),
    ]
    write("\n\n".join(text), NAME)
    with styled():
        save(draw(results, parts), NAME)


def indices(results: list[Fitted], parts: dict[str, Float[np.ndarray, "n 3"]]) -> list[Row]:
    """Goodness by law, the best first."""
    best_a, best_b = min(r.found.aic for r in results), min(r.found.bic for r in results)
    rows = [
        Row(
            f"{r.law} ({r.found.free - 1} parameters)",
            None,
            r.index["fitted"],
            "N",
            f"predicted {r.out:.3f} N; AIC + {r.found.aic - best_a:.0f}, BIC + {r.found.bic - best_b:.0f}",
        )
        for r in results
    ]
    return [*rows, Row("the cycle before", None, repeatability(parts["fitted"]), "N", "what a perfect law would leave")]


def parameters(results: list[Fitted], read: tuple[float, float]) -> list[Row]:
    """What was found, with standard errors."""
    rows = [
        Row("read off the loops: stiffness", None, read[0], "N/m", "straight lines below half of the force"),
        Row("read off the loops: force", None, read[1], "N", "half the distance of the percentiles 10 and 90"),
    ]
    for r in results:
        for path, error in r.found.errors.items():
            why = f"+/- {error:.2g}" if error < abs(r.found.values[path]) else "not told"
            rows.append(Row(f"{r.law}: {path.split('.')[1]}", None, r.found.values[path], r.units[path], why))
    return rows


def draw(results: list[Fitted], parts: dict[str, Float[np.ndarray, "n 3"]]) -> Figure:
    """Measured loops, fitted and predicted, with four laws; below what they leave."""
    figure = Figure(figsize=(9.2, 5.2), layout="constrained")
    panels = figure.subplots(2, 3, height_ratios=(5, 2), sharex=True, sharey="row")
    shown = ["generalized-maxwell-slip", "dahl, n free", "reset-integrator", "simplified-lugre"]
    marks = dict(zip(shown, ((BLUE, "-"), (GREEN, "--"), (ORANGE, "-"), (VERMILION, "-")), strict=True))
    chosen = [r for r in results if r.law in marks]
    for (loop, rest), (name, part) in zip(panels.T, parts.items(), strict=True):
        time, motion, force = part[1:].T
        cycle = time < time[0] + 4.1
        place = 1e6 * (motion - 0.5 * (motion.min() + motion.max()))
        for r in chosen:
            colour, line = marks[r.law]
            predicted = r.found.predicted[list(parts).index(name)][1:]
            loop.plot(place[cycle], predicted[cycle], line, color=colour, linewidth=1.0, label=r.law)
            rest.plot(place[cycle], (force - predicted)[cycle], line, color=colour, linewidth=0.8)
        loop.plot(place, force, ".", color="black", markersize=2.5, label="measured, three cycles")
        loop.set_title(f"{'fitted' if name == 'fitted' else 'predicted'}, from {CYCLES[name]:.0f} s", fontsize=8.5)
        rest.set_xlabel("motion (um)")
    panels[0, 0].set_ylabel("friction (N)")
    panels[1, 0].set_ylabel("measured - law (N)")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5)
    return figure


if __name__ == "__main__":
    main(sys.argv[1:])
