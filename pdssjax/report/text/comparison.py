"""Ways of identification side by side, as plain text."""

from ...core import decimals_for, display_unit, percent, rounded
from ...study import Estimate, FittedParameter
from ._layout import aligned_table, heading
from .amplification import format_effects

_NAIVE = "    naive: the results of the earlier step taken for exact; corrected: their errors carried on.\n"


def format_comparison(joint: Estimate, *others: Estimate) -> str:
    """Fits side by side: values, and the errors with and without those of the earlier step.

    **Arguments:** the `joint` fit, and fits of the same study in two steps, at least one.
    """
    table = _pair(joint, others[0]) if len(others) == 1 else _stacked(joint, *others)
    effects = [format_effects(other.amplification) for other in others[:1] if other.amplification is not None]
    return table + "".join(effects)


def _pair(joint: Estimate, sequential: Estimate) -> str:
    head = ["", "unit", "joint", "+/-", sequential.method, "+/- naive", "+/- corrected", "shift/sigma"]
    rows = [_compared(joint.parameters[path], sequential.parameters[path]) for path in joint.names]
    legend = f"{_NAIVE}    shift/sigma: difference of the two values, in corrected standard errors.\n"
    title = heading(f"{sequential.method.capitalize()} against joint")
    return title + aligned_table("<<>>>>>>", [head, *rows]) + legend


def _compared(joint: FittedParameter, sequential: FittedParameter) -> list[str]:
    unit, factor = display_unit(joint.unit)
    places = decimals_for(min(joint.standard_error, sequential.standard_error) * factor)
    naive = sequential.naive_standard_error
    return [
        joint.path,
        unit,
        rounded(joint.value * factor, places),
        percent(joint.standard_error, joint.value),
        rounded(sequential.value * factor, places),
        "-" if naive is None else percent(naive, sequential.value),
        percent(sequential.standard_error, sequential.value),
        _shift(joint, sequential),
    ]


def _shift(joint: FittedParameter, other: FittedParameter) -> str:
    shift = (other.value - joint.value) / other.standard_error if other.standard_error else float("nan")
    return rounded(shift, 2)


def _stacked(*estimates: Estimate) -> str:
    """A parameter's values below one another, one way a line."""
    head = ["", "", "unit", "value", "+/- naive", "+/- corrected", "shift/sigma"]
    rows = [row for path in estimates[0].names for row in _ways(path, *estimates)]
    legend = f"{_NAIVE}    shift/sigma: distance from the joint fit's value, in corrected standard errors.\n"
    ways = [estimate.method for estimate in estimates]
    title = heading(f"{', '.join(ways[:-1])} and {ways[-1]} side by side".capitalize())
    return title + aligned_table("<<<>>>>", [head, *rows]) + legend


def _ways(path: str, *estimates: Estimate) -> list[list[str]]:
    joint = estimates[0].parameters[path]
    unit, factor = display_unit(joint.unit)
    rows = []
    for estimate in estimates:
        found = estimate.parameters[path]
        first = estimate is estimates[0]
        rows.append(
            [
                path if first else "",
                estimate.method,
                unit if first else "",
                rounded(found.value * factor, decimals_for(found.standard_error * factor)),
                "" if found.naive_standard_error is None else percent(found.naive_standard_error, found.value),
                percent(found.standard_error, found.value),
                "" if first else _shift(joint, found),
            ]
        )
    return rows
