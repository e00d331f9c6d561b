"""`python -m benchmarks.maps`: how long a map of the packaged example takes, how it grows, and in what memory.

A map of voltages (8 to 150 V) by frequencies (1 to 250 Hz), each size in a fresh process: the first call compiles, the
second is timed.  `--cycles 4` measures the fourth cycle from rest in place of the steady one, `--against 100` compares
so many random points with 200 cycles of a single run each, and nothing else; what was compared is kept (`--kept`), so
that a run that was interrupted, or ended by `--minutes`, goes on.
"""

import argparse
import dataclasses
import functools
import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

FULL = (61, 100)
"""Voltages and frequencies of the map that is to take 8 s on two cores, both directions 16 s."""

FEW = 10
"""Points compared between two looks at the clock."""


class Compared(NamedTuple):
    """A point at which a steady cycle was compared with many cycles."""

    reading: str
    """Of the friction law."""
    voltage: float
    """[V]"""
    frequency: float
    """[Hz]"""
    net_step: float
    """Of the steady cycle [m]."""
    expected: float
    """Of the last of 200 cycles [m]."""
    cycles_to_repeat: int


def study():
    """The packaged example with its true values."""
    import pdssjax
    from pdssjax.files import EXAMPLE

    truth = json.loads((EXAMPLE / "truth.json").read_text())["parameters"]
    loaded = pdssjax.load_study(EXAMPLE / "study.toml")
    return loaded.with_values({path: truth[path]["value"] for path in loaded.parameters})


def over(voltages: int, frequencies: int, both: bool) -> dict[str, np.ndarray]:
    """The axes of a map."""
    axes = {
        "drive.voltage": np.linspace(8.0, 150.0, voltages),
        "drive.frequency": np.geomspace(1.0, 250.0, frequencies),
    }
    return axes | ({"drive.direction": np.array([1.0, -1.0])} if both else {})


def measured(voltages: int, frequencies: int, both: bool, cycles: int | str, workers: int | None) -> dict[str, float]:
    """Seconds of the first and of the second call, points without a steady cycle or a value, peak memory [bytes]."""
    from pdssjax import prepare_jax

    prepare_jax(dedicated=True)
    import pdssjax

    call = lambda: pdssjax.sweep(study(), over(voltages, frequencies, both), cycles=cycles, workers=workers)

    def timed():
        begun = time.perf_counter()
        return call(), time.perf_counter() - begun

    (data, first), (_, second) = timed(), timed()
    unsteady = int((data.cycles_to_repeat == 0).sum()) if "cycles_to_repeat" in data else 0
    unit = 1 if sys.platform == "darwin" else 1024
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
    failed = int((data.failure != 0).sum())
    return dict(points=data.failure.size, first=first, second=second, unsteady=unsteady, failed=failed, peak=peak)


def fresh(*arguments: object, devices: int = 1) -> dict[str, float]:
    """`measured` in a process of its own, which sees the CPU as so many devices."""
    program = f"import json; from benchmarks.maps import measured; print(json.dumps(measured(*{arguments!r})))"
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count={devices}"
    environment = os.environ | {"XLA_FLAGS": flags}
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"the map failed: {done.stderr[-2000:]}")
    return json.loads(done.stdout.splitlines()[-1])


def compared(points: int, reading: str, kept: Path, minutes: float) -> list[Compared]:
    """At random points the net step [m] of the steady cycle, and that of the last of 200 cycles from rest.

    What was found is in the file `kept`, a line a point; points that it has are not computed again, and after
    `minutes` the rest is left for another call.
    """
    from pdssjax import sweep
    from pdssjax.sweeps import Listed

    rng = np.random.default_rng(1)
    at = np.column_stack([rng.uniform(8, 150, points), 10 ** rng.uniform(0.3, 2.4, points)])
    found = {(line.reading, line.voltage, line.frequency): line for line in read_compared(kept)}
    left = [row for row in at.tolist() if (reading, *row) not in found]
    asked, ends = dataclasses.replace(study(), friction_state=reading), time.monotonic() + 60.0 * minutes
    for begin in range(0, len(left), FEW):
        if time.monotonic() > ends:
            break
        few = left[begin : begin + FEW]
        voltages, frequencies = np.array(few).T
        listed = Listed({"drive.voltage": voltages, "drive.frequency": frequencies})
        data = sweep(asked, listed, cycles="steady", workers=1)
        brute = after_200(reading)
        with kept.open("a") as file:
            for i, row in enumerate(few):
                net, expected = float(data.net_step[i]), float(brute(np.array(row)))
                line = Compared(reading, row[0], row[1], net, expected, int(data.cycles_to_repeat[i]))
                found[(reading, *row)] = line
                file.write(json.dumps(line._asdict()) + "\n")
    return [found[(reading, *row)] for row in at.tolist() if (reading, *row) in found]


@functools.cache
def after_200(reading: str):
    """A function of voltage and frequency: the net step [m] of the last of 200 cycles from rest."""
    from pdssjax.sweeps import Listed, plan_sweep

    asked = dataclasses.replace(study(), friction_state=reading)
    function = plan_sweep(asked, Listed({"drive.voltage": np.ones(1), "drive.frequency": np.ones(1)})).function
    return net_step_after(function)


def net_step_after(function, cycles: int = 200):
    """Of a planned sweep's `function`: by a point's numbers the net step [m] of the last of so many cycles from rest.

    NaN where the integration failed.
    """
    import jax
    import jax.numpy as jnp

    from pdssjax import Accuracy
    from pdssjax.integration import integrate_to_times

    @jax.jit
    def run(values):
        system = function.system(values)
        times = jnp.arange(cycles - 1, cycles + 1) / jnp.asarray(system.drive.cycle_frequency(), float) * (1.0 - 1e-12)
        reached = integrate_to_times(system, times, Accuracy(max_steps=4_000_000))
        return jnp.where(reached.failure > 0, jnp.nan, reached.x.d[0] - reached.x.d[1])

    return run


def read_compared(kept: Path) -> list[Compared]:
    """What the file `kept` holds; a last line that was cut off is left out."""
    lines = kept.read_text().splitlines() if kept.exists() else []
    return [Compared(**json.loads(line)) for line in lines if line.endswith("}")]


def say_compared(reading: str, lines: list[Compared], points: int) -> None:
    """One line about a reading."""
    if not lines:
        print(f"{reading}: no point yet", flush=True)
        return
    errors = np.array([abs(line.net_step - line.expected) for line in lines])
    late = sum(line.cycles_to_repeat > 1 for line in lines)
    print(
        f"{reading}: net step within {1e6 * errors.max():.1e} um of 200 cycles at {len(lines)} of {points} points "
        f"(median {1e6 * np.median(errors):.1e} um, {(errors <= 1e-10).sum()} within 1e-4 um), {late} repeat after 2 "
        f"or 3 cycles, {sum(line.cycles_to_repeat == 0 for line in lines)} not steady",
        flush=True,
    )


def main() -> None:
    """Prints a line a measurement."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cycles", default="steady")
    parser.add_argument("--workers", type=int, help="threads (default: one a core)")
    parser.add_argument("--devices", type=int, default=1, metavar="N", help="as which the CPU is seen (default 1)")
    parser.add_argument("--against", type=int, default=0, metavar="POINTS", help="compare with 200 cycles at each")
    parser.add_argument("--kept", type=Path, default=Path("out/maps_against.jsonl"), help="file of what was compared")
    parser.add_argument("--minutes", type=float, default=10.0, help="of comparing, a reading, at most (default 10)")
    parser.add_argument("--largest", type=int, default=100_000, metavar="POINTS", help="of the growth (default 100000)")
    options = parser.parse_args()
    if options.against:
        compare(options.against, options.kept, options.minutes)
        return
    cycles = int(options.cycles) if options.cycles.isdigit() else options.cycles
    sizes = [(*FULL, False), (*FULL, True), (10, 100, False), (options.largest // 100, 100, False)]
    for voltages, frequencies, both in sizes:
        found = fresh(voltages, frequencies, both, cycles, options.workers, devices=options.devices)
        print(
            f"{found['points']} points{', both directions' if both else ''}: first call {found['first']:.2f} s, second "
            f"{found['second']:.2f} s, peak memory {found['peak'] / 1e6:.0f} MB, {found['unsteady']} not steady, "
            f"{found['failed']} failed",
            flush=True,
        )


def compare(points: int, kept: Path, minutes: float) -> None:
    """Compares steady cycles with 200 cycles, in both readings."""
    from pdssjax import prepare_jax

    prepare_jax(dedicated=True)
    kept.parent.mkdir(parents=True, exist_ok=True)
    for reading in ("deflection", "force"):
        say_compared(reading, compared(points, reading, kept, minutes), points)


if __name__ == "__main__":
    main()
