"""Does a fit at 5 Hz predict 20 Hz? (thesis, section 5.4, figures 5.9 to 5.11)

The thesis fitted six friction parameters to 1.6 s of 64.2 V, 5 Hz in each direction, compared 2 s of the same
record with the model (r2 = 0.9987), and then 20 Hz, which was not fitted (r2 = 0.9946).  Its records
are not at hand.  The packaged ones stand in: same rig, voltage, frequencies and sampling, made by an
independent simulator with the thesis's parameters, noise and rounding to 0.01 um.  Here all nine
parameters are fitted together, to the three step tests and both 5 Hz records, without any start.

The records follow the model exactly, so r2 can only show that fit and prediction add no error of their
own.  What the thesis's r2 amount to in micrometres, and what r2 is left with the parameters that its
chapter 4 identified for the same piezo, stands beside.

    python -m experiments.identification
"""

import dataclasses
import json
import math

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

import pdssjax
from experiments.common import BLUE, VERMILION, Row, print_table, save, styled, write
from experiments.step_responses import CHAPTER_4
from pdssjax import Accuracy, Estimate, Record, Taylor, prepare_jax
from pdssjax.files import EXAMPLE
from pdssjax.metrics import r_squared
from pdssjax.study import FittedRecord

NAME = "identification"
THESIS = {"5 Hz": 0.9987, "20 Hz": 0.9946}
"""r2 of figures 5.9 and 5.11; the thesis does not say for which direction."""
ACCURACY = Accuracy(method=Taylor(8), tolerance=1e-10)
"""Errors far below the noise of 0.01 um, and compiled faster than the default."""


@dataclasses.dataclass(frozen=True)
class Result:
    """The fit, and what else predicts the same records."""

    estimate: Estimate
    truth: dict[str, float]
    """What the records were made with [SI]."""
    chapter_4: dict[str, float]
    """r2 of each sawtooth record with the true friction and chapter 4's piezo."""

    @property
    def walks(self) -> list[FittedRecord]:
        """The sawtooth records."""
        return [record for record in self.estimate.records if record.measures == "effector"]


def calculate() -> Result:
    """The fit without starts, and the predictions."""
    study = pdssjax.load_study(EXAMPLE / "study.toml")
    known = json.loads((EXAMPLE / "truth.json").read_text(encoding="utf-8"))["parameters"]
    truth = {path: known[path]["value"] for path in study.parameters}
    estimate = pdssjax.identify(study, accuracy=ACCURACY)
    piezo = {"gain": CHAPTER_4.gain, "natural_frequency": CHAPTER_4.frequency, "damping_ratio": CHAPTER_4.damping}
    predicted = study.predict(truth | {f"piezo.{name}": value for name, value in piezo.items()}, ACCURACY)
    chapter_4 = {
        record.name: _r2(record.measured, np.asarray(motion))
        for record, motion in zip(study.records, predicted, strict=True)
        if record.measures == "effector"
    }
    return Result(estimate, truth, chapter_4)


def _r2(measured: Float[np.ndarray, " n"], motion: Float[np.ndarray, " n"]) -> float:
    """r2 with the record's zero fitted."""
    return r_squared(measured, motion + np.mean(measured - motion))


def misfit(r2: float, record: FittedRecord | Record) -> float:
    """The root mean square error [um] that an r2 amounts to on a record."""
    return 1e6 * math.sqrt((1.0 - r2) * float(np.var(record.measured)))


def main() -> None:
    """Print the tables and draw the figure."""
    prepare_jax(dedicated=True)
    result = calculate()
    text = [
        print_table(
            "Figures 5.9 to 5.11: coefficient of determination at 5 Hz (fitted) and 20 Hz (predicted)",
            agreement(result),
            notes=[
                "Ours: synthetic records, whose noise of 0.0104 um is all that is left. r2 grows with the distance "
                "walked, whatever the error: the rows in um say what an r2 means.",
                f"The fit: {result.estimate.message}; reduced chi-square "
                f"{result.estimate.statistics.reduced_chi2:.4f} with {result.estimate.statistics.samples} samples.",
            ],
        ),
        print_table(
            "Section 5.4.1: the parameters",
            parameters(result),
            notes=["The records were made with the thesis's parameters; after +/-, one standard error."],
        ),
    ]
    write("\n\n".join(text), NAME)
    with styled():
        save(draw(result), NAME)


def agreement(result: Result) -> list[Row]:
    """r2 and errors, record by record."""
    rows = []
    for record in result.walks:
        frequency = record.name.rsplit(" ", 1)[0]
        fitted = "fitted" if record.role == "fit" else "not fitted"
        rows.append(
            Row(f"r2, {record.name}, {fitted}", THESIS[frequency], f"1 - {1.0 - record.r2:.1e}", "", "noise alone")
        )
    for record in result.walks:
        thesis = misfit(THESIS[record.name.rsplit(" ", 1)[0]], record)
        rows.append(
            Row(f"rms error, {record.name}", thesis, 1e6 * record.rmse, "um", "thesis: from r2 on our variance")
        )
    for record in result.walks:
        thesis = THESIS[record.name.rsplit(" ", 1)[0]]
        ours = result.chapter_4[record.name]
        rows.append(Row(f"r2, {record.name}, chapter 4's piezo", thesis, ours, "", "true friction, piezo 3 % off"))
    return rows


def parameters(result: Result) -> list[Row]:
    """What was found beside what the records were made with."""
    rows = []
    for path, found in result.estimate.parameters.items():
        if found.free:
            away = (found.value - result.truth[path]) / found.standard_error
            why = f"+/- {found.standard_error:.2g}, {away:+.1f} standard errors"
            rows.append(Row(path, result.truth[path], found.value, found.unit, why))
    return rows


def draw(result: Result) -> Figure:
    """Above: records and predictions of both frequencies and directions.  Below: what is left."""
    figure = Figure(figsize=(9.2, 4.8), layout="constrained")
    panels = figure.subplots(2, 4, height_ratios=(3, 1), sharex="col")
    for (motion, rest), record in zip(panels.T, result.walks, strict=True):
        motion.plot(record.time, 1e6 * record.measured, ".", color=BLUE, markersize=2, label="record")
        motion.plot(record.time, 1e6 * record.predicted, color=VERMILION, linewidth=0.7, label="model")
        rest.plot(record.time, 1e6 * (record.measured - record.predicted), ".", color="0.3", markersize=1.2)
        kind = "fitted" if record.role == "fit" else "predicted"
        motion.set_title(f"{record.name}, {kind}\n$1 - r^2$ = {1.0 - record.r2:.1e}", fontsize=8.5)
        rest.set_ylim(-0.06, 0.06)
        rest.set_xlabel("time (s)")
    panels[0, 0].set_ylabel("end-effector (um)")
    panels[1, 0].set_ylabel("record - model\n(um)")
    panels[0, 0].legend(loc="lower right", markerscale=3)
    return figure


if __name__ == "__main__":
    main()
