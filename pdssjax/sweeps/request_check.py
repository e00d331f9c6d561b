"""What is asked of a sweep besides the metrics that every cycle has: whether it can be found."""

from collections.abc import Sequence

from ..core import InputError, nearest
from ..study import Record, Study
from .axes import sweepable, sweepable_choices
from .cycles.base import AbstractCycle
from .cycles.further_metrics import FURTHER
from .cycles.steady import Steady
from .varied_record import drive_of


def check_asked(metrics: Sequence[str], cycle: AbstractCycle, known: Sequence[str]) -> None:
    """**Raises** `InputError` for further `metrics` that there are not, or that lack something.

    **Arguments:** `known` are the paths that have a number at every point.
    """
    for i, name in enumerate(metrics):
        if name in cycle.metrics or name in metrics[:i]:
            raise InputError(f'sweep: found the metric "{name}" twice, expected further ones: {", ".join(FURTHER)}.')
        if name not in FURTHER:
            raise InputError(f'sweep: found the unknown metric "{name}"; {nearest(name, FURTHER)}')
    if "multiplier" in metrics and not isinstance(cycle, Steady):
        raise InputError(
            f'sweep: found the metric "multiplier" of cycle {cycle.described}, expected cycles = "steady" with it.'
        )
    if "output_force" in metrics and "stop.stiffness" not in known:
        raise InputError(
            'sweep: found the metric "output_force" without "stop.stiffness", expected a number for it among the '
            "study's parameters or the axes: how stiff the force sensor is decides what it shows."
        )


def numbers_by(paths: Sequence[str], study: Study, base: Record, known: Sequence[str]) -> dict[str, float]:
    """The numbers [SI] of those `paths` of derivatives that only the record's drive has.

    **Raises:** `InputError` for a path that is unknown, named twice, has no number, or is a word such as a direction.
    """
    legal, words = sweepable(study, base), sweepable_choices(base)
    found = {}
    for i, path in enumerate(paths):
        where = f'sweep: derivative by "{path}"'
        if path in words:
            raise InputError(f"{where}: found a choice between {' and '.join(words[path])}, expected a number.")
        if path not in legal:
            raise InputError(f'sweep: found the unknown path "{path}" of a derivative; {nearest(path, legal)}')
        if path in paths[:i]:
            raise InputError(f"{where}: found it twice, expected every path once.")
        if path in known:
            continue
        number = getattr(drive_of(base), path.removeprefix("drive."), None) if path.startswith("drive.") else None
        if number is None:
            raise InputError(f"{where}: found no number for it, expected one among the study's parameters or the axes.")
        found[path] = float(number)
    return found
