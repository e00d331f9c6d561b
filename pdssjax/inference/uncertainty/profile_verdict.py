"""What the ends of a likelihood interval, and the curve between them, say of a parameter: in a word, and in notes."""

from ...study import FittedParameter
from ..notes.words import about_better_optimum
from ..problem import Problem
from .end_search import End, Verdict
from .profile_curve import Curve

FALLS = 0.05
"""Share of the threshold by which chi-square may fall on the way outwards before that counts as another minimum."""


def verdict_of(ends: tuple[End, ...], curve: Curve) -> str:
    """What both ends and the curve between them say of a parameter."""
    found = [end.verdict for end in ends]
    names = ("lower", "upper")
    if Verdict.LOWER in found:
        return "several minima: a lower one was found"
    if curve.falls > FALLS:
        return "several minima: chi-square falls on the way to an end"
    for verdict in (Verdict.LOST, Verdict.AT_BOUND, Verdict.FLAT):
        where = [name for name, other in zip(names, found, strict=True) if other == verdict]
        if where and verdict == Verdict.FLAT:
            return "flat" if len(where) == 2 else f"one-sided: only {'an upper' if 'lower' in where else 'a lower'} end"
        if where:
            return f"{verdict}: {' and '.join(where)} end"
    return str(Verdict.BOUNDED)


def notes_of(parameter: FittedParameter, problem: Problem, ends: tuple[End, ...], at: float) -> list[str]:
    """Of every end that is no ordinary one, where the estimate lies `at` that number on the scale of the fit."""
    # That an optimum lies at its bound is said already.
    notes = []
    for name, end in zip(("lower", "upper"), ends, strict=True):
        what = f"The {name} end of the interval of {parameter.path}"
        if end.verdict == Verdict.FLAT:
            notes.append(
                f"{what} is open: the records do not tell how {'small' if name == 'lower' else 'large'} it is."
            )
        elif end.verdict == Verdict.AT_BOUND and end.value != at:
            notes.append(f"{what} is its bound: the records allow values beyond it.")
        elif end.verdict == Verdict.LOWER:
            when = f"On the way to the {name} end of {parameter.path}"
            number = float(problem.decode(end.point.at)[parameter.path])
            notes.append(about_better_optimum(when, end.point.chi2, parameter.path, number))
        elif end.verdict == Verdict.LOST:
            notes.append(
                f"{what} was not found: chi-square has a discontinuity on the way, bends too much, or cannot be "
                "simulated there."
            )
    return notes
