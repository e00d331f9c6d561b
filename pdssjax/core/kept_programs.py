"""Functions whose executables are kept on disk: a later process neither traces nor lowers them again.

JAX keeps what XLA made of a function, under a key that is known only when the function has been traced and lowered: two
thirds of what a fit that compiles nothing waits for.  Here the key is what the function is called with: the models by
the names of their classes and their choices, shapes and kinds of numbers, the sources of this package, the versions of
the libraries, processor and flags.  What is given from outside the package, a friction law of the user's, has no such
name for what it does, and is compiled by JAX as ever.
"""

import contextlib
import functools
import hashlib
import importlib.metadata
import io
import os
import pickle
import tempfile
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Generic, NamedTuple, ParamSpec, TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.monitoring
import numpy as np
from jax.core import Tracer
from jax.experimental import serialize_executable

from .arrays import Tree

P = ParamSpec("P")
R = TypeVar("R")

Arrays: TypeAlias = Sequence[Any]
"""NumPy's or JAX's, of any shapes."""

_ARRAYS = jax.Array, np.ndarray, np.generic
"""What programs are called with."""

_CONCRETE: set[type] = set()
"""Their classes, as far as they were met; never of what is being traced."""

_MOST = 8
"""Executables of a function that a process holds: one of a fit takes 5 MB, and records of a batch differ in length."""

_LIBRARIES = ("jax", "jaxlib", "numpy", "equinox", "diffrax", "optimistix", "lineax")
"""What executables are made of, beside this package; also whose classes the arguments may hold."""


_WITHOUT_PROGRAMS = "cli", "explore", "files", "report"
"""Rooms whose sources are in no executable."""


class _Home(NamedTuple):
    """Where executables are kept, and what they depend on beside what they are called with."""

    folder: Path
    circumstances: str


_homes: list[_Home] = []
"""The one, if any."""


def keep_programs_in(folder: Path | None, circumstances: str) -> None:
    """Keep executables in a `folder` that nobody else may write to, since they are run; None to keep none.

    **Arguments:** `circumstances` name processor, flags and compiler.
    """
    _homes[:] = [] if folder is None else [_Home(folder, f"{_sources()}\n{circumstances}")]
    _listen()


_in_thread = threading.local()


def _cache_hits() -> int:
    """How many functions JAX has read from its own cache, in this thread."""
    return getattr(_in_thread, "hits", 0)


@functools.cache
def _listen() -> None:
    def told(event: str, **_: object) -> None:
        if event == "/jax/compilation_cache/cache_hits":
            _in_thread.hits = _cache_hits() + 1

    jax.monitoring.register_event_listener(told)


def forget_programs() -> None:
    """Drop the executables that this process holds, as `jax.clear_caches` does with JAX's own."""
    for function in _functions:
        function.forget()


class Program(NamedTuple):
    """An executable, and what its outputs are leaves of."""

    executable: Callable[..., Arrays]
    outputs: Tree
    """The structure of the outputs."""

    def __call__(self, arrays: Arrays) -> Tree:
        """The outputs for the arrays among the arguments."""
        return jax.tree.unflatten(self.outputs, self.executable(*arrays))


class KeptFunction(Generic[P, R]):
    """`equinox.filter_jit` of a function that returns arrays, with executables that are kept on disk."""

    def __init__(self, function: Callable[P, R]):
        functools.update_wrapper(self, function)
        self._function = function
        self._jitted = eqx.filter_jit(function)
        self._programs: OrderedDict[Any, _Slot] = OrderedDict()
        self._lock = threading.Lock()
        _functions.append(self)

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        """What the function gives; compiled with what calls it where that is being traced."""
        call = None if kwargs or not _can_be_kept() else self._call_of(args)
        if call is None:
            return self._jitted(*args, **kwargs)
        return self._slot(call).program(call)(call.arrays)

    def forget(self) -> None:
        """Drop its executables."""
        with self._lock:
            self._programs.clear()

    def _call_of(self, args: tuple[Any, ...]) -> "_Call | None":
        """The call with these arguments; None where they are being traced."""
        leaves, tree = jax.tree.flatten(args)
        arrays: list[Any] = []
        kinds: list[Any] = []
        for leaf in leaves:
            known = type(leaf) in _CONCRETE  # to ask for an instance takes longer than all else here
            if not known and isinstance(leaf, Tracer):
                return None
            if known or isinstance(leaf, _ARRAYS):
                if not known:
                    _CONCRETE.add(type(leaf))
                arrays.append(leaf)
                kinds.append(_Shape(leaf.shape, leaf.dtype, getattr(leaf, "weak_type", False)))
            else:
                kinds.append((type(leaf), leaf))  # 1, 1.0 and True are equal, and make other programs
        return _Call(self._function, arrays, tree, tuple(kinds))

    def _slot(self, call: "_Call") -> "_Slot":
        key = call.tree, call.kinds, _settings()
        with self._lock:
            slot = self._programs.setdefault(key, _Slot())
            self._programs.move_to_end(key)
            while len(self._programs) > _MOST:
                self._programs.popitem(last=False)
            return slot


_functions: list[KeptFunction[Any, Any]] = []


def kept_jit(function: Callable[P, R]) -> KeptFunction[P, R]:
    """`function` compiled, of any arguments, and its executables kept: for functions that return arrays."""
    return KeptFunction(function)


class _Shape(NamedTuple):
    """What a program depends on of an array."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    weak_type: bool


class _Call(NamedTuple):
    """A function with its arguments."""

    function: Callable[..., Any]
    arrays: list[Any]
    """Those among the leaves of the arguments."""
    tree: Any
    """The structure of the arguments."""
    kinds: tuple[Any, ...]
    """Of each leaf: the shape of an array, or what else it is."""

    def args(self, arrays: Arrays) -> Tree:
        """The arguments with other `arrays`."""
        given = iter(arrays)
        leaves = [next(given) if isinstance(kind, _Shape) else kind[1] for kind in self.kinds]
        return jax.tree.unflatten(self.tree, leaves)

    def file(self) -> Path | None:
        """Where the executable is kept; None where it has no name."""
        if not _homes:
            return None
        name = io.BytesIO()
        shapes = repr([tuple(kind) if isinstance(kind, _Shape) else None for kind in self.kinds])
        try:
            skeleton = self.args([0] * len(self.arrays))
            _Names(name).dump((self.function.__module__, self.function.__qualname__, skeleton, shapes))
        except (pickle.PicklingError, AttributeError, TypeError):
            return None
        name.write(f"{_homes[0].circumstances}{_settings()}".encode())
        return _homes[0].folder / f"program-{hashlib.sha256(name.getvalue()).hexdigest()[:40]}"


class _Slot:
    """Room for one executable, which one thread makes."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._program: Program | None = None

    def program(self, call: _Call) -> Program:
        """The executable, from disk, or compiled and kept there."""
        with self._lock:
            if self._program is None:
                file = call.file()
                kept = None if file is None else _loaded(file)
                self._program = _compiled(call, file) if kept is None else kept
            return self._program


def _compiled(call: _Call, file: Path | None) -> Program:
    """The executable, compiled, and kept in a `file` where it has one and took long enough."""
    outputs: list[Any] = []

    def flat(*arrays: Any) -> list[Any]:
        found, tree = jax.tree.flatten(call.function(*call.args(arrays)))
        outputs[:] = [tree]
        return found

    # Under the same key in JAX's own cache: what is read from there cannot be kept, since kernels would be missing,
    # and after a change of our sources, or for a study of another title, the same code would be traced for ever.
    flat.__name__ = call.function.__name__ + ("" if file is None else f"_{file.name[-12:]}")
    began = time.perf_counter()
    lowered = jax.jit(flat, keep_unused=True).lower(*call.arrays)
    hits = _cache_hits()  # not of what was compiled for the tracing
    program = Program(lowered.compile(), outputs[0])
    took, fresh = time.perf_counter() - began, _cache_hits() == hits
    if file is not None and fresh and took >= jax.config.jax_persistent_cache_min_compile_time_secs:  # pyright: ignore[reportAttributeAccessIssue]
        _keep(program, file)
    return program


class _Names(pickle.Pickler):
    """Writes arguments by the names of their classes, equal ones equally, and refuses those of other packages."""

    def __init__(self, file: io.BytesIO):
        super().__init__(file)
        self.fast = True  # without references to what was written before, which depend on identity

    def reducer_override(self, obj: Any) -> Any:
        if isinstance(obj, type) or hasattr(obj, "__qualname__"):
            home = str(getattr(obj, "__module__", "")).partition(".")[0]
            if home not in ("pdssjax", "builtins", "types", "functools", "enum", *_LIBRARIES):
                raise pickle.PicklingError(f"{obj!r} is of another package")
        return NotImplemented


def _can_be_kept() -> bool:
    """Executables are called with arrays of the one device there is, and are not run for each number."""
    run_by_parts = jax.config.jax_disable_jit  # pyright: ignore[reportAttributeAccessIssue]
    return jax.default_backend() == "cpu" and jax.device_count() == 1 and not run_by_parts


def _settings() -> tuple[object, ...]:
    """Of JAX, those that change what a function becomes."""
    names = (
        "enable_x64",
        "debug_nans",
        "debug_infs",
        "enable_checks",
        "default_matmul_precision",
        "numpy_dtype_promotion",
    )
    return tuple(getattr(jax.config, f"jax_{name}", None) for name in names)


@functools.cache
def _sources() -> str:
    """Those of this package, and the versions of the libraries."""
    sources = hashlib.sha256()
    root = Path(__file__).parent.parent
    for file in sorted(root.rglob("*.py")):
        if file.relative_to(root).parts[0] in _WITHOUT_PROGRAMS:
            continue
        sources.update(str(file.relative_to(root)).encode() + b"\0" + file.read_bytes())
    versions = [f"{name} {importlib.metadata.version(name)}" for name in _LIBRARIES]
    return "\n".join([sources.hexdigest(), *versions])


@functools.cache
def _register_lapack() -> None:
    """Linear algebra of the CPU is known to XLA once something that needs it was lowered; an executable would crash."""
    jax.jit(jax.lax.linalg.cholesky).lower(np.eye(2))


def _loaded(file: Path) -> Program | None:
    """The executable in `file`; None where there is none, or not as it was written."""
    try:
        content = file.read_bytes()
    except OSError:
        return None
    digest, content = content[:32], content[32:]
    if hashlib.sha256(content).digest() != digest:
        return None
    with contextlib.suppress(OSError):
        os.utime(file)  # the last to be removed
    _register_lapack()
    try:
        *executable, outputs = pickle.loads(content)
        return Program(serialize_executable.deserialize_and_load(*executable), jax.tree.structure(outputs))
    except (jax.errors.JaxRuntimeError, pickle.UnpicklingError):  # of another compiler, whatever its version says
        return None


def _keep(program: Program, file: Path) -> None:
    """Write the executable to `file`, whole or not at all; nothing where it cannot be written."""
    try:
        executable = serialize_executable.serialize(program.executable)  # pyright: ignore[reportArgumentType]
        numbered = jax.tree.unflatten(program.outputs, range(program.outputs.num_leaves))
        content = pickle.dumps((*executable, numbered))
    except (AttributeError, ValueError, TypeError, pickle.PicklingError):  # what calls back into Python
        return
    with contextlib.suppress(OSError):
        descriptor, name = tempfile.mkstemp(dir=file.parent)
        with os.fdopen(descriptor, "wb") as unfinished:
            unfinished.write(hashlib.sha256(content).digest() + content)
        Path(name).replace(file)
        _forget_oldest(file.parent)


_MOST_BYTES = 500_000_000
"""Executables kept on disk: one study's take 20 MB, and those of earlier versions are never read again."""


def _forget_oldest(folder: Path) -> None:
    """Remove what was used the longest ago, down to `_MOST_BYTES`: executables, and what JAX keeps of its own."""
    files = [*folder.glob("program-*"), *folder.glob("*-cache")]
    found = [(kept.st_mtime, kept.st_size, file) for file in files if (kept := file.stat())]
    total = sum(size for _, size, _ in found)
    for _, size, file in sorted(found):
        if total <= _MOST_BYTES:
            return
        file.unlink(missing_ok=True)
        total -= size
