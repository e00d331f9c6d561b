"""Runs the blocks of a sweep: on threads, on any executor of `concurrent.futures`, or on a Dask cluster.

An executor gets plain data: the job as text, and the points of a block.  A process builds the job from the text once
and keeps the compiled function.  The text also identifies a sweep: the same text and points give the same numbers.

The settings of a cluster, TLS among them, are those of Dask (`DASK_DISTRIBUTED__COMM__TLS__...`, or its configuration
files).
"""

import contextlib
import dataclasses
import functools
import importlib.metadata
import itertools
import json
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)
from typing import Any, TypeAlias, cast

import numpy as np
from jaxtyping import Float

from ..core import Document, InputError, choices, member, member_name, members, quantities, use_float64
from ..integration import Accuracy, Taylor
from ..study import Models
from .blocks import BlockPlan, default_workers
from .cycles import measured_cycle
from .point import PointFunction, compute_block

FORMAT = "pdssjax-sweep/1"


def package_version() -> str:
    """The installed version of pdssjax; "" where pdssjax is only on the path."""
    try:
        return importlib.metadata.version("pdssjax")
    except importlib.metadata.PackageNotFoundError:
        return ""


def job_document(function: PointFunction) -> Document:
    """`function` as plain data: members by name, numbers by path or field, in SI."""
    models, drive, accuracy = function.models, function.drive, function.accuracy
    method = accuracy.method
    described = {"name": "taylor", "order": method.order} if isinstance(method, Taylor) else {"name": repr(method)}
    steps = {f.name: getattr(accuracy, f.name) for f in dataclasses.fields(accuracy) if f.name != "method"}
    steps = {name: float(n) if isinstance(n, float) else int(n) for name, n in steps.items()}
    numbers = {field: float(getattr(drive, field)) for field in [*quantities(type(drive)), *choices(type(drive))]}
    # Left out where empty, so that the stores of versions without them can be resumed.
    optional = {"further": list(function.further), "derivatives": list(function.by)}
    return {key: names for key, names in optional.items() if names} | {
        "format": FORMAT,
        "pdssjax": package_version(),
        "actuator": models.chosen | {"parts": sorted(models.parts)},
        "drive": {"waveform": member_name(type(drive)), **numbers},
        "parameters": {path: float(number) for path, number in function.numbers.items()},
        "paths": list(function.paths),
        "cycles": function.cycle.label,
        "accuracy": steps | {"method": described},
        "metrics": list(function.columns),
    }


def point_function(document: Document) -> PointFunction:
    """The inverse of `job_document`."""
    actuator, drive, accuracy = document["actuator"], dict(document["drive"]), dict(document["accuracy"])
    models = Models(
        member("piezo", actuator["piezo"]),
        member("friction", actuator["friction"]),
        actuator["friction_state"],
        actuator["feedback"],
        frozenset(actuator["parts"]),
        actuator.get("rests_under_load", False),
    )
    waveform = member("drive", drive.pop("waveform"))
    order = accuracy.pop("method")["order"]
    return PointFunction(
        models,
        waveform(**drive),
        tuple(document["paths"]),
        document["parameters"],
        measured_cycle(document["cycles"]),
        Accuracy(method=Taylor(order), **accuracy),
        tuple(document.get("further", ())),
        tuple(document.get("derivatives", ())),
    )


def first_line(error: BaseException) -> str:
    """The first line of an error's message, or its type where it has none."""
    return next(iter(str(error).strip().splitlines()), type(error).__name__)


def job_text(document: Document) -> str:
    """A `document` as text, the same for the same content."""
    return json.dumps(document, sort_keys=True)


def check_portable(document: Document) -> None:
    """**Raises** `InputError` where another process could not build the job again from `document`."""
    method = document["accuracy"]["method"]["name"]
    if method != "taylor":
        raise InputError(f'sweep: found the step method "{method}" with an executor, expected a Taylor series.')
    actuator = document["actuator"]
    named = {"piezo": actuator["piezo"], "friction": actuator["friction"], "drive": document["drive"]["waveform"]}
    for family, name in named.items():
        if name.partition(":")[0] not in members(family):
            raise InputError(
                f'sweep: found the {family} "{name}" with an executor, which pdssjax does not have; expected one of '
                f"{', '.join(members(family))}, which other processes can import."
            )


def differences(document: Document, other: Document, at: str = "") -> list[str]:
    """Lines such as "parameters.friction.f_ss_a: 0.8, not 0.7", with the number of the other document first."""
    lines: list[str] = []
    for key in sorted({*document, *other}):
        value, other_value = document.get(key), other.get(key)
        name = f"{at}.{key}".lstrip(".")
        if isinstance(value, dict) and isinstance(other_value, dict):
            lines += differences(value, other_value, name)
        elif value != other_value:
            lines.append(f"{name}: {_value_text(other_value)}, not {_value_text(value)}")
    return lines


def _value_text(value: object) -> str:
    return "none" if value is None else str(value)


Block: TypeAlias = Float[np.ndarray, "lanes columns"]
"""Results at the points of a block: the metrics, then the failure, one row a point."""


def run_blocks(
    function: PointFunction,
    document: Document,
    plan: BlockPlan,
    numbers: Iterable[int],
    executor: Executor | None,
    workers: int | None,
    in_flight: int | None,
) -> Generator[tuple[int, Callable[[], Block]], None, None]:
    """Compute the blocks `numbers` of the `plan`; yield each number as its block is done, with a function.

    The function returns the results of the block or raises its error.  At most `in_flight` blocks are with the executor
    at a time, by default twice as many as it has workers.
    """
    if executor is None:
        yield from _on_threads(function, plan, iter(numbers), workers or default_workers(), in_flight)
        return
    check_portable(document)
    text = job_text(document)

    def submit(number: int) -> Future[Block]:
        try:
            return executor.submit(run_block, text, plan.block(number))
        except Exception as error:
            # Executors raise errors of many types when they take no more, such as that of a scheduler that went away.
            raise BrokenExecutor(str(error)) from error

    def result(number: int, future: Future[Block]) -> Block:
        try:
            return future.result()
        except CancelledError as error:
            raise BrokenExecutor(f"block {number} was cancelled") from error

    known_workers = getattr(executor, "_max_workers", None)
    in_flight = in_flight or (2 * known_workers if isinstance(known_workers, int) else 64)
    with contextlib.closing(_completed(submit, iter(numbers), in_flight)) as done:
        for number, future in done:
            yield number, functools.partial(result, number, future)


def run_block(text: str, points: Float[np.ndarray, "lanes paths"]) -> Block:
    """Compute a block of the job `text` at its `points`: the task of a worker."""
    use_float64()
    return compute_block(_cached_function(text), points)


@functools.lru_cache(maxsize=4)
def _cached_function(text: str) -> PointFunction:
    """The function of a job, built once in a process; JAX keeps what it compiled of it."""
    document = json.loads(text)
    if document["pdssjax"] != package_version():
        raise InputError(
            f"sweep: found pdssjax {package_version() or 'without a version'} on a worker, expected "
            f"{document['pdssjax'] or 'one without a version'} as here."
        )
    return point_function(document)


def _on_threads(
    function: PointFunction, plan: BlockPlan, numbers: Iterator[int], workers: int, in_flight: int | None
) -> Generator[tuple[int, Callable[[], Block]], None, None]:
    pool = ThreadPoolExecutor(workers)
    submit = lambda number: pool.submit(compute_block, function, plan.block(number))
    try:
        # The first block alone, since it compiles the function for all.  In a thread as well: compiling may take
        # minutes, in which its thread handles no signal.
        for first in itertools.islice(numbers, 1):
            yield first, submit(first).result
        with contextlib.closing(_completed(submit, numbers, in_flight or 2 * workers)) as done:
            for number, future in done:
                yield number, future.result
    finally:
        # An interrupted sweep does not wait for its blocks.
        pool.shutdown(wait=False, cancel_futures=True)


def _completed(
    submit: Callable[[int], Future[Block]], numbers: Iterator[int], in_flight: int
) -> Generator[tuple[int, Future[Block]], None, None]:
    """The futures of `numbers` as they are done, never more than `in_flight` at a time."""
    waiting: dict[Future[Block], int] = {}
    try:
        while True:
            for number in itertools.islice(numbers, in_flight - len(waiting)):
                waiting[submit(number)] = number
            if not waiting:
                return
            # In order: a block that fails must not come before one that was computed earlier.
            for future in sorted(wait(waiting, return_when=FIRST_COMPLETED).done, key=waiting.__getitem__):
                yield waiting.pop(future), future
    finally:
        for future in waiting:
            future.cancel()


_SCHEDULER_TIMEOUT = 10.0
"""Longest wait for the answer of a scheduler [s]."""


@contextlib.contextmanager
def cluster_executor(address: str) -> Iterator[tuple[Executor, int]]:
    """An executor on the workers of the Dask scheduler at `address`, such as "tcp://10.0.0.1:8786", and their threads.

    **Raises:** `InputError` where `distributed` is not installed, no scheduler answers, it has no workers, or one of
    them has another pdssjax or none.
    """
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            "option --scheduler: found no distributed, expected it installed: \"pip install 'pdssjax[cluster]'\"."
        ) from None
    try:
        client = Client(address, timeout=_SCHEDULER_TIMEOUT, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        reason = first_line(error)
        raise InputError(
            f"scheduler {address}: found none that answers ({reason}), expected a Dask scheduler."
        ) from None
    with contextlib.closing(client):
        # `distributed` types these answers of each worker as if they were awaited.
        threads = sum(cast(dict[str, int], client.nthreads()).values())
        if not threads:
            raise InputError(f"scheduler {address}: found no workers, expected at least one.")
        own_version = package_version()
        versions = cast(Any, client.run(importlib.metadata.version, "pdssjax", on_error="return"))
        for worker, version in versions.items():
            if version != own_version:
                found = f"pdssjax {version}" if isinstance(version, str) else "no pdssjax"
                raise InputError(
                    f"scheduler {address}: worker {worker}: found {found}, expected pdssjax {own_version} as here."
                )
        # A block is the same wherever and however often it is computed: a worker that dies is replaced.
        yield client.get_executor(pure=False, retries=2), threads
