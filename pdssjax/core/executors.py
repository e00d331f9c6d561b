"""Which executors of `concurrent.futures` can compute with JAX."""

from concurrent.futures import Executor

from .errors import InputError


def check_executor(executor: Executor | None) -> None:
    """**Raises** `InputError` for a pool whose processes are forked.

    JAX has threads, whose locks a forked process inherits as they are: it would wait for them without end.  What starts
    anew (spawn, forkserver), threads and clusters are welcome.
    """
    context = getattr(executor, "_mp_context", None)
    if context is not None and context.get_start_method() == "fork":
        raise InputError(
            f"executor: found a {type(executor).__name__} whose processes are forked, which JAX does not outlive; "
            'expected one that spawns them: ProcessPoolExecutor(mp_context=multiprocessing.get_context("spawn")).'
        )
