"""Reads a file in a process of its own, with limits of memory and time: libraries of formats trust its content.

A single wrong bit makes SciPy crash, and HDF5's library loop without end or take gigabytes.  `answers` asks a process
what a generator function of pdssjax yields for a file: pairs of something that JSON can write, and an array.  The
process gets a question as a line of JSON on its standard input.  It answers with parts on its standard output: the
length of a JSON text (8 bytes, little-endian), that text, and the array as 8-byte floats.  Nothing is unpickled, and
no more than one part is in memory at a time.  A process that has answered waits for the next question, since starting
one takes a third of a second; one that failed is ended, for what is in its memory may be damaged.
"""

import atexit
import contextlib
import importlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import IO, Any, TypeAlias

import numpy as np
from jaxtyping import Float

from ..core import InputError, InputWarning
from .json_text import Plain

Pair: TypeAlias = tuple[Plain, Float[np.ndarray, "..."]]
"""What JSON can write, and an array."""

Pairs: TypeAlias = Iterator[Pair]

MEMORY = 1 << 30
"""Bytes that the process may take for a file beyond what it began with; `MEMORY_PER_BYTE` more for each of the file."""

MEMORY_PER_BYTE = 20

SECONDS = 8
"""Seconds of processor time for a file, and one more for each `BYTES_PER_SECOND`."""

BYTES_PER_SECOND = 5_000_000

CLOCK = 2 if sys.platform == "win32" else 20
"""Ratio of elapsed to processor time allowed: Windows limits elapsed time only, elsewhere processors are shared."""

_Process: TypeAlias = "subprocess.Popen[bytes]"

_idle: dict[int, list[_Process]] = {}
"""Processes that wait for a question, by the process that started them: one that is forked shares no pipe."""


def answers(function: Callable[..., Pairs], file: Path, *arguments: Plain) -> Generator[Pair]:
    """What `function(file, *arguments)` yields, in a process of its own; `function` is found by its name there.

    **Raises:** `InputError` where the function does, `ValueError` with a short reason where it raises anything else,
    crashes, or needs more memory or time than the size of the file lets it have; `OSError` where there is no file.
    """
    size = file.stat().st_size
    seconds = SECONDS + size // BYTES_PER_SECOND
    question = {
        "function": [function.__module__, function.__qualname__],
        "arguments": [str(file), *arguments],
        "folder": os.getcwd(),
        "memory": MEMORY + MEMORY_PER_BYTE * size,
        "seconds": seconds,
    }
    process = _process()
    assert process.stdin is not None and process.stdout is not None
    kept = False
    try:
        process.stdin.write(json.dumps(question).encode() + b"\n")
        process.stdin.flush()
        while "last" not in (part := _part(process, process.stdout, seconds))[0]:
            yield part[0]["item"], part[1]
        kept = True
    except GeneratorExit:
        # Who has seen enough has often seen all: then the process is free for the next file.
        with contextlib.suppress(Exception):
            kept = "last" in _part(process, process.stdout, seconds)[0]
        raise
    except BrokenPipeError:
        raise ValueError("the process that reads it has ended") from None
    finally:
        if kept:
            _idle.setdefault(os.getpid(), []).append(process)
        else:
            _end(process)


def _process() -> _Process:
    waiting = _idle.get(os.getpid(), [])
    while waiting:
        process = waiting.pop()
        if process.poll() is None:
            return process
        _end(process)
    program = "import sys; sys.path.insert(0, sys.argv[1]); "
    program += "from pdssjax.files.reading_process import serve; del sys.path[0]; serve()"
    # One thread: each that a library of linear algebra begins takes address space, which is limited.
    alone = {f"{library}_NUM_THREADS": "1" for library in ("OPENBLAS", "OMP", "MKL")}
    return subprocess.Popen(
        [sys.executable, "-P", "-c", program, str(Path(__file__).parents[2])],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, **alone},
    )


def _end(process: _Process) -> None:
    process.kill()
    with contextlib.suppress(OSError), process:
        pass


@atexit.register
def _end_idle() -> None:
    for process in _idle.pop(os.getpid(), []):
        _end(process)


def _part(process: _Process, stream: IO[bytes], seconds: int) -> tuple[dict[str, Any], np.ndarray]:
    """The next part of an answer."""
    timer = threading.Timer(CLOCK * seconds, process.kill)
    timer.start()
    try:
        said = json.loads(_exactly(stream, int.from_bytes(_exactly(stream, 8), "little")))
        values = np.frombuffer(_exactly(stream, 8 * int(np.prod(said["shape"]))), "<f8").reshape(said["shape"])
    except EOFError:
        crashed = timer.is_alive() and -process.wait() not in (getattr(signal, "SIGXCPU", 24), 9)
        reason = "crashed on what is in it" if crashed else f"came to no end in {seconds} s"
        raise ValueError(f"the library that reads it {reason}") from None
    finally:
        timer.cancel()
    for text in said["warned"]:
        warnings.warn(text, InputWarning, stacklevel=3)
    if "refused" in said:
        raise InputError(said["refused"])
    if "broken" in said:
        raise ValueError(said["broken"])
    return said, values


def _exactly(stream: IO[bytes], count: int) -> bytes:
    found = stream.read(count)
    if len(found) < count:
        raise EOFError
    return found


def serve() -> None:
    """Answer questions on standard input until it ends; what that process runs."""
    # A user who breaks off the command line reaches this process, too; the one that asked ends it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Libraries print.
    with os.fdopen(os.dup(1), "wb") as output, open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        for line in sys.stdin.buffer:
            question = json.loads(line)
            os.chdir(question["folder"])
            _limit(question["memory"], question["seconds"])
            _answer(question, output)


def _answer(question: dict[str, Any], output: IO[bytes]) -> None:
    def say(said: dict[str, Any], values: np.ndarray) -> None:
        warned = [str(warning.message) for warning in caught if issubclass(warning.category, InputWarning)]
        caught.clear()
        text = json.dumps({**said, "shape": values.shape, "warned": warned}).encode()
        output.write(len(text).to_bytes(8, "little") + text)
        output.write(np.ascontiguousarray(values, "<f8").data)
        output.flush()

    nothing = np.zeros(0)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        module, name = question["function"]
        file, *arguments = question["arguments"]
        try:
            for item, values in getattr(importlib.import_module(module), name)(Path(file), *arguments):
                say({"item": item}, values)
            say({"last": True}, nothing)
        except InputError as error:
            say({"refused": str(error)}, nothing)
        except MemoryError:
            say({"broken": f"it needs more than {question['memory'] / 2**30:.1f} GiB of memory"}, nothing)
        except Exception as error:  # libraries raise errors of many types
            say({"broken": str(error) or type(error).__name__}, nothing)


def _limit(memory: int, seconds: int) -> None:
    """Let this process take as many bytes and seconds more, as far as the system knows such limits; no core dump."""
    try:
        import resource
    except ImportError:  # Windows
        return
    limits = [(resource.RLIMIT_CPU, int(time.process_time()) + 1 + seconds), (resource.RLIMIT_CORE, 0)]
    with contextlib.suppress(OSError, ValueError):
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        limits.append((resource.RLIMIT_AS, pages * resource.getpagesize() + memory))
    for kind, most in limits:
        hard = resource.getrlimit(kind)[1]
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(kind, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))
