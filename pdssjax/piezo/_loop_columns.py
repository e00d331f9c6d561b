"""What each linear parameter of a composed stack makes of a sampled voltage, without mechanics: by NumPy, in moments.

An element of play stays on a run of samples that rise at max(z, u - r), z before the run, and falls likewise; creep
is exact where the voltage is a straight line from sample to sample.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from ._composition import Composition

Samples = Float[np.ndarray, " n"]


def loop_numbers(made: Composition) -> tuple[str, ...]:
    """Names of the thresholds and times that the columns of `loop_columns` depend on; none of a stack that has none.

    None of one that lags, either: the columns have no lag, and what it opens of a loop would pass for quick creep.
    """
    if made.hysteresis not in ("none", "play") or made.dynamics == "first-order":
        return ()
    return ("play_range",) * (made.hysteresis == "play") + ("creep_time",) * (made.creep > 0)


def loop_columns(made: Composition, time: Samples, volts: Samples, numbers: Mapping[str, float]) -> dict[str, Samples]:
    """By linear parameter, the motion [m] at `time` [s] that a unit of it makes of `volts` [V], from rest at 0 V.

    **Arguments:** the thresholds [V] and times [s] that `loop_numbers` names.
    """
    columns = {"gain": volts} | {f"asymmetry_{k}": volts**k for k in range(2, made.asymmetry + 1)}
    if made.hysteresis == "play":
        thresholds = numbers["play_range"] * np.arange(1, made.elements + 1) / made.elements
        played = _play(volts, thresholds)
        columns |= {f"play_{j + 1}": played[:, j] for j in range(made.elements)}
    return columns | {f"creep_{j + 1}": _crept(time, volts, numbers["creep_time"] * 10.0**j) for j in range(made.creep)}


def _play(volts: Samples, thresholds: Float[np.ndarray, " m"]) -> Float[np.ndarray, "n m"]:
    out, z = np.empty((volts.size, thresholds.size)), np.zeros(thresholds.size)
    rises = np.diff(volts, prepend=0.0) >= 0.0
    begins = np.flatnonzero(np.diff(rises, prepend=not rises[0]))
    for begin, end in zip(begins, [*begins[1:], volts.size], strict=True):
        run = volts[begin:end, None]
        out[begin:end] = np.maximum(z, run - thresholds) if rises[begin] else np.minimum(z, run + thresholds)
        z = out[end - 1]
    return out


def _crept(time: Samples, volts: Samples, lasts: float) -> Samples:
    steps = np.diff(time)
    fades = np.exp(-steps / lasts)
    # On a line c goes from c0 - u0 + tau u' to nothing, around u - tau u'.
    behind = lasts * np.diff(volts) / steps
    out, crept = np.empty(volts.size), float(volts[0]) * (1.0 - float(np.exp(-time[0] / lasts)))
    out[0] = crept
    for k, (fade, late, before, now) in enumerate(zip(fades, behind, volts[:-1], volts[1:], strict=True), start=1):
        crept = now - late + (crept - before + late) * fade
        out[k] = crept
    return out
