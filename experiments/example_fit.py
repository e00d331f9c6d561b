"""The packaged example, identified once: what `experiments.map` and `experiments.bands` ask about."""

from pathlib import Path

import numpy as np

import pdssjax
from experiments.common import OUT
from pdssjax import Study
from pdssjax.files import EXAMPLE, estimate_text, read_covariance, with_estimate
from pdssjax.sweeps import CovarianceDraws


def identified() -> tuple[Study, Path]:
    """The example with the numbers of its joint fit, and the estimate.json of that, which is kept for later calls."""
    study, kept = pdssjax.load_study(EXAMPLE / "study.toml"), OUT / "example_fit" / "estimate.json"
    if not kept.exists():
        text = estimate_text(pdssjax.identify(study))
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_text(text, encoding="utf-8")
    return with_estimate(study, kept), kept


def draws(study: Study, estimate: Path, count: int = 1, seed: int = 0) -> CovarianceDraws:
    """Draws of the parameters from the covariance of an `estimate` of the `study`."""
    names, covariance, _ = read_covariance(estimate)
    values, legal = study.values(), study.legal()
    means = np.array([values[name] for name in names])
    return CovarianceDraws(names, means, covariance, np.array([legal[n].positive for n in names]), count, seed)
