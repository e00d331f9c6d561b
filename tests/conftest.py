"""Every test runs in double precision, with compiled code kept between runs (`PDSSJAX_CACHE` says where).

Nearly all of the tests' time goes into compiling, so they compile quickly rather than well. A record of a walk and its
Jacobian take 21 CPU seconds at LLVM's first level, 17 at none, and 15 where no operation says where it was written.
"""

import ctypes
import gc
import math
import os
import resource
import sys
from pathlib import Path

import equinox as eqx
import jax
import pytest
import threadpoolctl
from stand_ins import calls as calls, undrawn as undrawn

from pdssjax import prepare_jax
from pdssjax.core import forget_programs, keep_programs_in

# Of what is traced nobody asks where it was written; also for the processes that tests start.
for setting, value in (("jax_include_full_tracebacks_in_locations", False), ("jax_traceback_in_locations_limit", 0)):
    os.environ[setting.upper()] = str(int(value))
    jax.config.update(setting, value)


def pytest_configure(config):
    """Let the default tests compile without LLVM's optimisation; others run longer than they compile."""
    flags = os.environ.get("XLA_FLAGS", "").split()
    if not any("optimization_level" in flag for flag in flags):
        flags.append(f"--xla_backend_optimization_level={0 if config.option.markexpr == 'not slow' else 1}")
    flags.append("--xla_llvm_disable_expensive_passes=true")
    # XLA reads them when the first computation is asked for.
    os.environ["XLA_FLAGS"] = " ".join(flags)
    # The matrices of tests are small: a second thread of NumPy's waits, at full load, longer than it works.
    threadpoolctl.threadpool_limits(1, "blas")
    prepare_jax(dedicated=True)


def pytest_collection_finish():
    """Leave out of every later look for garbage what was imported: a million objects that stay."""
    gc.collect()
    gc.freeze()


def pytest_runtest_setup():
    """Keep compiled code by JAX's cache alone, whose keys outlive changes; a command run here keeps programs."""
    keep_programs_in(None, "")


MUCH = 1.6
"""Memory of a worker [GB] from which on what was compiled is dropped; two workers stay below 4 GB in all."""


def memory():
    """What the process has now [GB]; infinite where that is not known."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return math.inf
    return 1e-9 * pages * os.sysconf("SC_PAGE_SIZE")


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item, nextitem):
    """Drop what was compiled at the end of a file, once it is much: it adds up to gigabytes."""
    if nextitem is not None and nextitem.path != item.path and memory() > MUCH:
        jax.clear_caches()
        eqx.clear_caches()
        forget_programs()
        gc.collect()
        if sys.platform == "linux":
            ctypes.CDLL(None).malloc_trim(0)


COSTS = []
"""Of the workers that have ended: CPU seconds and peak memory [GB]."""


def cost():
    """CPU seconds of this process and of those that it started and saw end; its own peak memory [GB]."""
    own, others = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    unit = 1e-9 if sys.platform == "darwin" else 1e-6  # of bytes there, of kilobytes elsewhere
    return sum(u.ru_utime + u.ru_stime for u in (own, others)), unit * own.ru_maxrss


def pytest_sessionfinish(session):
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["cost"] = cost()


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node):
    COSTS.extend([node.workeroutput["cost"]] if hasattr(node, "workeroutput") else [])


def pytest_terminal_summary(terminalreporter):
    seconds, peaks = zip(*(COSTS or [cost()]), strict=True)
    each = " + ".join(f"{peak:.1f}" for peak in peaks)
    terminalreporter.write_line(f"CPU {sum(seconds):.0f} s, peak memory {sum(peaks):.1f} GB ({each} by worker)")
