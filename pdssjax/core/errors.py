"""Errors and warnings about the input, and the checks of it that need no arrays."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from concurrent.futures import Executor


class InputError(ValueError):
    """The user's input is at fault; the command line then exits with status 2.

    The message has one or two lines: the file, the key or the line and column, what was
    found there and what was expected.
    """


class MiscompilationError(RuntimeError):
    """The installed JAX compiles programs that compute wrongly; the command line then exits with status 2."""


class InputWarning(UserWarning):
    """The input is legal but looks like a mistake; work goes on."""


def nearest(name: str, known: Iterable[str]) -> str:
    """The end of a message about an unknown `name`: the nearest known one, or all of them."""
    import difflib  # for messages alone: the command line starts without it

    known = list(known)
    close = difflib.get_close_matches(name, known, n=1)
    if close:
        return f'did you mean "{close[0]}"?'
    if not known:
        return "expected nothing here."
    listed = ", ".join(f'"{k}"' for k in known)
    return f"expected {'one of ' if len(known) > 1 else ''}{listed}."


_SHOWN_BITS = 256
"""Bits of an integer from which a message does not quote it."""


def check_whole(name: str, number: object, least: int, most: int | None = None) -> None:
    """**Raises** `InputError` where a `number` is no integer from `least` to `most`."""
    if isinstance(number, bool) or not isinstance(number, int):
        raise InputError(f"{name}: found {number!r:.80}, expected an integer.")
    # Python refuses to write an integer of thousands of digits.
    shown = str(number) if number.bit_length() < _SHOWN_BITS else f"an integer of {number.bit_length()} bits"
    if number < least:
        raise InputError(f"{name}: found {shown}, expected {f'at least {least}' if least else '0 or more'}.")
    if most is not None and number > most:
        raise InputError(f"{name}: found {shown}, expected at most {most}.")


def check_kind(name: str, given: object, kind: type, remedy: str = "") -> None:
    """**Raises** `InputError` where an argument `given` is not of its `kind`; `remedy` says how to make one."""
    if not isinstance(given, kind):
        article = "an" if kind.__name__[0] in "AEIO" else "a"
        expected = f"{article} {kind.__name__}" + (f", as {remedy} gives it" if remedy else "")
        raise InputError(f"{name}: found {given!r:.80}, expected {expected}.")


MOST_DRAWN = 1_000_000
"""Replicates, draws of a chain or a point, cycles of a sweep; more are a slip of the keyboard."""

MOST_STARTS = 100_000
"""Other starts that a fit is compared with."""

MOST_POINTS = 10_000_000
"""Values on an axis of a sweep, or points of a sample."""

MOST_WORKERS = 1024
"""Threads of a sweep."""

MOST_SEED = 2**63 - 1
"""The greatest seed that every format of results can keep."""


def check_executor(executor: "Executor | None") -> None:
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
