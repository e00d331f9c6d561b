"""Where a walk ends, with derivatives by ten parameters: pdssjax beside others, in environments of their own.

    python -m venv somewhere && somewhere/bin/pip install jaxonomy==3.4.1
    python3.12 -m venv elsewhere && elsewhere/bin/pip install sbmlode==0.3.1 diffrax pandas
    python -m benchmarks.gradient --jaxonomy somewhere/bin/python --sbmlode elsewhere/bin/python

jaxonomy differentiates through zero crossings in reverse mode only, and only what is there at the end: so one number
is differentiated, which suits it best.  A Jacobian of n samples would take it n such runs.  sbmlode writes diffrax code
that solves each segment with an `Event`; that has forward and reverse mode.
"""

import argparse
import dataclasses
import json
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

CYCLES = 7.9
"""Before the last drop, which the other would meet at the very end."""
TOLERANCES = 1e-6, 1e-8, 1e-10
REPEATS = 9
PEERS = {"jaxonomy": ("reverse",), "sbmlode": ("forward", "reverse")}
"""Their modes; each has a script in the folder `apart`."""


@dataclasses.dataclass(frozen=True)
class Entry:
    """One way to the value and its derivatives."""

    name: str
    value: float
    """End-effector [um]."""
    gradient: np.ndarray
    """By the logarithms [um]."""
    first: float
    """Seconds of the first call, with tracing and compiling."""
    run: float
    """Seconds of a later one."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gradient", description=__doc__)
    for peer in PEERS:
        parser.add_argument(f"--{peer}", metavar="PYTHON", help="interpreter of an environment that has it")
    given = vars(parser.parse_args(arguments))
    right, entries = _ours()
    for peer, modes in PEERS.items():
        for mode in modes if given[peer] else ():
            entries += [_apart(peer, given[peer], mode, tolerance) for tolerance in TOLERANCES]
    print(_table(right, entries))
    for peer in PEERS:
        if not given[peer]:
            print(f"{peer} was left out: give the interpreter of its environment, --{peer} PYTHON.")
    return 0


def _ours() -> tuple[Entry, list[Entry]]:
    """The tight solution, every cycle stepped, and ours at default accuracy in both modes."""
    from pdssjax import prepare_jax

    prepare_jax(dedicated=True)
    import jax
    import jax.numpy as jnp

    from pdssjax import AbstractDrive, Accuracy, Taylor
    from pdssjax.simulation import displacements

    from .problem import NAMES, PARAMETERS, UM, EveryCycle, Problem, actuator

    problem, zeros = Problem(), jnp.zeros(len(NAMES))
    times = jnp.array([0.0, CYCLES / problem.frequency])

    def end(logarithms: jax.Array, accuracy: Accuracy, drive: AbstractDrive) -> jax.Array:
        x_e = displacements(actuator(PARAMETERS * jnp.exp(logarithms)), drive, times, accuracy)[1]
        return x_e[-1] * UM

    every = EveryCycle(voltage=problem.voltage, frequency=problem.frequency)
    tight = lambda x: end(x, Accuracy(1e-15, 1e-15, Taylor(12), max_steps=4000), every)
    usual = lambda x: end(x, Accuracy(), problem.drive())
    forward = lambda f: jax.jit(lambda x: (f(x), jax.jacfwd(f)(x)))
    found = [
        _timed(name, lambda run=run: jax.block_until_ready(run(zeros)))
        for name, run in (
            ("tight", forward(tight)),
            ("pdssjax, forward", forward(usual)),
            ("pdssjax, reverse", jax.jit(jax.value_and_grad(usual))),
        )
    ]
    return found[0], found[1:]


def _timed(name: str, run: Callable[[], tuple[object, object]]) -> Entry:
    seconds, value, gradient = [], np.nan, np.zeros(0)
    for _ in range(1 + REPEATS):
        begun = time.perf_counter()
        value, gradient = map(np.asarray, run())
        seconds.append(time.perf_counter() - begun)
    return Entry(name, float(value), np.asarray(gradient), seconds[0], float(np.median(seconds[1:])))


def _apart(peer: str, python: str, mode: str, tolerance: float) -> Entry:
    from .problem import PARAMETERS, Problem

    problem = Problem()
    script = Path(__file__).parent / "apart" / f"{peer}_gradient.py"
    asked = {"voltage": problem.voltage, "frequency": problem.frequency, "cycles": CYCLES, "mode": mode}
    asked |= {"parameters": PARAMETERS.tolist(), "tolerance": tolerance}
    done = subprocess.run([python, str(script), json.dumps(asked)], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"gradient: {python} could not run {script.name}: {done.stderr.strip().splitlines()[-1]}")
    told = json.loads(done.stdout.strip().splitlines()[-1])
    name = f"{peer}, {mode}, {tolerance:.0e}"
    return Entry(name, told["value"], np.array(told["gradient"]), told["first"], told["run"])


def _table(right: Entry, entries: Sequence[Entry]) -> str:
    lines = [
        "| | error of the value [um] | worst derivative | run [s] | ratio | first call [s] |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    for entry in entries:
        worst = float(np.max(np.abs(entry.gradient / right.gradient - 1.0)))
        lines.append(
            f"| {entry.name} | {abs(entry.value - right.value):.1e} | {worst:.1e} | {entry.run:.3g} "
            f"| {entry.run / entries[0].run:.3g} | {entry.first:.3g} |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
