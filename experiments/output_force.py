"""How hard do the published parameters push? (thesis, section 3.5, figure 3.11)

A force sensor stands in front of the end-effector, the actuator walks against it until it gets no
further, and the highest force is noted: 0.409 N (IF) and 0.435 N (AF) at 5 Hz, 0.429 N and 0.475 N at
20 Hz.  The thesis names the sensor (Interface MB-50) but no stiffness of it with its mount and its
contact, on which everything depends.  So it is swept:

- soft, the end-effector walks into the spring step by step until a step forward is as long as the slip
  back: the force is that at which the walk stalls, the same for every softer spring;
- stiff, one slow flank is enough to make the contact slide, and the force is F_SSa.

A beam of 50 lbf (222 N) that yields some tenths of a millimetre at its capacity, as such cells do, has about 1e6 N/m;
contact, glue and mount only make that less.

The model is the thesis's, with an ideal sawtooth and with one that falls within half a millisecond.
The sensor loses as much energy as `Stop` has by default.

    python -m experiments.output_force
"""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float
from matplotlib.figure import Figure

from experiments.common import BLUE, ORANGE, SKY, VERMILION, Row, print_table, save, styled, write
from experiments.published import PUSHES, READINGS, VOLTAGE, Push, Reading, law, stacked
from pdssjax import Accuracy, Actuator, Stop, prepare_jax
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.piezo.second_order import SecondOrder
from pdssjax.simulation import STOP_FORCE, StickSlip, sensor_samples

NAME = "output_force"
STIFFNESSES = np.geomspace(6e3, 3e6, 12)
"""Of the sensor with mount and contact [N/m]."""
LIKELY = (1e4, 1e6)
"""Between a cell on a soft mount and the cell alone [N/m]."""
FALL_TIMES = (0.0, 0.5e-3)
"""Of the sawtooth [s]."""
CYCLES = 20
"""Of walking into the sensor: the softest needs most of them."""
ROOM = Accuracy(max_steps=40000)


@dataclasses.dataclass(frozen=True)
class Forces:
    """Of one reading, for each of figure 3.11's bars, fall time and stiffness [N]."""

    steady: Float[np.ndarray, "4 2 n"]
    """At the end of the last slow flank; NaN where a run did not finish."""
    highest: Float[np.ndarray, "4 2 n"]
    """At the end of the highest one, as a rule the first where the sensor is stiff."""


def pushing(push: Push, stiffness: float, fall_time: float, reading: Reading) -> StickSlip:
    """The system of one bar of figure 3.11."""
    actuator = Actuator(SecondOrder(), law(push.surface, reading), stop=Stop(stiffness))
    return StickSlip(actuator, Sawtooth(voltage=VOLTAGE, frequency=push.frequency, fall_time=fall_time))


def flank_ends(system: StickSlip, cycles: int, accuracy: Accuracy = ROOM) -> Float[Array, " cycles"]:
    """Force [N] on the sensor at the end of every slow flank, the highest of its cycle but for an impact."""
    frequency = system.drive.frequency  # pyright: ignore[reportAttributeAccessIssue]
    return sensor_samples(system, (jnp.arange(cycles) + 1.0) / frequency * (1.0 - 1e-9), accuracy, STOP_FORCE)


def calculate(
    reading: Reading, stiffnesses: Sequence[float] | np.ndarray = STIFFNESSES, cycles: int = CYCLES
) -> Forces:
    """Every bar of figure 3.11 for each fall time and stiffness."""
    cases = [pushing(p, float(k), t, reading) for p in PUSHES for t in FALL_TIMES for k in stiffnesses]
    found = eqx.filter_jit(lambda cases: lax.map(lambda case: flank_ends(case, cycles), cases))(stacked(cases))
    found = np.asarray(found).reshape(len(PUSHES), len(FALL_TIMES), len(stiffnesses), cycles)
    return Forces(found[..., -1], found.max(axis=-1))


def matching(steady: Float[np.ndarray, " n"], force: float, stiffnesses: np.ndarray = STIFFNESSES) -> float:
    """The stiffness [N/m] that gives `force` [N]; NaN where none does."""
    known = np.isfinite(steady)
    inside = steady[known].min() <= force <= steady[known].max()
    return float(np.exp(np.interp(force, steady[known], np.log(stiffnesses[known])))) if inside else np.nan


def rows(found: Forces) -> list[Row]:
    """Figure 3.11 beside one reading: what each end of the sweep gives, and which stiffness would give the number."""
    table = []
    for push, forces in zip(PUSHES, found.steady, strict=True):
        for fall_time, steady in zip(FALL_TIMES, forces, strict=True):
            needed = 1e-3 * matching(steady, push.force)
            name = f"{push.name}, fall in {1e3 * fall_time:g} ms"
            f_ss = law(push.surface).f_ss_a
            stiff = Row(f"{name}: stiff sensor", push.force, float(steady[-1]), "N", f"tends to F_SSa = {f_ss:.4f} N")
            table += [stiff, Row("... stiffness that gives the number", None, needed, "N/mm", "not published")]
    return table


def comparison(found: dict[Reading, Forces]) -> list[Row]:
    """What does not depend on knowing the stiffness: AF beside IF, and 20 Hz beside 5 Hz, on one sensor."""
    table = []
    for frequency, (usual, better) in zip((5, 20), ((0, 1), (2, 3)), strict=True):
        published = 100.0 * (PUSHES[better].force / PUSHES[usual].force - 1.0)
        for reading, forces in found.items():
            gain = 100.0 * (forces.steady[better] / forces.steady[usual] - 1.0)
            why = "where AF gives the published force; F_SSa / F_SS - 1 = 19 % on a stiff sensor"
            for i, fall_time in enumerate(FALL_TIMES):
                near = _at_force(gain[i], forces.steady[better, i], PUSHES[better].force)
                name = f"AF over IF at {frequency} Hz, {reading} state, fall in {1e3 * fall_time:g} ms"
                table.append(Row(name, published, near, "%", why))
    for name, slow, fast in (("IF", 0, 2), ("AF", 1, 3)):
        published = 100.0 * (PUSHES[fast].force / PUSHES[slow].force - 1.0)
        change = 100.0 * (found["force"].steady[fast] / found["force"].steady[slow] - 1.0)
        why = "(5.20-5.21) knows no rate where the contact slides: nothing lets the force grow with the frequency"
        table.append(Row(f"20 Hz over 5 Hz, {name}: largest", published, float(np.nanmax(change)), "%", why))
        table.append(Row(f"20 Hz over 5 Hz, {name}: smallest", published, float(np.nanmin(change)), "%"))
    return table


def _at_force(values, steady, force) -> float:
    """`values` at the stiffness that gives `force`."""
    known = np.isfinite(steady) & np.isfinite(values)
    return float(np.interp(force, steady[known], values[known]))


def main() -> None:
    """Print the tables and draw the figure."""
    prepare_jax(dedicated=True)
    found: dict[Reading, Forces] = {reading: calculate(reading) for reading in READINGS}
    texts = [
        print_table(f"Figure 3.11 with the published parameters, {reading} state", rows(forces))
        for reading, forces in found.items()
    ]
    broken = sum(int(np.isnan(forces.steady).sum()) for forces in found.values())
    note = f"{broken} of {2 * found['force'].steady.size} runs did not finish and are left out." if broken else ""
    texts.append(print_table("Figure 3.11: ratios", comparison(found), None, [note] if note else []))
    write("\n\n".join(texts), NAME)
    with styled():
        save(draw(found), NAME)


def draw(found: dict[Reading, Forces]) -> Figure:
    """Steady force at 5 Hz against the stiffness, one panel a fall time; dotted, what was measured."""
    figure = Figure(figsize=(9.4, 3.7), layout="constrained")
    panels = figure.subplots(1, len(FALL_TIMES), sharey=True)
    for i, (axes, fall_time) in enumerate(zip(panels, FALL_TIMES, strict=True)):
        axes.axvspan(
            1e-3 * LIKELY[0], 1e-3 * LIKELY[1], color="0.93", zorder=0, label="plausible stiffness" if i == 0 else None
        )
        for index, name, colour in ((1, "anisotropic", BLUE), (0, "isotropic", VERMILION)):
            axes.semilogx(1e-3 * STIFFNESSES, found["force"].steady[index, i], color=colour, label=name)
            steady = found["deflection"].steady[index, i]
            known = np.isfinite(steady)
            axes.semilogx(1e-3 * STIFFNESSES[known], steady[known], "--", color=colour, linewidth=0.9)
        for push, colour in zip(PUSHES, (VERMILION, BLUE, ORANGE, SKY), strict=True):
            axes.axhline(push.force, color=colour, linestyle=":", linewidth=1.2)
        axes.set_title("ideal sawtooth" if fall_time == 0 else f"fall in {1e3 * fall_time:g} ms")
        axes.set_xlabel("stiffness of the sensor on its mount [N/mm]")
        axes.set_xlim(1e-3 * STIFFNESSES[0], 1e-3 * STIFFNESSES[-1])
        axes.set_ylim(0.0, 0.85)
    panels[0].set_ylabel("force at the end of a slow flank [N]")
    for style, name in (("-", "force state"), ("--", "deflection state")):
        panels[0].plot([], [], color="0.3", linestyle=style, label=name)
    for push, colour in zip(PUSHES, (VERMILION, BLUE, ORANGE, SKY), strict=True):
        panels[0].plot([], [], ":", color=colour, label=f"measured: {push.name}")
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=5)
    return figure


if __name__ == "__main__":
    main()
