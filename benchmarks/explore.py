"""How long the page of `pdssjax explore` takes for a redraw of the packaged example, warm, at the server.

    python -m benchmarks.explore

Turns a parameter fifty times, and prints for each record the median and the largest time from the number of a
slider to the arrays that are drawn, in ms.  The page adds what the browser takes.
"""

import time

import numpy as np

import pdssjax
from pdssjax import prepare_jax
from pdssjax.explore import Workbench, initial_stretch, instants_of, settings_of

from .rig import example, truth

TURNS = 50


def main() -> None:
    prepare_jax(dedicated=True)
    study = example()
    study = study.with_values({path: truth()[path] for path in study.parameters})
    bench = Workbench(study, settings_of(study))
    for record in study.records:
        begun = time.perf_counter()
        bench.warm(record)
        compiled = time.perf_counter() - begun
        times = [1e3 * turn(bench, record, 1.0 + 1e-3 * k) for k in range(TURNS)]
        print(f"{record.name:12s} compiled in {compiled:5.1f} s; {np.median(times):5.1f} ms, at most {max(times):5.1f}")


def turn(bench: Workbench, record: pdssjax.Record, factor: float) -> float:
    """Seconds for one redraw with another gain."""
    settings = bench.initial.with_values({"piezo.gain": factor * bench.initial.values["piezo.gain"]})
    begun = time.perf_counter()
    found = bench.records.redraw_at_once(record.name, settings, instants_of(record, *initial_stretch(record)))
    assert found is not None and not found.message
    return time.perf_counter() - begun


if __name__ == "__main__":
    main()
