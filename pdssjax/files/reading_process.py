"""Reads a file in a process of its own, with limits of memory and time, since libraries trust the content of a file.

A single wrong bit makes SciPy crash, and HDF5's library loop without end or take gigabytes.  `run_isolated`
runs a generator function of pdssjax for a file in such a process; the function yields pairs of a value that JSON can
write and an array.  The process gets a request as a line of JSON on its standard input.  It answers with a part for
each pair on its standard output: the length of a JSON text (8 bytes, little-endian), that text, and the array as 8-byte
floats.  Nothing is unpickled, and only one part is in memory at a time.  A process waits for the next request, since
starting one takes a third of a second; a process that failed is ended, since its memory may be damaged.
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
"""A value that JSON can write, and an array."""

Pairs: TypeAlias = Iterator[Pair]

MEMORY, MEMORY_PER_BYTE = 1 << 30, 20
"""Bytes that the process may take for a file beside those at its start, and further bytes for each byte of the file."""

SECONDS, BYTES_PER_SECOND = 8, 5_000_000
"""Seconds of processor time for a file, and the bytes of the file for which one more second is allowed."""

CLOCK = 2 if sys.platform == "win32" else 20
"""Ratio of elapsed to processor time allowed: Windows limits elapsed time only, elsewhere processors are shared."""

_Process: TypeAlias = "subprocess.Popen[bytes]"

_idle: dict[int, list[_Process]] = {}
"""Processes that wait for a request, by the process that started them: a forked process must not share their pipes."""


def run_isolated(function: Callable[..., Pairs], file: Path, *arguments: Plain) -> Generator[Pair]:
    """Iterate over `function(file, *arguments)` in a process of its own, which imports `function` by its name.

    **Raises:** `InputError` where the function does, `ValueError` with a short reason where it raises anything else,
    crashes, or needs more memory or time than the size of the file lets it have; `OSError` where there is no file.
    """
    size = file.stat().st_size
    seconds = SECONDS + size // BYTES_PER_SECOND
    request = {
        "function": [function.__module__, function.__qualname__],
        "arguments": [str(file), *arguments],
        "folder": os.getcwd(),
        "memory": MEMORY + MEMORY_PER_BYTE * size,
        "seconds": seconds,
    }
    process = _process()
    assert process.stdin is not None and process.stdout is not None
    reusable = False
    try:
        process.stdin.write(json.dumps(request).encode() + b"\n")
        process.stdin.flush()
        while "last" not in (part := _part(process, process.stdout, seconds))[0]:
            yield part[0]["item"], part[1]
        reusable = True
    except GeneratorExit:
        # A caller that stops early often stops at the last part, and then the process is free for the next file.
        with contextlib.suppress(Exception):
            reusable = "last" in _part(process, process.stdout, seconds)[0]
        raise
    except BrokenPipeError:
        raise ValueError("the process that reads it has ended") from None
    finally:
        if reusable:
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
    # One thread, since each thread of a library of linear algebra takes address space, which is limited.
    single_thread = {f"{library}_NUM_THREADS": "1" for library in ("OPENBLAS", "OMP", "MKL")}
    return subprocess.Popen(
        [sys.executable, "-P", "-c", program, str(Path(__file__).parents[2])],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, **single_thread},
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
        content = json.loads(_exactly(stream, int.from_bytes(_exactly(stream, 8), "little")))
        values = np.frombuffer(_exactly(stream, 8 * int(np.prod(content["shape"]))), "<f8").reshape(content["shape"])
    except EOFError:
        crashed = timer.is_alive() and -process.wait() not in (getattr(signal, "SIGXCPU", 24), 9)
        reason = "crashed on what is in it" if crashed else f"came to no end in {seconds} s"
        raise ValueError(f"the library that reads it {reason}") from None
    finally:
        timer.cancel()
    for text in content["warned"]:
        warnings.warn(text, InputWarning, stacklevel=3)
    if "refused" in content:
        raise InputError(content["refused"])
    if "broken" in content:
        raise ValueError(content["broken"])
    return content, values


def _exactly(stream: IO[bytes], count: int) -> bytes:
    content = stream.read(count)
    if len(content) < count:
        raise EOFError
    return content


def serve() -> None:
    """Answer requests on standard input until it ends: the program of the process."""
    # Ctrl-C also reaches this process, which its parent ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Libraries print to standard output.
    with os.fdopen(os.dup(1), "wb") as output, open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        for line in sys.stdin.buffer:
            request = json.loads(line)
            os.chdir(request["folder"])
            _limit(request["memory"], request["seconds"])
            _answer(request, output)


def _answer(request: dict[str, Any], output: IO[bytes]) -> None:
    def send(content: dict[str, Any], values: np.ndarray) -> None:
        warned = [str(warning.message) for warning in caught if issubclass(warning.category, InputWarning)]
        caught.clear()
        text = json.dumps({**content, "shape": values.shape, "warned": warned}).encode()
        output.write(len(text).to_bytes(8, "little") + text)
        output.write(np.ascontiguousarray(values, "<f8").data)
        output.flush()

    nothing = np.zeros(0)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        module, name = request["function"]
        file, *arguments = request["arguments"]
        try:
            for item, values in getattr(importlib.import_module(module), name)(Path(file), *arguments):
                send({"item": item}, values)
            send({"last": True}, nothing)
        except InputError as error:
            send({"refused": str(error)}, nothing)
        except MemoryError:
            send({"broken": f"it needs more than {request['memory'] / 2**30:.1f} GiB of memory"}, nothing)
        except Exception as error:  # libraries raise errors of many types
            send({"broken": str(error) or type(error).__name__}, nothing)


def _limit(memory: int, seconds: int) -> None:
    """Limit this process to so many more bytes and seconds where the system can, and to no core dump."""
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
