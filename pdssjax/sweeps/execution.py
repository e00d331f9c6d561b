"""Runs the blocks of a sweep: on threads of this machine, or on any executor of `concurrent.futures`.

What is sent to an executor is plain data: the job as text, a block's number and its points.  A process that has not
seen the job builds it from the text and keeps it, compiled.
"""

import contextlib
import functools
import itertools
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
from typing import TypeAlias, TypeVar

import jax
import numpy as np
from jaxtyping import Float

from ..core import Document, InputError, prepare_jax
from .block_plan import BlockPlan
from .device_mesh import default_workers
from .job import check_travels, job_text, package_version, point_function
from .point import PointFunction, compute_block

Block: TypeAlias = Float[np.ndarray, "lanes columns"]
"""What was found at the points of a block: the metrics, then the failure, one row a point."""

Answer = TypeVar("Answer")
"""Of a task."""

_IN_FLIGHT = 64
"""Blocks that an executor holds at most whose number of workers is not known."""


def run_blocks(
    function: PointFunction,
    document: Document,
    plan: BlockPlan,
    numbers: Iterable[int],
    executor: Executor | None = None,
    workers: int | None = None,
    in_flight: int | None = None,
) -> Generator[tuple[int, Callable[[], Block]], None, None]:
    """Computes the blocks `numbers` of the `plan`; gives each as it is done, with a call for what was found.

    The call raises what its block raised.  At most `in_flight` blocks are with the executor at a time, by default
    twice as many as it has workers.
    """
    if executor is None:
        yield from _on_threads(function, plan, iter(numbers), workers or default_workers(), in_flight)
        return
    check_travels(document)
    text = job_text(document)
    submit = lambda number: _submitted(executor, text, number, plan.block(number))
    with contextlib.closing(_completed(submit, iter(numbers), in_flight or _room(executor))) as done:
        for number, future in done:
            yield number, functools.partial(_result, future, number)


def run_block(text: str, number: int, points: Float[np.ndarray, "lanes paths"]) -> tuple[int, Block]:
    """What a worker does: the block `number` of the job `text`, found at its `points`."""
    if not jax.config.jax_enable_x64:  # pyright: ignore[reportAttributeAccessIssue]
        prepare_jax()
    return number, computed_block(_rebuilt(text), points)


@functools.lru_cache(maxsize=4)
def _rebuilt(text: str) -> PointFunction:
    """The function of a job, built once in a process; JAX keeps what it compiled of it."""
    import json

    document = json.loads(text)
    if document["pdssjax"] != package_version():
        raise InputError(
            f"sweep: found pdssjax {package_version() or 'without a version'} on a worker, expected "
            f"{document['pdssjax'] or 'one without a version'} as here."
        )
    return point_function(document)


def computed_block(function: PointFunction, points: Float[np.ndarray, "lanes paths"]) -> Block:
    """What is found at the `points` of a block, here."""
    return compute_block(function, points)


def _on_threads(
    function: PointFunction, plan: BlockPlan, numbers: Iterator[int], workers: int, in_flight: int | None
) -> Generator[tuple[int, Callable[[], Block]], None, None]:
    pool = ThreadPoolExecutor(workers)
    submit = lambda number: pool.submit(computed_block, function, plan.block(number))
    try:
        # The first block alone: it compiles what the others share.  In a thread, too, since no signal is heard in one
        # that compiles, which may take minutes.
        for first in itertools.islice(numbers, 1):
            yield first, submit(first).result
        with contextlib.closing(_completed(submit, numbers, in_flight or 2 * workers)) as done:
            for number, future in done:
                yield number, future.result
    finally:
        # Whoever breaks off does not wait for it.
        pool.shutdown(wait=False, cancel_futures=True)


def _completed(
    submit: Callable[[int], Future[Answer]], numbers: Iterator[int], in_flight: int
) -> Generator[tuple[int, Future[Answer]], None, None]:
    """The futures of `numbers` as they are done, never more than `in_flight` at a time."""
    waiting: dict[Future[Answer], int] = {}
    try:
        while True:
            for number in itertools.islice(numbers, in_flight - len(waiting)):
                waiting[submit(number)] = number
            if not waiting:
                return
            # In order: one that breaks the sweep off must not come before one that was computed earlier.
            for future in sorted(wait(waiting, return_when=FIRST_COMPLETED).done, key=waiting.__getitem__):
                yield waiting.pop(future), future
    finally:
        for future in waiting:
            future.cancel()


def _submitted(
    executor: Executor, text: str, number: int, points: Float[np.ndarray, "lanes paths"]
) -> Future[tuple[int, Block]]:
    try:
        return executor.submit(run_block, text, number, points)
    except Exception as error:
        # Each executor has its way to say that it takes no more: a scheduler that went away, a pool that broke.
        raise BrokenExecutor(str(error)) from error


def _result(future: Future[tuple[int, Block]], number: int) -> Block:
    try:
        told, found = future.result()
    except CancelledError as error:
        raise BrokenExecutor(f"block {number} was cancelled") from error
    if told != number:
        raise RuntimeError(f"Expected block {number}, but the executor gave block {told}.")
    return found


def _room(executor: Executor) -> int:
    workers = getattr(executor, "_max_workers", None)
    return 2 * workers if isinstance(workers, int) else _IN_FLIGHT
