"""The first fit on a machine, in CPU time over that of imports: `python -m benchmarks.first_fit`.

The import is that of JAX, diffrax and matplotlib.
`pdssjax identify` on the example, nothing compiled and then everything, with search, report and plots.  Beside it what
diffrax and optimistix need as they come for a single Levenberg-Marquardt step on one record of a walk, from a start
next to the optimum: its Jacobian misses how slips move (`benchmarks.plain_differentiation`).
"""

import os
import resource
import subprocess
import sys
import tempfile

_IMPORT = "import jax, diffrax, matplotlib.pyplot"
_IDENTIFY = "import sys; from pdssjax.cli.main import main; sys.exit(main(sys.argv[1:]))"
_PLAIN = """
import sys, time
import jax, jax.numpy as jnp, optimistix
from benchmarks.peers.diffrax_plain import PEERS
from benchmarks.problem import PARAMETERS, Problem
begun = time.process_time()
jax.config.update("jax_enable_x64", True)
peer, problem, start = PEERS[int(sys.argv[1])], Problem(), jnp.full(PARAMETERS.size, 0.01)
walked = jax.jit(lambda q: peer.run(PARAMETERS * jnp.exp(q), 1e-6, problem))
measured = walked(0.0 * start)
solver, forward = optimistix.LevenbergMarquardt(1e-6, 1e-6), {"jac": "fwd"}
residual = lambda q, _: (walked(q) - measured) / 0.01
found = optimistix.least_squares(residual, solver, start, options=forward, max_steps=1, throw=False)
jax.block_until_ready(found.value)
print(time.process_time() - begun)
"""
ROUNDS = 2


def main() -> int:
    """Print the ratios, each the least of `ROUNDS` rounds in turn."""
    least: dict[str, float] = {}
    for _ in range(ROUNDS):
        with tempfile.TemporaryDirectory() as folder:
            for what, seconds in _round(folder).items():
                least[what] = min(least.get(what, seconds), seconds)
    imported = least["import"]
    print("| | CPU s | over the import |\n|---|--:|--:|")
    for what, seconds in least.items():
        print(f"| {what} | {seconds:.1f} | {seconds / imported:.1f} |")
    return 0


def _round(folder: str) -> dict[str, float]:
    identify = ("identify", "--out", f"{folder}/out", "--overwrite")
    imported = _cpu_seconds(folder, _IMPORT)
    found = {"import": imported}
    for number, name in enumerate(("Tsit5", "Kvaerno5")):
        plain = subprocess.run([sys.executable, "-c", _PLAIN, str(number)], check=True, capture_output=True, text=True)
        found[f"diffrax's {name}, optimistix: import and one step"] = imported + float(plain.stdout)
    found["pdssjax identify, nothing compiled"] = _cpu_seconds(folder, _IDENTIFY, *identify)
    found["pdssjax identify, everything compiled"] = _cpu_seconds(folder, _IDENTIFY, *identify)
    return found


def _cpu_seconds(folder: str, program: str, *arguments: str) -> float:
    """CPU time of a fresh process, whose compiled code is kept in the `folder`."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = os.environ | {"PDSSJAX_CACHE": f"{folder}/cache"}
    subprocess.run([sys.executable, "-c", program, *arguments], env=environment, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    sys.exit(main())
