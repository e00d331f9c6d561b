"""Ranges in which records can determine parameters: a fit stays within them where the study gives no bound.

An element of creep that is quicker than the samples takes over the gain, one that takes much longer than the records
is a drift whose size and time are told as a quotient only.
"""

import dataclasses
from collections.abc import Mapping

from ..piezo.base import Shown, ToldRange
from ..study import MARK, Parameter, Study
from .initial_values.record_features import interval_of


def told_ranges(study: Study) -> dict[str, ToldRange]:
    """By path, between which numbers the fitted records tell free parameters, where that is narrower than their bounds.

    A bound that the study gives stands, and a start that it gives lies within.
    """
    driven = [record for record in study.records if record.role == "fit" and record.drive is not None]
    if not driven:
        return {}
    shown = Shown(
        duration=max(float(record.time[-1] - record.time[0]) for record in driven) or None,
        interval=min(map(interval_of, driven)) or None,
    )
    found = {f"piezo.{name}": told for name, told in study.models.piezo.told_ranges(shown).items()}
    out = {}
    for path, parameter in study.parameters.items():
        told = found.get(path.partition(MARK)[0])
        if told is not None and parameter.free:
            out[path] = _around_start(told, parameter)
    return out


def within_told(parameters: Mapping[str, Parameter], told: Mapping[str, ToldRange]) -> dict[str, Parameter]:
    """The `parameters`, those `told` within their range only bounded by it, where the study gives no bound."""
    return {path: _bounded(p, told[path]) if path in told else p for path, p in parameters.items()}


def _around_start(told: ToldRange, parameter: Parameter) -> ToldRange:
    if parameter.start is None:
        return told
    return told._replace(low=min(told.low, parameter.start), high=max(told.high, parameter.start))


def _bounded(parameter: Parameter, told: ToldRange) -> Parameter:
    low = told.low if parameter.low is None else parameter.low
    high = told.high if parameter.high is None else parameter.high
    if not low < high:
        return parameter
    return dataclasses.replace(parameter, low=low, high=high)
