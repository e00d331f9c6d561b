"""Which combinations of parameters the data determine, as plain text."""

from ...study import Combination, Diagnosis, Remedy
from ._layout import aligned_table, heading, note

_MOST = 3
"""Combinations shown: those that limit what is known."""

_PARTS = 4
"""Parameters of a combination that are named."""


def format_diagnosis(diagnosis: Diagnosis) -> str:
    """The worst determined products of powers of parameters, with their relative standard errors."""
    worst = sorted(diagnosis.combinations, key=lambda found: -found.relative_error)[:_MOST]
    rows = [[_product(found), f"{100 * found.relative_error:.2g} %"] for found in worst]
    advice = "" if diagnosis.remedy is None else _advice(diagnosis.remedy)
    return heading("Products that the data determine least") + aligned_table("<>", rows) + advice


def _advice(remedy: Remedy) -> str:
    """What would help most."""
    gains = ", ".join(f"{path} from {100 * a:.2g} to {100 * b:.2g} %" for path, (a, b) in remedy.errors.items())
    return note(f"If {remedy.path} were known from elsewhere, errors would fall: {gains}.")


def _product(combination: Combination) -> str:
    """Such as "friction.sigma1_b  friction.f_ss_b^-0.4"."""
    parts = list(combination.exponents.items())
    text = "  ".join(path if abs(e - 1.0) < 0.005 else f"{path}^{e:.1f}" for path, e in parts[:_PARTS])
    return text if len(parts) <= _PARTS else f"{text}  ..."
