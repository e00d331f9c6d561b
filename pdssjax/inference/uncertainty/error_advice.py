"""Which of a parameter's errors to believe: the last whose assumption the residuals bear out, where it matters."""

from collections.abc import Mapping, Sequence

from ...study import ErrorAdvice, FittedParameter
from ..notes.words import listed

EVIDENT = 10.0
"""Evidence of a record for an error model (as of Akaike's criterion) from which the one before it is wrong: some four
standard deviations."""

MATTERS = 1.15
"""Ratio of a parameter's errors by two models from which it matters which one is believed."""


def advise(
    parameters: Mapping[str, FittedParameter], evidence: Mapping[str, Sequence[float]], records: Sequence[str]
) -> ErrorAdvice | None:
    """Which error model to believe, in one sentence.

    **Arguments:** `parameters` with their errors; the `evidence` of the fitted `records` for each model, from "white"
    on: by that of "coloured", neighbouring residuals are alike, by that of "with-misfit", more of them than noise
    explains is alike in all cycles (or smooth, in a record that does not repeat).

    **Returns:** None where no parameter has errors.
    """
    known = [parameter for parameter in parameters.values() if parameter.errors]
    if not known:
        return None
    slow, repeating = (_evident(evidence.get(name, ()), records) for name in ("coloured", "with-misfit"))
    grown, path = _most_changed(known, "coloured", "with-misfit")
    if repeating and grown >= MATTERS:
        return ErrorAdvice(
            "with-misfit",
            f"Believe the errors with misfit: residuals in {repeating} are alike from cycle to cycle, or smooth, "
            "beyond what noise explains, so the model errs there, and more data of the same kind do not average that "
            f"away. It makes errors up to {grown:.2g} times the coloured ones ({path}).",
        )
    ratio, path = _most_changed(known, "white", "coloured")
    if (slow or repeating) and not 1.0 / MATTERS < ratio < MATTERS:
        return ErrorAdvice(
            "coloured",
            f"Believe the coloured errors: residuals in {slow or repeating} are not independent of each other, and the "
            f"white ones are wrong by a factor of up to {max(ratio, 1.0 / ratio):.2g} ({path}); no misfit that makes a "
            "difference is seen.",
        )
    why = "the residuals are independent of each other, and none repeat beyond chance"
    if slow or repeating:
        why = f"what is not white in the residuals of {slow or repeating} changes no error by more than 15 %"
    return ErrorAdvice("white", f"The white errors hold: {why}.")


def _evident(evidence: Sequence[float], records: Sequence[str]) -> str:
    """The records with evidence, quoted, as a sentence has them; "" for none."""
    return listed(f'"{name}"' for name, most in zip(records, evidence, strict=False) if most >= EVIDENT)


def _most_changed(parameters: Sequence[FittedParameter], before: str, after: str) -> tuple[float, str]:
    """The ratio of errors by two models that is farthest from 1, and whose it is."""
    ratios = [
        (p.errors[after].standard_error / p.errors[before].standard_error, p.path)
        for p in parameters
        if p.errors[before].standard_error > 0 and p.errors[after].standard_error > 0
    ]
    return max(ratios, key=lambda pair: max(pair[0], 1.0 / pair[0]), default=(1.0, ""))
