"""Work on several subjects side by side, in processes of their own or wherever an executor says.

What a subject's work finds is kept as soon as it is done; a process that dies is a failure of its subject alone.
"""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from typing import TypeVar

from ..core import Float64Call, prepare_jax

Subject = TypeVar("Subject")
Task = TypeVar("Task")
Answer = TypeVar("Answer")


def gathered(
    submit: Callable[..., Future[Answer]],
    keep: Callable[[Subject, Answer], None],
    lost: Callable[[Subject, str], Answer],
    work: Callable[[Task], Answer],
    waiting: Sequence[Subject],
    ready: Callable[[Subject], Task | None],
) -> None:
    """Keep what the `work` finds for each subject that is `waiting`, begun as soon as its task is `ready`.

    **Arguments:** `lost` makes the answer for one whose work ended in nothing, and why.
    """
    waiting, running = list(waiting), dict[Future[Answer], Subject]()
    while waiting or running:
        for subject in list(waiting):
            if (task := ready(subject)) is not None:
                waiting.remove(subject)
                running[submit(work, task)] = subject
        wait(running, return_when=FIRST_COMPLETED)
        for future in [future for future in running if future.done()]:
            subject = running.pop(future)
            try:
                answer = future.result()
            except BrokenExecutor as error:
                answer = lost(subject, f"the process that fitted it ended ({error or type(error).__name__})")
            except Exception as error:  # whatever a worker could not send back stops no other subject
                answer = lost(subject, f"{type(error).__name__}: {error}")
            keep(subject, answer)


@contextlib.contextmanager
def workers(executor: Executor | None, most: int) -> Iterator[Callable[..., Future[Answer]]]:
    """A function that submits work: to the `executor` that is given, else to processes that are spawned, one a core.

    Where it is left early, processes of its own are ended; those of the caller only lose what has not begun.
    """
    if executor is not None:
        futures: list[Future[Answer]] = []

        def submit(work: Callable[..., Answer], task: object) -> Future[Answer]:
            futures.append(executor.submit(Float64Call(work, task)))
            return futures[-1]

        try:
            yield submit
        finally:
            for future in futures:
                future.cancel()
        return
    count = min(os.cpu_count() or 1, most)
    pools: list[ProcessPoolExecutor] = []

    def submit_here(work: Callable[..., Answer], task: object) -> Future[Answer]:
        try:
            return pools[-1].submit(work, task)
        except (BrokenExecutor, IndexError):  # none yet, or one whose process died: the others go on in a new one
            context = multiprocessing.get_context("spawn")
            pools.append(ProcessPoolExecutor(count, mp_context=context, initializer=_begin_process))
            return pools[-1].submit(work, task)

    try:
        yield submit_here
    except BaseException:
        for pool in pools:
            for process in list((getattr(pool, "_processes", None) or {}).values()):
                process.terminate()
        raise
    finally:
        for pool in pools:
            pool.shutdown(wait=False, cancel_futures=True)


def _begin_process() -> None:
    """A process of its own is the parent's to end, ends with one that was killed, and computes in 64 bits."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if (parent := multiprocessing.parent_process()) is not None:
        threading.Thread(target=lambda: (parent.join(), os._exit(1)), daemon=True).start()
    prepare_jax(dedicated=True)
