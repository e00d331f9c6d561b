"""How many cycles at which sampling tell one friction law from another, and what would tell on Liu's rig?

A virtual rig has the thesis's stack and mass (section 5.4.1) and one contact law, LuGre or elastoplastic, driven at
64.2 V and 5 Hz; noise is 0.0104 um, as of its sensor.  Of the first cycles, at a sampling interval, `compare` says
which law of Coulomb, Dahl, LuGre and elastoplastic is enough: what counts is whether the truth, or a simpler law that
predicts as well, is told from the others.  The stack is known, so that the law alone is asked for.

For the record of Liu et al. (2015), read off their figures, the same question is asked of the record itself, and which
record of that rig would tell the laws apart.

    python -m experiments.which_law
    python -m experiments.which_law --quick     # LuGre's truth, two samplings, three laws, without Liu's record
"""

import argparse
import dataclasses
import itertools
import tempfile
from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path

import pdssjax
from experiments.common import Row, print_table, write
from pdssjax import Comparison, Study, prepare_jax
from pdssjax.study import make_recordings

NAME = "which_law"
NOISE = 0.0104e-6
"""Of the thesis's displacement sensor, rounding included [m]."""

CONTACTS = {
    "lugre": {"sigma0": 1.05e6, "sigma1": 46.0, "f_c": 0.6, "f_s": 0.7, "v_s": 1e-3},
    "elastoplastic": {"sigma0": 1.05e6, "sigma1": 46.0, "f_c": 0.6, "f_s": 0.7, "v_s": 1e-3, "elastic_part": 0.6},
}
"""The truths: means of a and b of section 5.4.1 where the thesis has them [SI]."""

LAWS = "coulomb", "dahl", "lugre", "elastoplastic"
CYCLES = 1, 2, 4, 8
INTERVALS = 1e-3, 0.5e-3, 0.1e-3
"""Sampling intervals [s]; the first is the thesis's at 5 Hz."""

FREQUENCY = 5.0

RIG = """
format = "pdssjax-study/1"
title = "{law}, {cycles} cycles every {interval} s"

[actuator]
piezo = "second-order"
friction = "{law}"

[parameters]
"effector.mass" = {{ value = "86 g" }}
"piezo.gain" = {{ value = "0.1007 um/V" }}
"piezo.natural_frequency" = {{ value = "6736 rad/s" }}
"piezo.damping_ratio" = {{ value = 0.1772 }}
"drive.fall_time" = {{ value = "0.5 ms" }}
{contact}

[[record]]
name = "5 Hz"
file = "5_Hz.csv"
columns = {{ time = "time_s", displacement = "displacement_um" }}
measures = "effector"
noise = {noise}
sampling = {{ start = 0, end = {end}, interval = {interval} }}
drive = {{ waveform = "sawtooth", voltage = "64.2 V", frequency = "5 Hz" }}
"""


def rig(law: str, cycles: int, interval: float) -> Study:
    """The study of one virtual record, its truth fixed."""
    contact = "\n".join(f'"friction.{name}" = {{ value = {number} }}' for name, number in CONTACTS[law].items())
    told = {"law": law, "cycles": cycles, "interval": interval, "contact": contact, "noise": NOISE}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rig.toml"
        path.write_text(RIG.format(end=cycles / FREQUENCY - interval, **told), encoding="utf-8")
        return pdssjax.load_study(path, virtual=True)


def measured(law: str, cycles: int, interval: float, seed: int = 0) -> Study:
    """The same with samples and noise, its contact free."""
    posed = rig(law, cycles, interval)
    (recording,) = make_recordings(posed, seed)
    free = {
        path: dataclasses.replace(parameter, value=None) if path.startswith("friction.") else parameter
        for path, parameter in posed.parameters.items()
    }
    return dataclasses.replace(posed, parameters=free, records=(recording.record,))


def answered(
    law: str, cycles: int, interval: float, laws: Sequence[str] = LAWS, executor: Executor | None = None
) -> Comparison:
    """Which law the record of so many cycles supports."""
    return pdssjax.compare(measured(law, cycles, interval), friction=laws, executor=executor)


def row(law: str, cycles: int, interval: float, found: Comparison) -> Row:
    """What a comparison says beside the truth."""
    told = [r.name for r in found.results if r.is_worse]
    why = f"not told from it: {', '.join(found.ambiguous) or 'none'}; worse: {', '.join(told) or 'none'}"
    return Row(f"truth {law}, {cycles} cycles every {1e3 * interval:g} ms", None, found.chosen or "no fit", "", why)


def liu(executor: Executor | None = None) -> list[Row]:
    """Liu's record: which law, and what would tell."""
    from experiments.measured_fits import LAWS as POSED, free_of, masks, study

    posed = study(*POSED["lugre"])
    used = masks(posed)
    held = {"effector.mass", *(path for path in posed.parameters if path not in free_of(posed))}
    parameters = {
        path: dataclasses.replace(p, value=p.number, start=None) if path in held and p.free else p
        for path, p in posed.parameters.items()
    }
    record = posed.records[0]
    well = dataclasses.replace(record, time=record.time[used[0]], measured=record.measured[used[0]])
    found = pdssjax.compare(
        dataclasses.replace(posed, title="Liu et al. 2015", parameters=parameters, records=(well,)),
        friction=LAWS,
        executor=executor,
    )
    rows = [row_of_liu(found)]
    if (telling := found.telling) is not None:
        what = f"{telling.voltage:.3g} V, {telling.frequency:.3g} Hz, first {100 * telling.window:.0f} % of each cycle"
        rows.append(Row("record that would tell most", None, what, "", f"{telling.sigmas:.2g} standard deviations"))
    return rows


def row_of_liu(found: Comparison) -> Row:
    """The answer on the measured record."""
    worse = [r.name for r in found.results if r.is_worse]
    why = f"not told from it: {', '.join(found.ambiguous) or 'none'}; worse: {', '.join(worse) or 'none'}"
    return Row("Liu et al. 2015, slips left out", None, found.chosen or "no fit", "", why)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true", help="LuGre alone, two samplings, without Liu's record")
    quick = parser.parse_args().quick
    prepare_jax(dedicated=True)
    truths, laws = (["lugre"], LAWS[:3]) if quick else (list(CONTACTS), LAWS)
    cases = itertools.product(truths, (2,) if quick else CYCLES, INTERVALS[::2] if quick else INTERVALS)
    rows = list[Row]()
    for case in cases:
        rows.append(row(*case, answered(*case, laws)))
        print(f"{rows[-1].name}: {rows[-1].ours}", flush=True)
    text = [print_table("The simplest law that is enough, on the thesis's rig", rows)]
    if not quick:
        text.append(print_table("A measured record", liu()))
    write("\n\n".join(text), NAME)


if __name__ == "__main__":
    main()
