"""How much smaller is the second mode than the first? (thesis, figure 4.4)

The thesis draws |phi2(L) / phi1(L)|, the height of the second mode's shape at the tip beside the
first's, both shapes being sines of one amplitude.  Since every mode has the same coefficient D in
(4.11), this is there the ratio of the gains too.  What the equations of the rod make of the
voltage is a second curve: in a mode's gain its height counts twice (pushed at the tip, seen at
the tip) and is divided by its stiffness.

    python -m experiments.mode_ratio
"""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from experiments.common import BLUE, VERMILION, Row, print_table, save, styled
from pdssjax import prepare_jax
from pdssjax.piezo import Rod, modes

NAME = "mode_ratio"
MASS_RATIOS = (24.7, 47.7, 87.5, 115.8, 138.8)
"""Platform to stack in the thesis's experiments (section 4.4)."""
WHY_SHAPE = "the thesis prints the curve, no number"
WHY_GAIN = "{:.0f} times less: (4.11) takes one D for every mode, and so the shapes' ratio for the gains'"


@dataclasses.dataclass(frozen=True)
class Ratios:
    """Second mode over first at each mass ratio."""

    mass_ratio: Float[np.ndarray, " n"]
    shape: Float[np.ndarray, " n"]
    """|phi2(L) / phi1(L)|, figure 4.4."""
    gain: Float[np.ndarray, " n"]
    """g2 / g1 by projection of the equations (4.5)-(4.7) on the modes."""


def calculate(mass_ratios) -> Ratios:
    """Both ratios, at the nominal stack (neither depends on its modulus or damping)."""

    def ratios(mass_ratio, excitation):
        gain = modes(Rod(platform_mass=mass_ratio * Rod().mass, excitation=excitation), 2).gain
        return jnp.abs(gain[1] / gain[0])

    each = jax.vmap(ratios, in_axes=(0, None))
    mass_ratios = np.asarray(mass_ratios, float)
    return Ratios(mass_ratios, np.asarray(each(mass_ratios, 1.0)), np.asarray(each(mass_ratios, 0.0)))


def main() -> None:
    """Print the table and draw the figure."""
    prepare_jax(dedicated=True)
    found = calculate(MASS_RATIOS)
    rows = []
    for mass_ratio, shape, gain in zip(MASS_RATIOS, found.shape, found.gain, strict=True):
        rows += [
            Row(f"|phi2 / phi1| at mass ratio {mass_ratio}", None, float(shape), "", WHY_SHAPE),
            Row(
                f"gain ratio g2 / g1 at mass ratio {mass_ratio}",
                f"as above, {shape:.4f}",
                float(gain),
                "",
                WHY_GAIN.format(shape / gain),
            ),
        ]
    note = (
        "For a heavy platform |phi2 / phi1| tends to 1 / (pi sqrt(r)), and g2 / g1 to 2 / (pi^4 r^2): the second mode "
        "matters far less than figure 4.4 lets one think."
    )
    print_table("Figure 4.4: second mode beside the first, at the tip", rows, NAME, [note])
    with styled():
        save(draw(calculate(np.geomspace(0.1, 300.0, 200)), found), NAME)


def draw(curve: Ratios, points: Ratios) -> Figure:
    """Both ratios against the mass ratio, with their limits for a heavy platform."""
    figure = Figure(figsize=(5.4, 3.6), layout="constrained")
    axes = figure.subplots()
    r = curve.mass_ratio
    for values, limit, marks, colour, label in (
        (curve.shape, 1.0 / (math.pi * np.sqrt(r)), points.shape, BLUE, "height of the shapes at the tip (figure 4.4)"),
        (curve.gain, 2.0 / (math.pi**4 * r**2), points.gain, VERMILION, "displacement per volt, from (4.5) to (4.7)"),
    ):
        axes.loglog(r, values, color=colour, label=label)
        axes.loglog(r[r > 1.0], limit[r > 1.0], color=colour, linestyle=":", linewidth=1.0)
        axes.loglog(points.mass_ratio, marks, "o", color=colour, markersize=4.5)
    axes.plot([], [], color="0.4", linestyle=":", linewidth=1.0, label="limit for a heavy platform")
    axes.plot([], [], "o", color="0.4", markersize=4.5, label="mass ratios of the experiments")
    axes.set_xlabel("mass ratio, platform to stack")
    axes.set_ylabel("second mode / first mode")
    axes.set_xlim(r[0], r[-1])
    axes.legend(loc="lower left")
    return figure


if __name__ == "__main__":
    main()
