"""Do the ball-on-disk coefficients of chapter 2 fit the breakaway forces of chapter 5?

Section 2.4 pressed a steel ball on the anisotropic surface with 5 N and found coefficients of friction of
0.495 along the tips (direction A) and 0.432 against them (B).  Section 5.4.1 identified F_SSa = 0.7964 N
and F_SSb = 0.5458 N on the actuator, where the end-effector's weight presses, and nothing else.  What
F_SS says of a coefficient depends on that normal force N:

- on a level plane N = m g;
- in the 90-degree V-groove of section 3.2 each flank carries m g / sqrt(2), both together
  N = sqrt(2) m g, and friction along the groove gains as much.

The ratio of both directions needs no normal force at all.

    python -m experiments.friction_tests
"""

import math

import numpy as np
from matplotlib.figure import Figure

from experiments.common import BLUE, GREEN, VERMILION, Row, print_table, save, styled
from experiments.published import ANISOTROPIC, COEFFICIENTS, TEST_LOAD, law
from pdssjax import Effector
from pdssjax.actuator import GRAVITY

NAME = "friction_tests"
GROOVE = math.sqrt(2.0)
"""Normal force over weight in a groove of 90 degrees."""


def breakaway() -> tuple[float, float]:
    """F_SSa and F_SSb [N]."""
    friction = law(ANISOTROPIC)
    return friction.f_ss_a, friction.f_ss_b


def weight() -> float:
    """Of the end-effector [N]."""
    return Effector().mass * GRAVITY


def coefficients(normal: float) -> tuple[float, float]:
    """Of friction in direction A and B, if `normal` [N] presses."""
    a, b = breakaway()
    return a / normal, b / normal


def reconciling() -> tuple[float, float]:
    """Normal force [N] that makes chapter 5's force out of chapter 2's coefficient, in direction A and in B."""
    (a, b), (mu_a, mu_b) = breakaway(), COEFFICIENTS
    return a / mu_a, b / mu_b


def rows() -> list[Row]:
    """Coefficients, their ratio, and the normal forces that would be needed."""
    (mu_a, mu_b), (flat_a, flat_b) = COEFFICIENTS, coefficients(weight())
    groove_a, groove_b = coefficients(GROOVE * weight())
    need_a, need_b = reconciling()
    a, b = breakaway()
    load = f"the test pressed with {TEST_LOAD:g} N on a ball, the actuator with its weight on plates"
    return [
        Row("coefficient A, on a plane", mu_a, flat_a, "", load),
        Row("coefficient B, on a plane", mu_b, flat_b, "", load),
        Row("coefficient A, in the V-groove", mu_a, groove_a, "", "N = 1.414 m g"),
        Row("coefficient B, in the V-groove", mu_b, groove_b, "", "N = 1.414 m g: hardly off"),
        Row("ratio A to B", mu_a / mu_b, a / b, "", "needs no normal force, and so no such force can reconcile it"),
        Row(
            "normal force for A", weight(), need_a, "N", f"{need_a / weight():.2f} weights; the thesis gives only 86 g"
        ),
        Row("normal force for B", weight(), need_b, "N", f"{need_b / weight():.2f} weights; the groove gives 1.41"),
        Row("mass for A, in the groove", 86.0, 1e3 * need_a / GROOVE / GRAVITY, "g", "sensor plate included"),
        Row("mass for B, in the groove", 86.0, 1e3 * need_b / GROOVE / GRAVITY, "g", "sensor plate included"),
    ]


def notes() -> list[str]:
    """What follows."""
    need_a, need_b = reconciling()
    (mu_a, mu_b), (a, b) = COEFFICIENTS, breakaway()
    return [
        f"No single normal force does for both directions: A asks for {need_a:.2f} N, B for {need_b:.2f} N. Their "
        f"mean, {0.5 * (need_a + need_b):.2f} N or {0.5 * (need_a + need_b) / weight():.2f} weights, misses each by "
        f"{100 * (need_a - need_b) / (need_a + need_b):.0f} %. The groove alone explains most of the size of F_SS.",
        f"The anisotropy does not carry over: {100 * (mu_a / mu_b - 1):.0f} % in the test, {100 * (a / b - 1):.0f} % "
        "on the actuator. A ball of steel under 5 N at 0.5 mm/s need not feel the tips as two such surfaces do that "
        "engage each other under less than 1 N. Or the identification laid something else, such as a tilt or the "
        "drive's fall time, into F_SSa / F_SSb: see the reconciliation.",
    ]


def main() -> None:
    """Print the table and draw the figure."""
    print_table("Chapter 2's coefficients beside chapter 5's breakaway forces", rows(), NAME, notes())
    with styled():
        save(draw(), NAME)


def draw() -> Figure:
    """What chapter 2's coefficients make of a normal force, and the forces that chapter 5 identified."""
    figure = Figure(figsize=(5.6, 4.2), layout="constrained")
    axes = figure.subplots()
    normal = np.linspace(0.0, 2.0, 50)
    for name, mu, force, needed, colour in zip(
        "AB", COEFFICIENTS, breakaway(), reconciling(), (BLUE, VERMILION), strict=True
    ):
        axes.plot(normal, mu * normal, color=colour, label=f"{mu} N: ball on disk, direction {name}")
        axes.axhline(force, color=colour, linestyle="--", linewidth=1.0, label=f"F_SS{name.lower()} of chapter 5")
        axes.plot([needed], [force], "o", color=colour)
    for times, name in ((1.0, "weight,\n86 g"), (GROOVE, "in the\nV-groove")):
        axes.axvline(times * weight(), color=GREEN, linestyle=":")
        axes.annotate(name, (times * weight() - 0.02, 0.02), ha="right", color=GREEN)
    axes.set_xlabel("normal force [N]")
    axes.set_ylabel("friction force [N]")
    axes.set_xlim(0.0, 2.0)
    axes.set_ylim(0.0, 1.2)
    figure.legend(loc="outside lower center", ncols=2)
    return figure


if __name__ == "__main__":
    main()
