"""Where a fit of a composed stack may start, as far as records show it."""

from collections.abc import Mapping

from ._composition import Composition
from .base import USUAL_SWING, Shown, ToldRange

_SHARE = 0.2
"""Of the displacement that is hysteresis, where a fit begins."""

_PASSED = 1.5
"""Voltage before the record over that at which the last element slips: at 1 it tells nothing yet, from 2 on no more."""

_FEW, _LONG = 10.0, 3.0
"""Sample intervals that the fastest element of creep takes at least, and lengths of the longest record that the slowest
takes at most: quicker, one takes over the gain or a lag of the mechanics, and slower, the other is a drift."""


def composed_guess(
    made: Composition, nominal: Mapping[str, float], shown: Shown, known: Mapping[str, float], guess: dict[str, float]
) -> dict[str, float]:
    """`guess`, what records show of any stack, with what follows for one that is `made` so; numbers by name.

    **Arguments:** `nominal` numbers of its parameters; what its records have `shown`; `known` numbers are given.
    """
    guess = dict(guess)
    swing = shown.swing or USUAL_SWING
    gain = known.get("gain", guess.get("gain", nominal["gain"]))
    if made.hysteresis in ("play", "bouc-wen"):
        # The records show what follows in the end.
        guess["gain"] = (1.0 - _SHARE) * gain
    if made.has_elements:
        word = "play" if made.hysteresis == "play" else "stop"
        guess |= {f"{word}_range": nominal[f"{word}_range"] * swing / USUAL_SWING}
        guess |= {f"{word}_{j}": _SHARE * gain / made.elements for j in range(1, made.elements + 1)}
        guess["initial_peak"] = _PASSED * known.get(f"{word}_range", guess[f"{word}_range"])
    if made.hysteresis == "bouc-wen":
        beta = known.get("beta", nominal["beta"] * USUAL_SWING / swing)
        guess |= {"hysteresis": _SHARE * gain, "beta": beta, "gamma": beta / 3.0, "initial_peak": 0.5 * swing}
    guess |= {f"asymmetry_{k}": 0.01 * gain / swing ** (k - 1) for k in range(2, made.asymmetry + 1)}
    guess |= {f"initial_creep_{j}": 0.01 * gain * swing for j in range(1, made.creep + 1)}
    guess |= {f"creep_{j}": 0.01 * gain for j in range(1, made.creep + 1)}
    if made.creep and shown.duration:
        guess["creep_time"] = 10.0 * shown.duration / 10.0**made.creep
    if shown.interval and "time_constant" in nominal:
        guess["time_constant"] = 2.0 * shown.interval
    return guess


def creep_range(made: Composition, shown: Shown) -> dict[str, ToldRange]:
    """Between which numbers records can tell the time of a stack's fastest element of creep; none where it has none."""
    if not made.creep or not shown.interval or not shown.duration:
        return {}
    low = _FEW * shown.interval
    high = max(_LONG * shown.duration / 10.0 ** (made.creep - 1), _LONG * low)
    slowest = "" if made.creep == 1 else f" for element {made.creep}, the slowest"
    return {
        "creep_time": ToldRange(
            low, high, f"{_FEW:g} sample intervals", f"{_LONG:g} times the length of the longest record{slowest}"
        )
    }
