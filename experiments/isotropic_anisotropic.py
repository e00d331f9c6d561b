"""Do the published parameters walk as the actuator did? (thesis, figures 3.7 to 3.9, table 3.1)

The thesis's model with the parameters of its section 5.4.1 and an ideal sawtooth of 64 V and 5 Hz, on
anisotropic (AF) and isotropic (IF) surfaces, in both directions, beside what was measured.  Both
readings of (5.22).

The step efficiency (3.1) leaves open where a stick phase begins.  It is shown in two ways: by straight
lines through the slow flanks, so that S is what the platform goes, and by the extreme samples beside
each slip, 1 ms apart as in the thesis, which is what one reads off its figures.

    python -m experiments.isotropic_anisotropic
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Float
from matplotlib.figure import Figure

from experiments.common import BLUE, VERMILION, Row, print_table, save, styled, write
from experiments.published import ANISOTROPIC, ISOTROPIC, READINGS, STROKE, WALKS, Reading, stacked, walking
from pdssjax import Accuracy, prepare_jax
from pdssjax.metrics import cycle_metrics, turning_points
from pdssjax.simulation import displacements

NAME = "isotropic_anisotropic"
PERIOD = 0.2
TIMES = 1e-3 * np.arange(1601)
"""The thesis's samples: 1.6 s, 1 ms apart."""
WHY = "no fall time and no mass of the sensor plate are published: see the reconciliation"


@dataclasses.dataclass(frozen=True)
class Walks:
    """What the four walks of table 3.1 are with one reading, in their order."""

    displacement: Float[np.ndarray, "4 m"]
    """Of the end-effector [m], turned so that walking is positive."""
    efficiency: Float[np.ndarray, " 4"]
    """By lines through the flanks, in the steady cycle."""
    read_off: Float[np.ndarray, " 4"]
    """By the extreme samples beside the slips."""
    speed: Float[np.ndarray, " 4"]
    """[m/s]"""


def calculate(reading: Reading) -> Walks:
    """All four walks, from rest; metrics of the last cycle that the samples hold."""
    cases = stacked([walking(walk, reading) for walk in WALKS])

    @jax.jit
    def walks(cases):
        def walked(case):
            actuator, drive = case
            return drive.direction * displacements(actuator, drive, jnp.asarray(TIMES), Accuracy())[1]

        return lax.map(walked, cases)

    walked = np.asarray(walks(cases))
    drops = 6
    lines = [cycle_metrics(TIMES, x, 1.0 / PERIOD, PERIOD, drops) for x in walked]
    points = [turning_points(TIMES, x, 1.0 / PERIOD, PERIOD, drops) for x in walked]
    back = [(p.before[-1] - p.after[-1]) / (p.before[-1] - p.after[-2]) for p in points]
    last = lambda values: np.array([float(v[-1]) for v in values])
    return Walks(
        walked, last([m.efficiency for m in lines]), 1.0 - np.array(back, float), last([m.speed for m in lines])
    )


def rows(found: Walks) -> list[Row]:
    """Table 3.1 and the speeds of section 3.4, beside one reading."""
    table = []
    for walk, line, point in zip(WALKS, found.efficiency, found.read_off, strict=True):
        table += [
            Row(f"step efficiency, {walk.name}", 100 * walk.efficiency, float(100 * line), "%", WHY),
            Row(
                "... read off extreme samples",
                100 * walk.efficiency,
                float(100 * point),
                "%",
                "ringing widens S and S_0",
            ),
        ]
    for walk, speed in zip(WALKS, found.speed, strict=True):
        published = None if walk.speed is None else 1e6 * walk.speed
        table.append(Row(f"average speed, {walk.name}", published, float(1e6 * speed), "um/s"))
    usual = 0.5 * (found.efficiency[2] + found.efficiency[3])
    table += [
        Row("improvement in direction A", 17.87, float(100 * (found.efficiency[0] - usual)), "points"),
        Row("improvement in direction B", -11.06, float(100 * (found.efficiency[1] - usual)), "points"),
    ]
    return table


def consistency() -> list[Row]:
    """The published efficiencies and speeds are tied: v = eta f S."""
    return [
        Row(
            f"stroke S = v / (eta f), {walk.name}",
            1e6 * STROKE,
            1e6 * walk.speed * PERIOD / walk.efficiency,
            "um",
            "C V of section 5.3 against what table 3.1 and the speed imply",
        )
        for walk in WALKS
        if walk.speed is not None
    ]


def main() -> None:
    """Print the tables and draw the figure."""
    prepare_jax(dedicated=True)
    found: dict[Reading, Walks] = {reading: calculate(reading) for reading in READINGS}
    texts = [print_table("Are the published numbers consistent with each other?", consistency())]
    for reading, walks in found.items():
        notes = [
            f"IF: the mean of the parameters a and b, since the thesis gives none. Ideal sawtooth, {reading} state."
        ]
        texts.append(print_table(f"Table 3.1 with the published parameters, {reading} state", rows(walks), None, notes))
    write("\n\n".join(texts), NAME)
    with styled():
        save(draw(found), NAME)


def draw(found: dict[Reading, Walks]) -> Figure:
    """Figures 3.7 to 3.9 as the published parameters have them; dotted, the published average progress."""
    figure = Figure(figsize=(8.4, 3.5), layout="constrained")
    panels = figure.subplots(1, 3, sharey=True)
    chosen = ((2, 3), (0, 1), (0, 2))
    titles = ("isotropic (figure 3.7)", "anisotropic (figure 3.8)", "direction A (figure 3.9)")
    labels = (("A", "B, reversed"), ("A", "B, reversed"), (ANISOTROPIC, ISOTROPIC))
    for axes, pair, title, names in zip(panels, chosen, titles, labels, strict=True):
        for index, name, colour in zip(pair, names, (BLUE, VERMILION), strict=True):
            axes.plot(TIMES, 1e6 * found["deflection"].displacement[index], color=colour, label=name)
            axes.plot(TIMES, 1e6 * found["force"].displacement[index], color=colour, linewidth=0.8, linestyle="--")
            net = WALKS[index].efficiency * STROKE
            axes.plot(TIMES, 1e6 * net * TIMES / PERIOD, color=colour, linewidth=1.0, linestyle=":")
        axes.set_title(title)
        axes.set_xlabel("time [s]")
        axes.set_xlim(0.0, TIMES[-1])
        axes.legend(loc="upper left")
    panels[0].set_ylabel("displacement of the end-effector [um]")
    for style, name in (("-", "deflection state"), ("--", "force state"), (":", "published efficiency, as a slope")):
        panels[0].plot([], [], color="0.3", linestyle=style, label=name)
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(handles[2:], names[2:], loc="outside lower center", ncols=3)
    panels[0].legend(handles[:2], names[:2], loc="upper left")
    return figure


if __name__ == "__main__":
    main()
