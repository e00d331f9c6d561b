"""From process start: importing, the first fit, and the whole command `pdssjax identify`.

Every figure comes from fresh processes, once with an empty cache of compiled code and then
with the cache that this leaves.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from ..measure import Effort, Entry, Outcome, seconds_of

_COMMAND = "import sys; from pdssjax.cli.main import main; sys.exit(main(sys.argv[1:]))"
_FIT = """
import json, time
t0 = time.perf_counter()
import pdssjax
from pdssjax.files import EXAMPLE
from pdssjax import identify, prepare_jax
prepare_jax(dedicated=True)
t1 = time.perf_counter()
study = pdssjax.load_study(EXAMPLE / "study.toml")
t2 = time.perf_counter()
identify(study)
t3 = time.perf_counter()
identify(pdssjax.load_study(EXAMPLE / "study.toml"))
t4 = time.perf_counter()
print(json.dumps({"import": t1 - t0, "load": t2 - t1, "first": t3 - t2, "again": t4 - t3}))
"""
_IMPORTS = """
import time
import diffrax, jax, optimistix
begun = time.perf_counter()
import pdssjax.cli.main, pdssjax.inference.identification
print(time.perf_counter() - begun)
"""
_WARM_RUNS = 2


def measure(effort: Effort) -> Outcome:
    """Cold, then with a warm cache."""
    outcome = Outcome([])
    added = [float(_python(_IMPORTS, {})) for _ in range(_WARM_RUNS)]
    outcome.entries.append(_entry("import", "import pdssjax, after jax, diffrax and optimistix", added))
    with tempfile.TemporaryDirectory() as folder:
        command = {"cold": [_command(folder, 0, effort)]}
        command["warm"] = [_command(folder, n + 1, effort) for n in range(_WARM_RUNS)]
        size = sum(file.stat().st_size for file in (Path(folder) / "cache").rglob("*") if file.is_file())
    outcome.entries += _pair("pdssjax identify", "from process start to the last file written", command)
    outcome.lines.append(f"The cache of compiled code for that command takes {size / 1e6:.1f} MB.")
    with tempfile.TemporaryDirectory() as folder:
        fits = [_fit(folder, n, effort) for n in range(1 + _WARM_RUNS)]
    first = {"cold": [fits[0]["first"]], "warm": [fit["first"] for fit in fits[1:]]}
    outcome.entries += _pair("joint fit, fresh process", "first fit, imports apart", first)
    outcome.entries.append(
        _entry("joint fit, fresh process", "second fit of the process", [fit["again"] for fit in fits])
    )
    outcome.facts["startup"] = fits
    return outcome


def _pair(job: str, what: str, times: dict[str, list[float]]) -> list[Entry]:
    kinds = {"cold": "empty cache", "warm": "warm cache"}
    return [_entry(job, f"{what}, {kinds[kind]}", found) for kind, found in times.items()]


def _entry(job: str, who: str, times: list[float]) -> Entry:
    return Entry(job, who, None, times=times, ours=True)


def _command(folder: str, number: int, effort: Effort) -> float:
    effort.report(f"startup: pdssjax identify, run {number + 1}")
    out = str(Path(folder) / f"out{number}")
    return seconds_of(lambda: _python(_COMMAND, _cache(folder), "identify", "--out", out))


def _fit(folder: str, number: int, effort: Effort) -> dict[str, Any]:
    effort.report(f"startup: first fit of a process, run {number + 1}")
    return json.loads(_python(_FIT, _cache(folder)))


def _cache(folder: str) -> dict[str, str]:
    return {"PDSSJAX_CACHE": str(Path(folder) / "cache")}


def _python(program: str, changes: dict[str, str], *arguments: str) -> str:
    """What a fresh interpreter prints."""
    environment = {name: value for name, value in os.environ.items() if name != "EQX_ON_ERROR"} | changes
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments], env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise RuntimeError(f"{program.strip().splitlines()[0]}… failed: {done.stderr[-2000:]}")
    return done.stdout
