"""Likelihood profiles as text: a verdict for each parameter."""

import math
from collections.abc import Mapping, Sequence

from ...study import FittedParameter, Profile
from ._layout import aligned_table, heading


def format_profiles(profiles: Sequence[Profile], parameters: Mapping[str, FittedParameter]) -> str:
    """One line a parameter: the verdict, and how far both ends lie from where the standard error puts them.

    Free parameters without a profile are there, too, held by a bound at the estimate or without information.
    """
    rows = [["", "verdict", "below", "above", "quality"]]
    for profile in profiles:
        low, high = parameters[profile.path].verdicts or ("", "")
        quality = "-" if math.isnan(profile.quality) else f"{profile.quality:.2f}"
        ends = [
            _ratio(low, profile.linear[0] / profile.threshold),
            _ratio(high, profile.linear[-1] / profile.threshold),
        ]
        rows.append([profile.path, profile.verdict, *ends, quality])
    told = {profile.path for profile in profiles}
    for path, parameter in parameters.items():
        if parameter.free and path not in told and (parameter.at_bound or not parameter.identifiable):
            verdict = "held by a bound: the estimate lies there" if parameter.at_bound else "flat: no information"
            rows.append([path, verdict, "-", "-", "-"])
    legend = (
        "    below, above: distance of either end in units of that of the linear interval (1.00: a parabola).\n"
        "    quality: 1 where the points of the curve foretell each other, 0 where one misses by the threshold.\n"
    )
    return heading("Profiles of chi-square") + aligned_table("<<>>>", rows) + legend


def _ratio(verdict: str, square: float) -> str:
    return f"{math.sqrt(square):.2f}" if verdict == "bounded" else "-"
