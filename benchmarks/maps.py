"""`python -m benchmarks.maps`: how long a map of the packaged example takes, how it grows, and in what memory.

A map of voltages (8 to 150 V) by frequencies (1 to 250 Hz), each size in a fresh process: the first call compiles, the
second is timed.  `--cycles 4` measures the fourth cycle from rest in place of the steady one, `--against 200` compares
so many random points with 200 cycles of a single run each.
"""

import argparse
import json
import resource
import subprocess
import sys
import time

import numpy as np

FULL = (61, 100)
"""Voltages and frequencies of the map that is to take 8 s on two cores, both directions 16 s."""


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
    from pdssjax.core import prepare_jax

    prepare_jax()
    import pdssjax

    call = lambda: pdssjax.sweep(study(), over(voltages, frequencies, both), cycles=cycles, workers=workers)
    begun = time.perf_counter()
    call()
    compiled = time.perf_counter()
    data = call()
    seconds = [compiled - begun, time.perf_counter() - compiled]
    unsteady = int((data.cycles_to_repeat == 0).sum()) if "cycles_to_repeat" in data else 0
    unit = 1 if sys.platform == "darwin" else 1024
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
    failed = int((data.failure != 0).sum())
    return dict(
        points=data.failure.size, first=seconds[0], second=seconds[1], unsteady=unsteady, failed=failed, peak=peak
    )


def fresh(*arguments: object) -> dict[str, float]:
    """`measured` in a process of its own."""
    program = f"import json; from benchmarks.maps import measured; print(json.dumps(measured(*{arguments!r})))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"the map failed: {done.stderr[-2000:]}")
    return json.loads(done.stdout.splitlines()[-1])


def worst_error(points: int, reading: str) -> tuple[float, int]:
    """Worst error of the net step [m] at random points against 200 cycles each, and points without a steady cycle."""
    import dataclasses

    import jax
    import jax.numpy as jnp

    from pdssjax import Accuracy, sweep
    from pdssjax.integration import integrate_to_times
    from pdssjax.sweeps import Listed, plan_sweep

    rng = np.random.default_rng(1)
    at = Listed({"drive.voltage": rng.uniform(8, 150, points), "drive.frequency": 10 ** rng.uniform(0.3, 2.4, points)})
    asked = dataclasses.replace(study(), friction_state=reading)
    function = plan_sweep(asked, at).function

    @jax.jit
    def after_200(values):
        system = function.system(values)
        times = jnp.arange(199, 201) / jnp.asarray(system.drive.cycle_frequency(), float) * (1.0 - 1e-12)
        reached = integrate_to_times(system, times, Accuracy(max_steps=400_000)).x
        return reached.d[0] - reached.d[1]

    data = sweep(asked, at, cycles="steady")
    expected = np.array([float(after_200(values)) for values in at.values()])
    return float(np.abs(data.net_step.values - expected).max()), int((data.cycles_to_repeat == 0).sum())


def main() -> None:
    """Prints a line a measurement."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cycles", default="steady")
    parser.add_argument("--workers", type=int, help="threads (default: one a core)")
    parser.add_argument("--against", type=int, default=0, metavar="POINTS", help="compare with 200 cycles at each")
    parser.add_argument("--largest", type=int, default=100_000, metavar="POINTS", help="of the growth (default 100000)")
    options = parser.parse_args()
    cycles = int(options.cycles) if options.cycles.isdigit() else options.cycles
    sizes = [(*FULL, False), (*FULL, True), (10, 100, False), (options.largest // 100, 100, False)]
    for voltages, frequencies, both in sizes:
        found = fresh(voltages, frequencies, both, cycles, options.workers)
        print(
            f"{found['points']} points{', both directions' if both else ''}: first call {found['first']:.2f} s, second "
            f"{found['second']:.2f} s, peak memory {found['peak'] / 1e6:.0f} MB, {found['unsteady']} not steady, "
            f"{found['failed']} failed",
            flush=True,
        )
    if options.against:
        from pdssjax.core import prepare_jax

        prepare_jax()
        for reading in ("deflection", "force"):
            error, unsteady = worst_error(options.against, reading)
            print(
                f"{reading}: net step within {1e6 * error:.1e} um of 200 cycles at {options.against} points, "
                f"{unsteady} not steady",
                flush=True,
            )


if __name__ == "__main__":
    main()
