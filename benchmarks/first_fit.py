"""The first fit on a machine, in CPU time over that of an import: `python -m benchmarks.first_fit`.

The import is that of JAX, diffrax and matplotlib.  `pdssjax identify` runs on the example, nothing compiled and then
everything, with search, report and plots.  Beside it diffrax and optimistix, as they come, take a single
Levenberg-Marquardt step on one record of a walk from a start next to the optimum.  Their Jacobian misses how slips move
(`benchmarks.plain_differentiation`).
"""

import os
import resource
import subprocess
import sys
import tempfile

_IMPORT = "import jax, diffrax, matplotlib.pyplot"
_IDENTIFY = "import sys; from pdssjax.cli.main import main; sys.exit(main(sys.argv[1:]))"
_PLAIN = """
import sys
import jax, jax.numpy as jnp, optimistix
from benchmarks.peers.diffrax_plain import PEERS
from benchmarks.problem import PARAMETERS, Problem
jax.config.update("jax_enable_x64", True)
peer, problem, start = PEERS[int(sys.argv[1])], Problem(), jnp.full(PARAMETERS.size, 0.01)
walked = jax.jit(lambda q: peer.run(PARAMETERS * jnp.exp(q), 1e-6, problem))
measured = walked(0.0 * start)
solver, forward = optimistix.LevenbergMarquardt(1e-6, 1e-6), {"jac": "fwd"}
residual = lambda q, _: (walked(q) - measured) / 0.01
found = optimistix.least_squares(residual, solver, start, options=forward, max_steps=1, throw=False)
jax.block_until_ready(found.value)
"""
ROUNDS = 2


def main() -> int:
    """Print means over `ROUNDS` rounds; imports are measured before each command, since a machine's speed changes."""
    found: dict[str, list[float]] = {}
    for _ in range(ROUNDS):
        with tempfile.TemporaryDirectory() as folder:
            _measure(folder, found)
    imported = _mean(found["import"])
    print("| | CPU s | over the import |\n|---|--:|--:|")
    for what, seconds in found.items():
        print(f"| {what} | {_mean(seconds):.1f} | {_mean(seconds) / imported:.1f} |")
    return 0


def _measure(folder: str, found: dict[str, list[float]]) -> None:
    """Add one round to the CPU seconds `found`, by what was run."""
    identify = ("identify", "--out", f"{folder}/out", "--overwrite")
    commands = {
        "diffrax's Tsit5 and optimistix: one step": (_PLAIN, "0"),
        "diffrax's Kvaerno5 and optimistix: one step": (_PLAIN, "1"),
        "pdssjax identify, nothing compiled": (_IDENTIFY, *identify),
        "pdssjax identify, everything compiled": (_IDENTIFY, *identify),
    }
    for what, command in commands.items():
        imports = [_cpu_seconds(folder, _IMPORT) for _ in range(3)]
        found.setdefault("import", []).extend(imports)
        found.setdefault(what, []).append(_cpu_seconds(folder, *command))


def _mean(numbers: list[float]) -> float:
    return sum(numbers) / len(numbers)


def _cpu_seconds(folder: str, program: str, *arguments: str) -> float:
    """CPU time of a fresh process, whose compiled code is kept in the `folder`."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    # Python keeps its bytecode, as it does for users.
    environment = os.environ | {"PDSSJAX_CACHE": f"{folder}/cache", "PYTHONDONTWRITEBYTECODE": ""}
    subprocess.run([sys.executable, "-c", program, *arguments], env=environment, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    sys.exit(main())
