"""A fit as plain data, so that draws around it can go on without fitting again."""

import dataclasses
import hashlib
from collections.abc import Iterator
from typing import NamedTuple

import jax
import numpy as np

from ..core import Document
from ..integration import Accuracy
from ..study import Multistart, Study
from .draws import Drawing, check_same_run, refuse_wrong_entries
from .effort import USUAL, Effort
from .evidence import Evidence
from .least_squares import Method, Progress, evaluated
from .problem import pose
from .solver.lm_state import Ending
from .uncertainty.posterior import PROPOSALS


class FitAndStarts(NamedTuple):
    """A fit with its problem, its starts, and the ends of the other starts."""

    evidence: Evidence
    """The evidence of the fit and its problem, with the noise found."""
    starts: dict[str, float]
    """The starts of the fit [SI], by path."""
    multistart: Multistart | None
    """The ends of fits from further starts; None without such fits."""


def run_settings(
    study: Study,
    method: Method,
    intervals: str,
    drawing: Drawing,
    more_starts: int,
    accuracy: Accuracy,
    effort: str = USUAL.name,
) -> Document:
    """Settings that all draws of a run share; a later run may go on only if its own are equal.

    All that chi-square depends on: models, parameters but for their starts, and the records that are fitted.
    """
    return {
        "intervals": intervals,
        "method": method,
        "seed": drawing.seed,
        "resampled": drawing.resampled,
        "sampler": drawing.sampler,
        "proposals": PROPOSALS if intervals == "posterior" else None,
        "more_starts": more_starts,
        "accuracy": fingerprint(accuracy),
        "effort": effort,
        "actuator": study.models.chosen,
        # Draws are kept without names.
        "order": [*study.parameters, *(record.name for record in study.records if record.role == "fit")],
        "parameters": {
            path: {
                "value": p.value,
                "min": p.low,
                "max": p.high,
                "measured_apart": p.measured_apart and list(p.measured_apart),
            }
            for path, p in study.parameters.items()
        },
        "constraints": [constraint.text for constraint in study.constraints] or None,
        "records": {
            record.name: {
                "noise": record.noise,
                "offset": record.offset,
                "resolution": float(record.resolution),
                "conditions": sorted(record.conditions),
                "overrides": sorted(record.overrides),
                "measures": record.measures,
                "measurement": fingerprint(record.measurement),
                "drive": fingerprint(record.drive),
                "samples": fingerprint((record.time, record.measured, record.motion)),
            }
            for record in study.records
            if record.role == "fit"
        },
    }


def fit_document(settings: Document, found: FitAndStarts) -> Document:
    """The fit as plain data, with the `settings` of its run: all that `restored_fit` needs."""
    fit, table = found.evidence.fit, found.multistart
    plain = lambda value: value.tolist() if isinstance(value, np.ndarray) else value
    return settings | {
        "free": np.asarray(fit.free, float).tolist(),
        "noise": np.asarray(found.evidence.problem.noise, float).tolist(),
        "starts": {path: float(number) for path, number in found.starts.items()},
        "success": bool(fit.success),
        "message": fit.message,
        "iterations": int(fit.iterations),
        "evaluations": int(fit.evaluations),
        "ending": int(fit.ending),
        "multistart": None if table is None else {name: plain(value) for name, value in vars(table).items()},
    }


def restored_fit(
    drawing: Drawing, settings: Document, study: Study, accuracy: Accuracy, report: Progress, effort: Effort = USUAL
) -> FitAndStarts | None:
    """Restore fit, problem and starts of a run that goes on; its residuals are computed again.

    **Returns:** None where the store of the `drawing` has none.

    **Raises:** `InputError` where that run had other `settings`, or what was kept is not what a run writes.
    """
    document = drawing.store.begun()
    if document is None:
        return None
    report("going on around the fit that was kept")
    check_same_run(document, settings)
    with refuse_wrong_entries(drawing.store, "the fit"):
        kinds = {"success": bool, "message": str, "iterations": int, "evaluations": int, "ending": int}
        for key, kind in kinds.items():
            if not isinstance(document[key], kind):
                raise TypeError(f"{key} = {document[key]!r}")
        ending = {key: document[key] for key in kinds} | {"ending": Ending(document["ending"])}
        starts = {path: float(number) for path, number in document["starts"].items()}
        table = None
        if (multistart := document["multistart"]) is not None:
            arrays = {name: np.array(value) for name, value in multistart.items() if name not in ("names", "ranges")}
            ranges = {path: (low, high) for path, (low, high) in multistart["ranges"].items()}
            table = Multistart(names=tuple(multistart["names"]), ranges=ranges, **arrays)
        free = _numbers(document, "free", sum(parameter.free for parameter in study.parameters.values()))
        noise = _numbers(document, "noise", len(settings["records"]))
    problem = pose(study, starts, accuracy, effort=effort)._replace(noise=noise)
    fit = evaluated(problem, free, report)._replace(**ending)
    return FitAndStarts(Evidence(problem, fit, study), starts, table)


def _numbers(document: Document, key: str, size: int) -> np.ndarray:
    numbers = np.array(document[key], float)
    if numbers.shape != (size,) or not np.isfinite(numbers).all():
        raise ValueError(f"{key} = {document[key]!r} for {size} numbers")
    return numbers


def fingerprint(value: object) -> str:
    """A digest of all numbers and names in a value."""
    digest = hashlib.sha256()
    for part in _parts(value):
        digest.update(part + b";")
    return digest.hexdigest()[:16]


def _parts(value: object) -> Iterator[bytes]:
    if isinstance(value, np.ndarray | np.generic | jax.Array | float):
        yield np.ascontiguousarray(value, float).tobytes()
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        yield type(value).__qualname__.encode()
        for field in dataclasses.fields(value):
            yield field.name.encode()
            yield from _parts(getattr(value, field.name))
    elif isinstance(value, frozenset | set):
        yield from _parts(sorted(value))
    elif isinstance(value, dict):
        yield from _parts(sorted(value.items()))
    elif isinstance(value, tuple | list):
        for part in value:
            yield from _parts(part)
    else:
        yield repr(value).encode()
