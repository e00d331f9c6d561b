"""A fit as plain data, so that draws around it can go on without fitting again."""

import hashlib
from typing import NamedTuple

import numpy as np

from ..core import Document
from ..integration import Accuracy
from ..study import Multistart, Study
from .draws import Drawing, same_run
from .least_squares import Fit, Method, Progress, evaluated
from .problem import Problem, pose
from .solver.ending import Ending


class Found(NamedTuple):
    """A fit, and how it was come to."""

    fit: Fit
    problem: Problem
    starts: dict[str, float]
    """Where it began [SI], by path."""
    multistart: Multistart | None
    """Where the starts asked for led."""


def as_asked(study: Study, method: Method, intervals: str, drawing: Drawing) -> Document:
    """What the draws of a run have in common, by which a later one knows whether it may go on."""
    return {
        "intervals": intervals,
        "method": method,
        "seed": drawing.seed,
        "resampled": drawing.resampled,
        "parameters": [path for path, parameter in study.parameters.items() if parameter.free],
        "records": _fingerprint(study),
    }


def kept(what: Document, found: Found) -> Document:
    """`what` was asked, with the fit: all that `restored` needs."""
    fit, table = found.fit, found.multistart
    return what | {
        "free": np.asarray(fit.free, float).tolist(),
        "noise": np.asarray(found.problem.noise, float).tolist(),
        "starts": {path: float(number) for path, number in found.starts.items()},
        "success": bool(fit.success),
        "message": fit.message,
        "iterations": int(fit.iterations),
        "evaluations": int(fit.evaluations),
        "ending": int(fit.ending),
        "multistart": None if table is None else {name: _plain(value) for name, value in vars(table).items()},
    }


def restored(document: Document, what: Document, study: Study, accuracy: Accuracy, report: Progress) -> Found:
    """Fit, problem and starts of a run that goes on; its residuals are computed again.

    **Raises:** `InputError` where something else was asked then.
    """
    same_run(document, what)
    problem = pose(study, document["starts"], accuracy)._replace(noise=np.array(document["noise"], float))
    whole = evaluated(problem, np.array(document["free"], float), report)
    fit = whole._replace(
        success=document["success"],
        message=document["message"],
        iterations=document["iterations"],
        evaluations=document["evaluations"],
        ending=Ending(document["ending"]),
    )
    return Found(fit, problem, document["starts"], _table(document["multistart"]))


def _table(document: Document | None) -> Multistart | None:
    if document is None:
        return None
    arrays = {name: np.array(value) for name, value in document.items() if name not in ("names", "ranges")}
    ranges = {path: (low, high) for path, (low, high) in document["ranges"].items()}
    return Multistart(names=tuple(document["names"]), ranges=ranges, **arrays)


def _plain(value: object) -> object:
    return value.tolist() if isinstance(value, np.ndarray) else value


def _fingerprint(study: Study) -> str:
    """Of what was measured, and when."""
    digest = hashlib.sha256()
    for parameter in study.parameters.values():
        if parameter.measured_apart is not None:
            digest.update(f"{parameter.path} {parameter.measured_apart}".encode())
    for record in study.records:
        if record.role == "fit":
            digest.update(np.ascontiguousarray(record.time, float).tobytes())
            digest.update(np.ascontiguousarray(record.measured, float).tobytes())
    return digest.hexdigest()[:16]
