"""Ranges in which records can determine parameters: a fit stays within them where the study gives no bound.

An element of creep that is quicker than the samples takes over the gain, one that takes much longer than the records
is a drift of whose size and time the records show the quotient only.  An element of hysteresis that slips within the
flicker of the voltage takes over the gain, too.
"""

import dataclasses
from collections.abc import Mapping

from ..piezo.base import DeterminableRange, Shown
from ..study import MARK, Parameter, Study
from .initial_values.record_features import interval_of, swing_of


def determinable_ranges(study: Study) -> dict[str, DeterminableRange]:
    """Find the range in which the fitted records can determine each free parameter, by path; of some there is none.

    A bound that the study gives stands, and a start that it gives lies within.
    """
    driven = [record for record in study.records if record.role == "fit" and record.drive is not None]
    if not driven:
        return {}
    shown = Shown(
        duration=max(float(record.time[-1] - record.time[0]) for record in driven) or None,
        interval=min(map(interval_of, driven)) or None,
        swing=max(map(swing_of, driven)) or None,
    )
    found = {f"piezo.{name}": within for name, within in study.models.piezo.determinable_ranges(shown).items()}
    out = {}
    for path, parameter in study.parameters.items():
        within = found.get(path.partition(MARK)[0])
        if within is not None and parameter.free:
            out[path] = _around_start(within, parameter)
    return out


def within_determinable(
    parameters: Mapping[str, Parameter], ranges: Mapping[str, DeterminableRange]
) -> dict[str, Parameter]:
    """The `parameters`, those with one of the `ranges` bounded by it where the study gives no bound."""
    return {path: _bounded(p, ranges[path]) if path in ranges else p for path, p in parameters.items()}


def _around_start(within: DeterminableRange, parameter: Parameter) -> DeterminableRange:
    if parameter.start is None:
        return within
    return within._replace(low=min(within.low, parameter.start), high=max(within.high, parameter.start))


def _bounded(parameter: Parameter, within: DeterminableRange) -> Parameter:
    low = within.low if parameter.low is None else parameter.low
    high = within.high if parameter.high is None else parameter.high
    if not low < high:
        return parameter
    return dataclasses.replace(parameter, low=low, high=high)
