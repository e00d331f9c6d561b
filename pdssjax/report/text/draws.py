"""What the draws of a bootstrap or a posterior say, as text."""

from collections.abc import Mapping

from ...core import decimals_for, display_unit, percent, rounded
from ...study import Draws, FittedParameter, ParameterDraws
from ._layout import aligned_table, heading


def format_draws(draws: Draws, parameters: Mapping[str, FittedParameter]) -> str:
    """A line a parameter: mean and deviation of the draws, their intervals, and whether chains agree."""
    chains, each, _ = draws.values.shape
    drawn = f"{chains} chains of {each} draws" if draws.kind == "posterior" else f"{each} replicates"
    lines = f"    {drawn}, seed {draws.seed}; {draws.failed} {draws.failure}\n    drawn: {draws.description}\n"
    head = ["", "unit", "mean", "+/-", "", "95 % of the draws"]
    head += ["R-hat", "effective"] if draws.kind == "posterior" else ["mirrored", "linear +/-"]
    rows = [head, *(_row(draw, parameters[draw.path], draws.kind == "posterior") for draw in draws.parameters)]
    return heading(draws.kind.capitalize()) + lines + aligned_table("<<>>>>>>", rows)


def _row(drawn: ParameterDraws, parameter: FittedParameter, posterior: bool) -> list[str]:
    unit, factor = display_unit(parameter.unit)
    places = decimals_for(drawn.deviation * factor)
    interval = lambda ends: " .. ".join(rounded(end * factor, places) for end in ends)
    row = [
        drawn.path,
        unit,
        rounded(drawn.mean * factor, places),
        rounded(drawn.deviation * factor, places),
        percent(drawn.deviation, drawn.mean),
        interval(drawn.percentile),
    ]
    if posterior:
        return [*row, "-" if drawn.rhat is None else f"{drawn.rhat:.3f}", _count(drawn)]
    return [
        *row,
        "-" if drawn.basic is None else interval(drawn.basic),
        rounded(parameter.standard_error * factor, places),
    ]


def _count(drawn: ParameterDraws) -> str:
    """The smaller of both effective sample sizes."""
    known = [size for size in (drawn.effective, drawn.effective_tails) if size is not None]
    return f"{min(known):.0f}" if known else "-"
