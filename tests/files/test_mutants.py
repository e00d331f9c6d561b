"""Studies, files, stores and options damaged at random: each is refused in words or read, and none ends the process.

`PDSSJAX_MUTANTS` says how many of each kind (default: 30; of those that need a process each, a tenth).
"""

import os
import subprocess
import sys
import threading
from collections import Counter
from pathlib import Path

import mutants
import pytest

pytestmark = pytest.mark.slow

COUNT = int(os.environ.get("PDSSJAX_MUTANTS", "30"))

BLOCKED = 600.0
"""Seconds without a word after which a process waits for something; processor time is limited within it."""


def attempted(kind: str, first: int, last: int) -> tuple[list[str], str]:
    """What became of the mutants `first` to `last`, as far as one process came, and what it said of finds."""
    command = [sys.executable, mutants.__file__, kind, str(first), str(last)]
    root = Path(__file__).parents[2]
    paths = [str(root), str(root / "tests" / "helpers"), os.environ.get("PYTHONPATH", "")]
    told: list[str] = []
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
    ) as process:
        said: list[str] = []
        reading = threading.Thread(target=lambda: said.append(process.stderr.read()))
        reading.start()
        timer = threading.Timer(BLOCKED, process.kill)
        timer.start()
        for line in process.stdout:
            timer.cancel()
            timer = threading.Timer(BLOCKED, process.kill)
            timer.start()
            told.append(line.strip())
        timer.cancel()
        reading.join()
    return told, "".join(said)[-3000:]


@pytest.mark.parametrize("kind", mutants.KINDS)
def test_what_is_damaged_is_refused_or_read(kind):
    count = max(COUNT // 10, 3) if kind in mutants.SLOW else COUNT
    finds, became, first = [], Counter(), 0
    while first < count:
        told, said = attempted(kind, first, count)
        numbers, results = told[0::2], told[1::2]
        became.update(result.split()[0] for result in results)
        finds += [f"{n}: {r}\n{said}" for n, r in zip(numbers, results, strict=False) if r.startswith("find")]
        if len(results) < count - first:
            first = int(numbers[-1]) + 1 if numbers else count
            finds.append(f"{first - 1}: the process ended, or took more than {mutants.SECONDS} s\n{said}")
        else:
            break
    assert not finds, "\n".join(finds[:20])
    assert became["refused"] + became["kept"] == count
