"""Builds what is released and tries it where the repository is not: `make wheel-check`.

The wheel is made from the source distribution and installed twice: with the lowest version of each dependency that
pyproject.toml allows, on the oldest Python of this machine that will do, and with the newest of each on the newest
Python.  In an empty folder the command must then show its help, copy the example and identify it.  With the newest, a
selection of the tests runs as well.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
PLACE = ROOT / "out" / "wheel-check"

KNOWN = {
    "piezo.gain": (1.007063e-7, 1e-6),
    "piezo.natural_frequency": (6734.99, 1e-6),
    "friction.sigma0_a": (1.183e6, 5e-4),
}
"""What the example identifies [SI], and to what relative error README.md prints it."""

TESTS = [
    "tests/core",
    "tests/integration/test_system.py",
    "tests/integration/test_public_integrate.py",
    "tests/friction/test_laws.py",
    "tests/cli/test_start_up.py",
]
"""What runs with the newest of everything; a warning is an error there, too."""

FOR_TESTS = ["pytest>=8.4", "pytest-xdist>=3.8"]


def main() -> None:
    shutil.rmtree(PLACE, ignore_errors=True)
    pythons = installed_pythons()
    wheel = build()
    lowest, newest = min(pythons), max(pythons)
    print(f"Pythons here: {', '.join('.'.join(map(str, version)) for version in sorted(pythons))}", flush=True)
    constraints = PLACE / "lowest.txt"
    constraints.write_text("\n".join(lowest_versions()) + "\n", encoding="utf-8")
    low = install("lowest", pythons[lowest], str(wheel), "-c", str(constraints))
    try_out(low)
    new = install("newest", pythons[newest], str(wheel), *FOR_TESTS)
    try_out(new)
    if newest == sys.version_info[:2]:
        print("There is no Python here newer than that of `make test`: the newest versions were tried with it.")
    run(
        new.parent / "python",
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "-n",
        "2",
        "--dist",
        "loadfile",
        *TESTS,
        cwd=ROOT,
        # A level of LLVM at which jaxlib 0.12 showed that events were lost; by default tests compile at 0.
        XLA_FLAGS="--xla_backend_optimization_level=1",
    )


def build() -> Path:
    """The wheel, made from the source distribution."""
    run(sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", str(PLACE / "dist"), cwd=ROOT)
    (source,) = (PLACE / "dist").glob("*.tar.gz")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
    run(*pip, "wheel", "-q", "--no-deps", "--no-build-isolation", "-w", str(PLACE / "dist"), str(source), cwd=PLACE)
    (wheel,) = (PLACE / "dist").glob("*.whl")
    return wheel


def lowest_versions() -> Iterator[str]:
    """Each dependency at its lower bound."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for dependency in project["dependencies"]:
        name, bound = re.fullmatch(r"([\w.-]+)>=([\w.]+)(?:,.*)?", dependency).groups()
        yield f"{name}=={bound}"


def installed_pythons() -> dict[tuple[int, ...], str]:
    """By their versions, those that are released, new enough and able to make environments."""
    folders = os.environ.get("PATH", "").split(os.pathsep)
    pyenv = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv") / "versions"
    folders += [str(folder) for folder in pyenv.glob("*/bin")]
    paths = {sys.executable}
    paths |= {
        str(path)
        for folder in folders
        if folder
        for path in Path(folder).glob("python3.*")
        if path.suffix[1:].isdecimal()
    }
    asks = "import ensurepip, sys, venv; print(*sys.version_info[:4], sys.implementation.name)"
    found = {}
    for path in [*sorted(paths - {sys.executable}), sys.executable]:  # of one version, the one that runs this
        told = subprocess.run([path, "-c", asks], capture_output=True, text=True, check=False, env=environment())
        words = told.stdout.split()
        if told.returncode == 0 and words[3:] == ["final", "cpython"]:
            found[tuple(map(int, words[:2]))] = path
    return {version: path for version, path in found.items() if version >= (3, 11)}


def install(name: str, python: str, *what: str) -> Path:
    """A new environment with the wheel; the command in it."""
    folder = PLACE / name
    run(python, "-m", "venv", str(folder))
    pip = [str(folder / "bin" / "python"), "-m", "pip", "--disable-pip-version-check"]
    run(*pip, "install", "-q", "--only-binary", ":all:", *what)
    run(*pip, "list")
    return folder / "bin" / "pdssjax"


def try_out(command: Path) -> None:
    """In an empty folder, as a user does."""
    folder = command.parents[1] / "empty"
    folder.mkdir()
    run(command, "--help", cwd=folder)
    run(command, "example", "mine", cwd=folder)
    run(command, "identify", "mine/study.toml", "--out", "out", cwd=folder)
    estimate = json.loads((folder / "out" / "estimate.json").read_text(encoding="utf-8"))
    for path, (expected, tolerance) in KNOWN.items():
        found = estimate["parameters"][path]["value"]
        if abs(found - expected) > tolerance * expected:
            sys.exit(f"{command}: {path} of the example is {found}, expected {expected}.")


def run(*command: object, cwd: Path = PLACE, **variables: str) -> None:
    """A command that must succeed, without what would lead it to the repository; with `variables` of environment."""
    print("+", *command, flush=True)
    begun = time.perf_counter()
    cwd.mkdir(parents=True, exist_ok=True)
    done = subprocess.run([str(word) for word in command], cwd=cwd, env=environment() | variables, check=False)
    print(f"  {time.perf_counter() - begun:.0f} s", flush=True)
    if done.returncode:
        sys.exit(f"It failed, with status {done.returncode}: {' '.join(map(str, command))}")


def environment() -> dict[str, str]:
    """The user's, less what changes how Python, JAX and pdssjax behave."""
    kept = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("PYTHON", "JAX_", "XLA_", "VIRTUAL_ENV"))
    }
    return kept | {"PDSSJAX_CACHE": str(PLACE / "cache")}


if __name__ == "__main__":
    main()
