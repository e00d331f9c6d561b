"""A process that holds the lock of a file until it is told to end, or is killed."""

import contextlib
import os
import subprocess
import sys

_HOLDS = """
import sys, pathlib
from pdssjax.files.file_lock import file_lock
with file_lock(pathlib.Path(sys.argv[1]), pathlib.Path(), "x"):
    print("locked", flush=True)
    sys.stdin.read()
"""


@contextlib.contextmanager
def holding(file):
    """The process that has the lock of `file`."""
    command = [sys.executable, "-c", _HOLDS, str(file)]
    paths = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=paths) as process:
        assert process.stdout is not None and process.stdout.readline() == "locked\n"
        yield process
        process.kill()
