"""Identifies the parameters of a study: jointly, or the piezo first as the thesis did."""

import dataclasses
import time
from typing import Literal

from .errors import InputError
from .estimate import Estimate
from .fitting import Progress, joint, sequential
from .integration import Accuracy
from .multistart import best_fit
from .simulation import need_double_precision
from .study import Study
from .summary import summarise

Method = Literal["joint", "sequential"]


def identify(
    study: Study,
    method: Method = "joint",
    *,
    progress: Progress | None = None,
    accuracy: Accuracy | None = None,
) -> Estimate:
    """The free parameters of a study from its records with role "fit", with uncertainties.

    **Arguments:** `method` is "joint", all parameters from all records at once, or
    "sequential": the piezo from the platform records, then the others with the piezo held,
    as in the thesis, the first step's errors carried on into the second.  `progress` is
    called with a line of text now and then.

    **Raises:** `InputError` if there is nothing to fit.  A fit that does not converge is
    returned all the same, with `converged` False and the reason in `message`.
    """
    need_double_precision()
    begun = time.perf_counter()
    report = progress or (lambda message: None)
    _check(study, method)
    report("finding starts")
    run = joint if method == "joint" else sequential
    fit, problem, starts = best_fit(study, accuracy or Accuracy(), run, report)
    report("predicting every record")
    estimate = summarise(study, method, problem, fit, starts)
    return dataclasses.replace(estimate, seconds=time.perf_counter() - begun)


def _check(study: Study, method: str) -> None:
    where = study.path or study.title
    if method not in ("joint", "sequential"):
        raise InputError(f'method: found "{method}", expected "joint" or "sequential".')
    fitted = [record for record in study.records if record.role == "fit"]
    if not fitted:
        raise InputError(f'{where}: found no record with role "fit", expected at least one.')
    free = [path for path, parameter in study.parameters.items() if parameter.free]
    if not free:
        raise InputError(f"{where}: parameters: found none that is free, expected at least one to fit.")
    measured = {record.measures for record in fitted}
    if method == "sequential" and measured != {"platform", "effector"}:
        raise InputError(
            f"{where}: found fitted records of the {' and the '.join(sorted(measured))} only; "
            "the sequential method expects some of the platform, for the piezo, and some of the end-effector."
        )
