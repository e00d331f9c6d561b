"""How intervals by drawing are asked for, and where the draws are kept."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, as_completed
from dataclasses import dataclass, field
from typing import Literal, Protocol, TypeAlias, TypeVar

from ..core import Document, InputError

Resampled: TypeAlias = Literal["noise", "cycles"]
"""What a bootstrap draws: white noise of the size found, or whole cycles of the residuals."""

Task = TypeVar("Task")
Result = TypeVar("Result")

REPLICATES, DRAWS, CHAINS = 1000, 1000, 4


class Store(Protocol):
    """Where draws are kept, so that a run that is broken off can go on."""

    def begun(self) -> Document | None:
        """What `begin` was told by the run that goes on; None where this is a new one."""
        ...

    def begin(self, what: Document) -> None:
        """Of what the draws are; not called where a run goes on."""
        ...

    def kept(self) -> Sequence[Document]:
        """All that was kept, by runs before, too."""
        ...

    def keep(self, entry: Document) -> None:
        """Keep one more."""
        ...


class InMemory:
    """Keeps draws as long as the program runs."""

    def __init__(self):
        self._begun: Document | None = None
        self._entries: list[Document] = []

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
    """How a bootstrap or a posterior is drawn."""

    count: int | None = None
    """Replicates of a bootstrap, draws of each chain of a posterior; 1000 unless given."""
    seed: int = 0
    """Replicate k depends on it and on k alone, whatever is drawn before it."""
    resampled: Resampled = "noise"
    """What a bootstrap draws."""
    store: Store = field(default_factory=InMemory)

    def __post_init__(self):
        if self.count is not None and self.count < 2:
            raise InputError(f"count: found {self.count}, expected at least 2 draws.")
        if self.seed < 0:
            raise InputError(f"seed: found {self.seed}, expected 0 or more.")
        if self.resampled not in ("noise", "cycles"):
            raise InputError(f'resampled: found "{self.resampled}", expected "noise" or "cycles".')


def each_done(
    work: Callable[[Task], Result], tasks: Sequence[Task], executor: Executor | None
) -> Iterator[tuple[Task, Result]]:
    """Tasks and what `work` makes of them, as they are done; what has not begun is dropped when the caller leaves."""
    if executor is None:
        for task in tasks:
            yield task, work(task)
        return
    futures: dict[Future[Result], Task] = {executor.submit(work, task): task for task in tasks}
    try:
        for future in as_completed(futures):
            yield futures[future], future.result()
    finally:
        for future in futures:
            future.cancel()


def same_run(begun: Mapping[str, object], asked: Mapping[str, object]) -> None:
    """**Raises** `InputError` where a run cannot go on, since what is asked differs from what was begun."""
    for name, value in asked.items():
        if begun.get(name) != value:
            raise InputError(
                f"{name}: found {value!r} where the run that should go on has {begun.get(name)!r}; "
                "expected the same, or a new run."
            )
