"""What grows with the length of a record and with their number: time of the same job at two sizes, warm."""

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp

from pdssjax import Accuracy, Taylor

from ..measure import Effort, Entry, Outcome, interleave, seconds_of
from ..problem import PARAMETERS, EveryCycle, Problem, effector
from ..rig import sawtooths, truth

JOB = "growth"
_CYCLES = (8, 80)
_COPIES = (1, 4)
_ROOM = 2**14
"""Steps that the longest run has room for; all are given the same."""


def measure(effort: Effort) -> Outcome:
    """Eight and eighty cycles, each of them stepped; two and eight records."""
    cycles = [_cycles(count, effort) for count in _CYCLES]
    records = [_records(copies, effort) for copies in _COPIES]
    entries = cycles + records
    interleave(entries, effort)
    lines = [
        f"growth: {_CYCLES[1]} cycles instead of {_CYCLES[0]} take {cycles[1].median / cycles[0].median:.2g} times as "
        f"long, {2 * _COPIES[1]} records instead of 2 {records[1].median / records[0].median:.2g} times"
    ]
    return Outcome(entries, lines=lines)


def _cycles(count: int, effort: Effort) -> Entry:
    """A trajectory of 200 samples a cycle, the shortcut for repeating cycles switched off."""
    effort.report(f"{JOB}: {count} cycles")
    problem = Problem(cycles=count, samples=200 * count + 1)
    accuracy = Accuracy(3e-10, 3e-10, Taylor(12), max_steps=_ROOM)
    drive = EveryCycle(problem.voltage, problem.frequency)
    run = jax.jit(lambda p: effector(p, problem, accuracy, drive))
    return _entry(f"trajectory, {count} cycles, every one stepped", lambda: run(PARAMETERS))


def _records(copies: int, effort: Effort) -> Entry:
    """`study.predict` of the two walks of the packaged example, each so many times."""
    effort.report(f"{JOB}: {2 * copies} records")
    study = sawtooths(every_cycle=True)
    several = [dataclasses.replace(r, name=f"{r.name}, {i}") for i in range(copies) for r in study.records]
    study = dataclasses.replace(study, records=tuple(several))
    _ = study.predictor
    run = jax.jit(lambda values: study.predict(values, Accuracy(3e-10, 3e-10, Taylor(12))))
    values = {path: jnp.asarray(truth()[path]) for path, p in study.parameters.items() if p.free}
    return _entry(f"study.predict, {len(several)} records, every cycle stepped", lambda: run(values))


def _entry(who: str, call: Callable) -> Entry:
    ready = lambda: jax.block_until_ready(call())
    # The first call compiles.
    return Entry(JOB, who, ready, first_seconds=seconds_of(ready), ours=True)
