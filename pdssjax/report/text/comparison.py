"""The joint and the sequential fit side by side, as plain text."""

from ...core import decimals_for, display_unit, percent, rounded
from ...study import Estimate, FittedParameter
from ._layout import aligned_table, heading


def format_comparison(joint: Estimate, sequential: Estimate) -> str:
    """Both fits side by side: values, and the errors with and without those of the earlier step."""
    head = ["", "unit", "joint", "+/-", "sequential", "+/- naive", "+/- corrected", "shift/sigma"]
    rows = [_compared(joint.parameters[path], sequential.parameters[path]) for path in joint.names]
    legend = (
        "    naive: the results of the earlier step taken for exact; corrected: their errors carried on.\n"
        "    shift/sigma: difference of the two values, in corrected standard errors.\n"
    )
    return heading("Sequential against joint") + aligned_table("<<>>>>>>", [head, *rows]) + legend


def _compared(joint: FittedParameter, sequential: FittedParameter) -> list[str]:
    unit, factor = display_unit(joint.unit)
    places = decimals_for(min(joint.standard_error, sequential.standard_error) * factor)
    naive = sequential.naive_standard_error
    shift = (sequential.value - joint.value) / sequential.standard_error if sequential.standard_error else float("nan")
    return [
        joint.path,
        unit,
        rounded(joint.value * factor, places),
        percent(joint.standard_error, joint.value),
        rounded(sequential.value * factor, places),
        "-" if naive is None else percent(naive, sequential.value),
        percent(sequential.standard_error, sequential.value),
        rounded(shift, 2),
    ]
