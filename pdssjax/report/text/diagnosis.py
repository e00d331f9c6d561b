"""Which combinations of parameters the data determine, as plain text."""

from collections.abc import Sequence

from ...study import Combination, Diagnosis, Remedy
from ._layout import aligned_table, heading, note

_MOST = 3
"""Combinations shown of either kind: those that limit what is known, and those that the fit is sure of."""

_PARTS = 4
"""Parameters of a combination that are named."""


def format_diagnosis(diagnosis: Diagnosis) -> str:
    """The worst and the best determined products of powers of parameters, with their relative standard errors."""
    ranked = sorted(diagnosis.combinations, key=lambda found: -found.relative_error)
    best = ranked[max(_MOST, len(ranked) - _MOST) :][::-1]
    text = heading("Products that the data determine least") + _table(ranked[:_MOST])
    if diagnosis.remedy is not None:
        text += _advice(diagnosis.remedy)
    if best:
        text += "\n" + heading("Products that the data determine best") + _table(best)
        text += note("Exponents are rounded, small ones left out; estimate.json has those that the errors belong to.")
    return text


def _table(found: Sequence[Combination]) -> str:
    return aligned_table("<>", [[_product(each), f"{100 * each.relative_error:.2g} %"] for each in found])


def _advice(remedy: Remedy) -> str:
    """What would help most."""
    gains = ", ".join(f"{path} from {100 * a:.2g} to {100 * b:.2g} %" for path, (a, b) in remedy.errors.items())
    return note(f"If {remedy.path} were known from elsewhere, errors would fall: {gains}.")


def _product(combination: Combination) -> str:
    """Such as "friction.sigma1_b  friction.f_ss_b^-0.42"."""
    parts = list(combination.exponents.items())
    text = "  ".join(path if abs(e - 1.0) < 0.005 else f"{path}^{e:.2f}" for path, e in parts[:_PARTS])
    return text if len(parts) <= _PARTS else f"{text}  ..."
