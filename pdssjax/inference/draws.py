"""Settings of intervals by drawing, and where the draws are kept."""

import contextlib
import importlib.util
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, as_completed
from dataclasses import dataclass, field
from typing import Literal, Protocol, TypeAlias, TypeVar

import numpy as np

from ..core import MOST_DRAWN, MOST_SEED, Document, Float64Call, InputError, check_whole

Resampled: TypeAlias = Literal["noise", "cycles"]
"""Resampling of a bootstrap: white noise of the size found, or whole cycles of the residuals."""

Sampler: TypeAlias = Literal["rto", "nuts"]
"""Sampler of a posterior: randomize-then-optimize, or the No-U-Turn sampler."""

Task = TypeVar("Task")
Result = TypeVar("Result")

REPLICATES, DRAWS, CHAINS = 1000, 1000, 4
"""Usual number of replicates of a bootstrap, of draws of each chain, and of chains of a posterior."""


class Store(Protocol):
    """Keeps draws, so that an interrupted run can be resumed; `str` gives the name of the place."""

    def begun(self) -> Document | None:
        """The settings that `begin` got from the run that is resumed; None for a new run."""

    def begin(self, what: Document) -> None:
        """Describe the draws that will be kept; not called for a resumed run."""

    def kept(self) -> Sequence[Document]:
        """All entries kept, those of earlier runs included."""
        ...

    def keep(self, entry: Document) -> None:
        """Keep one more entry."""


class InMemory:
    """Keeps draws as long as the program runs."""

    def __init__(self):
        self._begun: Document | None = None
        self._entries: list[Document] = []

    def __str__(self) -> str:
        return "draws in memory"

    def begun(self) -> Document | None:
        return self._begun

    def begin(self, what: Document) -> None:
        self._begun = what

    def kept(self) -> Sequence[Document]:
        return tuple(self._entries)

    def keep(self, entry: Document) -> None:
        self._entries.append(entry)


@dataclass(frozen=True)
class Drawing:
    """Settings of a bootstrap or a posterior."""

    count: int | None = None
    """Replicates of a bootstrap, draws of each chain of a posterior; 1000 unless given."""
    seed: int = 0
    """Seed of the random numbers: replicate k depends on the seed and k alone."""
    resampled: Resampled = "noise"
    """Resampling of a bootstrap."""
    store: Store = field(default_factory=InMemory)
    sampler: Sampler = "rto"
    """Posterior sampler: "rto", independent draws by randomize-then-optimize, corrected by the model, or "nuts", the
    No-U-Turn sampler of NumPyro, which takes several times as long."""

    def __post_init__(self):
        if self.count is not None:
            check_whole("count", self.count, 2, MOST_DRAWN)
        check_whole("seed", self.seed, 0, MOST_SEED)
        if self.resampled not in ("noise", "cycles"):
            raise InputError(f'resampled: found "{self.resampled}", expected "noise" or "cycles".')
        if self.sampler not in ("rto", "nuts"):
            raise InputError(f'sampler: found "{self.sampler}", expected "rto" or "nuts".')
        if self.sampler == "nuts" and importlib.util.find_spec("numpyro") is None:
            needed = 'expected it installed: pip install "pdssjax[posterior]"'
            raise InputError(f'sampler: found "nuts" without NumPyro, {needed}.')


_PURPOSES = ("learn", "propose", "correct", "warm up", "move")


def stream(
    seed: int, purpose: Literal["learn", "propose", "correct", "warm up", "move"], *numbers: int
) -> np.random.Generator:
    """Random numbers of their own for a `purpose`, of a chain or block of these `numbers`; the same each time."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_PURPOSES.index(purpose), *numbers)))


def each_done(
    work: Callable[[Task], Result], tasks: Sequence[Task], executor: Executor | None
) -> Iterator[tuple[Task, Result]]:
    """Yield each task with its result once it is done; tasks not begun are dropped when the caller leaves."""
    if executor is None:
        for task in tasks:
            yield task, work(task)
        return
    futures: dict[Future[Result], Task] = {executor.submit(Float64Call(work, task)): task for task in tasks}
    try:
        for future in as_completed(futures):
            yield futures[future], future.result()
    finally:
        for future in futures:
            future.cancel()


def check_same_run(begun: Mapping[str, object], settings: Mapping[str, object], where: str = "") -> None:
    """**Raises** `InputError` where the `settings` of a resumed run differ from those it had `begun` with.

    **Arguments:** `where` is the prefix of messages on parts of the settings.
    """
    for name in dict.fromkeys([*settings, *(begun if where else ())]):
        value, before, place = settings.get(name), begun.get(name), f"{where}{name}: "
        if isinstance(value, dict) and isinstance(before, dict):
            check_same_run(before, value, place)
        elif before != value:
            raise InputError(
                f"{place}found {_in_short(value)} where the run that should go on has {_in_short(before)}; "
                "expected the same, or a new run."
            )


def _in_short(value: object) -> str:
    return "nothing" if value is None else f"a table of {len(value)}" if isinstance(value, dict) else repr(value)


@contextlib.contextmanager
def refuse_wrong_entries(store: Store, what: str) -> Iterator[None]:
    """Refuse entries of a `store`, named `what`, that are not what a run wrote, in one line.

    **Raises:** `InputError` in place of whatever wrong types, keys and shapes raise within it.
    """
    try:
        yield
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        found = f"no {error}" if isinstance(error, KeyError) else str(error)
        expected = "expected what a run of this version of pdssjax wrote; begin anew without --resume"
        raise InputError(f"{store}: {what}: found {found}, {expected}.") from None
