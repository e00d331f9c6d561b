"""Where and with what a benchmark was run."""

import datetime
import importlib.metadata
import os
import platform
import re
import subprocess
from pathlib import Path
from typing import Any

_PACKAGES = "pdssjax jax jaxlib diffrax equinox optimistix numpy scipy lmfit casadi numba numbalsoda".split()


def header() -> dict[str, Any]:
    """Date, machine, load and versions."""
    return {
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "revision": _output(["git", "describe", "--always", "--dirty"]),
        "processor": processor(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "gcc": _output(["gcc", "-dumpfullversion"]),
        "packages": {name: _version(name) for name in _PACKAGES},
        "load_before": load(),
    }


def load() -> list[float]:
    """Average number of busy processes in the last 1, 5 and 15 minutes; empty where unknown."""
    return [round(x, 2) for x in os.getloadavg()] if hasattr(os, "getloadavg") else []


def processor() -> str:
    """The processor's name, as well as the system tells."""
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        found = re.search(r"model name\s*:\s*(.+)", cpuinfo.read_text(encoding="utf-8"))
        if found:
            return found[1].strip()
    return platform.processor() or platform.machine()


def label(head: dict[str, Any]) -> str:
    """A file name for the results of a day and a machine."""
    machine = re.sub(r"[^a-z0-9]+", "-", f"{head['processor']} {head['cores']} cores".lower()).strip("-")
    return f"{head['date'][:10]}-{machine}"


def _version(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def _output(command: list[str]) -> str | None:
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=Path(__file__).parent)
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip() or None
