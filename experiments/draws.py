"""A Monte Carlo that can be killed and run again: every task's result is a file, and ends as if it had not been.

    tasks = {"noise-0001": (scenario, 1), ...}
    run_tasks(tasks, compute, folder, executor)
    results = read_tasks(tasks, folder)

A result is plain data for JSON.  A file counts only with the arguments it was made with: change those, and its
task is done again.  At most `ahead` tasks are given to the executor at a time, any of `concurrent.futures`, and no
result is held in memory once it is written.
"""

import concurrent.futures
import json
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

Tasks = Mapping[str, tuple[Any, ...]]
"""Arguments by the task's name, which is that of its file."""


def run_tasks(
    tasks: Tasks,
    compute: Callable[..., Any],
    folder: Path,
    executor: concurrent.futures.Executor,
    ahead: int = 8,
    report: Callable[[str], None] = lambda message: None,
) -> int:
    """Do what is not done yet, `compute(*arguments)` a task; returns how many were done now.

    What is finished stays, also where a task raises, which ends the run once those begun have ended.
    """
    folder.mkdir(parents=True, exist_ok=True)
    waiting = (name for name in tasks if _read(folder, name, tasks[name]) is None)
    pending: dict[concurrent.futures.Future[Any], str] = {}
    done = 0
    for name in waiting:
        pending[executor.submit(compute, *tasks[name])] = name
        if len(pending) >= ahead:
            done += _gather(pending, tasks, folder, concurrent.futures.FIRST_COMPLETED)
            report(f"{done} done of {len(tasks)} at most")
    while pending:
        done += _gather(pending, tasks, folder, concurrent.futures.FIRST_COMPLETED)
        report(f"{done} done of {len(tasks)} at most")
    return done


def numbered_results(count: int, compute: Callable[[int], Any], folder: Path, workers: int | None = None) -> list[Any]:
    """What `compute` finds of the numbers below `count`, on so many threads, one a core by default; told as it goes."""
    tasks = {f"{number:04d}": (number,) for number in range(count)}
    report = lambda text: print(f"\r{text}", end="", flush=True)
    with concurrent.futures.ThreadPoolExecutor(workers or os.cpu_count()) as executor:
        run_tasks(tasks, compute, folder, executor, report=report)
    return [result for _, result in read_tasks(tasks, folder)]


def read_tasks(tasks: Tasks, folder: Path) -> Iterator[tuple[str, Any]]:
    """Name and result of every task, in their order.

    **Raises:** `FileNotFoundError` where one has not been done.
    """
    for name in tasks:
        found = _read(folder, name, tasks[name])
        if found is None:
            raise FileNotFoundError(f"{folder / name}.json: found no result of this task, expected run_tasks first.")
        yield name, found[0]


def _gather(pending: dict[concurrent.futures.Future[Any], str], tasks: Tasks, folder: Path, when: str) -> int:
    """Write what has been finished; what raised raises here, after the others are written."""
    finished, _ = concurrent.futures.wait(pending, return_when=when)
    failed = None
    for future in finished:
        name = pending.pop(future)
        if (error := future.exception()) is not None:
            failed = error
        else:
            _write(folder, name, tasks[name], future.result())
    if failed is not None:
        for future in pending:
            future.cancel()
        raise failed
    return len(finished)


def _write(folder: Path, name: str, arguments: tuple[Any, ...], result: Any) -> None:
    """All of the file or nothing: a run may be killed at any moment."""
    unfinished = folder / f"{name}.unfinished"
    unfinished.write_text(json.dumps({"arguments": repr(arguments), "result": result}), encoding="utf-8")
    os.replace(unfinished, folder / f"{name}.json")


def _read(folder: Path, name: str, arguments: tuple[Any, ...]) -> tuple[Any] | None:
    """The result of a task, None where it is yet to be done with these arguments."""
    try:
        found = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return (found["result"],) if found.get("arguments") == repr(arguments) else None
