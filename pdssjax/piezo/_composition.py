"""What a composed stack is made of: its parts, the parameters they have, where a fit of them may start.

`Composition` reads and writes the text that names a stack, such as "static+play-8+creep-3".
"""

import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..core import Declared, quantity
from .base import USUAL_SWING, DeterminableRange, Shown

DYNAMICS = ("static", "first-order", "second-order", "rod")
"""Names of the mechanics, from the simplest on."""

HYSTERESES = ("none", "play", "maxwell-slip", "bouc-wen")
"""Names of the laws of hysteresis of the ceramic."""

MOST = {"elements": 64, "asymmetry": 9, "creep": 12, "modes": 8}
"""More of them than any record tells apart."""


class Composition(NamedTuple):
    """Parts of a composed stack: mechanics, hysteresis, asymmetry and creep."""

    dynamics: str = "second-order"
    """One of `DYNAMICS`."""
    hysteresis: str = "play"
    """One of `HYSTERESES`."""
    elements: int = 3
    """Number of elements of play or Maxwell slip."""
    asymmetry: int = 3
    """Degree of the memoryless polynomial of the voltage; 1: a straight line."""
    creep: int = 2
    """Elements of creep, each ten times as slow as the one before; 0: none."""
    modes: int = 1
    """Number of modes of a rod."""

    @property
    def text(self) -> str:
        """The name of the composition, such as "static+play-8+asymmetry-3+creep-3"."""
        parts = [f"rod-{self.modes}" if self.dynamics == "rod" else self.dynamics]
        if self.hysteresis != "none":
            parts.append(f"{self.hysteresis}-{self.elements}" if self.has_elements else self.hysteresis)
        parts += [f"asymmetry-{self.asymmetry}"] * (self.asymmetry > 1) + [f"creep-{self.creep}"] * (self.creep > 0)
        return "+".join(parts)

    @property
    def has_elements(self) -> bool:
        """Play or Maxwell slip, of which there may be any number."""
        return self.hysteresis in ("play", "maxwell-slip")

    @property
    def closed_on_lines(self) -> bool:
        """Whether the motion under a voltage of straight lines is known in closed form."""
        return self.hysteresis != "bouc-wen"


def composition_of(text: str) -> Composition:
    """What a name means; the other way round than `Composition.text`.

    **Raises:** `KeyError` for what is no such name.
    """
    first, *others = text.split("+")
    dynamics, modes = _numbered(first, "rod")
    composition = Composition(dynamics, "none", 0, 1, 0, modes or 1)
    for part in others:
        name, number = _numbered(part, "play", "maxwell-slip", "asymmetry", "creep")
        if name in HYSTERESES:
            composition = composition._replace(hysteresis=name, elements=number)
        elif name == "asymmetry":
            composition = composition._replace(asymmetry=number)
        else:
            composition = composition._replace(creep=number)
    if composition.dynamics not in DYNAMICS or composition.text != text:
        raise KeyError(text)
    return composition


def _numbered(part: str, *counted: str) -> tuple[str, int]:
    found = re.fullmatch(rf"({'|'.join(counted)})-([1-9]\d*)", part)
    return (found[1], int(found[2])) if found else (part, 0)


class Field(NamedTuple):
    """A parameter of a composed stack."""

    name: str
    declared: Declared
    text: str
    """Meaning of the parameter, with its symbol and unit."""


def fields_of(composition: Composition) -> list[Field]:
    """The parameters of a stack, in the order in which reports show them."""
    ends = "in the end" if composition.hysteresis == "maxwell-slip" else "right after a turn"
    gain = quantity(0.8e-7, "m/V", positive=False, low=0.0, linear=True)
    weight = quantity(1.5e-9, "m/V", positive=False, low=0.0, linear=True)
    creep = [
        Field(f"creep_{j}", weight, f"Displacement per volt that element {j} of creep adds in the end [m/V].")
        for j in range(1, composition.creep + 1)
    ]
    if creep:
        time = "Time of the fastest element [s]; each other is ten times as slow."
        creep.append(Field("creep_time", quantity(0.05, "s"), time))
    volts = quantity(0.0, "V", positive=False, optional=True)
    left = quantity(0.0, "m", positive=False, optional=True, linear=True)
    peak = "Voltage to which it had been driven before that rest, from 0 V [V]."
    return [
        Field("gain", gain, f"Displacement per volt C that follows at once, {ends} [m/V]; may be 0."),
        *_dynamics_fields(composition),
        *_hysteresis_fields(composition),
        *(
            Field(
                f"asymmetry_{k}",
                quantity(2e-9 * 80.0 ** (1 - k), f"m/V**{k}", positive=False, linear=True),
                f"Coefficient of the voltage to the power {k} [m/V^{k}].",
            )
            for k in range(2, composition.asymmetry + 1)
        ),
        *creep,
        Field("initial_voltage", volts, "Voltage at which the stack had long rested before t = 0 [V]."),
        *([Field("initial_peak", volts, peak)] if composition.hysteresis != "none" else []),
        *(
            Field(f"initial_creep_{j}", left, f"What element {j} of creep is ahead of that rest at t = 0 [m].")
            for j in range(1, composition.creep + 1)
        ),
    ]


def mechanical_names(composition: Composition) -> tuple[str, ...]:
    """Names of the parameters of a stack's mechanics, without the mass that only friction feedback uses."""
    return tuple(
        field.name for field in _dynamics_fields(composition) if not field.declared.metadata["quantity"].optional
    )


def hysteretic_names(composition: Composition) -> tuple[str, ...]:
    """Names of the parameters of a stack's hysteresis."""
    return tuple(field.name for field in _hysteresis_fields(composition))


def _dynamics_fields(composition: Composition) -> list[Field]:
    mass = Field(
        "mass",
        quantity(0.56, "kg", optional=True),
        "Moving mass of stack and platform m_g [kg]; only friction feedback (5.25) uses it.",
    )
    if composition.dynamics == "first-order":
        return [Field("time_constant", quantity(1e-3, "s"), "Time constant tau with which the platform follows [s].")]
    if composition.dynamics == "second-order":
        return [
            Field("natural_frequency", quantity(6736.0, "rad/s"), "Undamped natural frequency w [rad/s]."),
            Field("damping_ratio", quantity(0.1772, ""), "Damping ratio xi [1], any above 0."),
            mass,
        ]
    if composition.dynamics == "rod":
        return [
            Field("modulus", quantity(1.8967e10, "Pa"), "Young's modulus E [Pa]."),
            Field("viscosity", quantity(1.2106e6, "Pa*s"), "Viscosity eta [Pa s] of the Kelvin-Voigt material (4.4)."),
            Field("density", quantity(8000.0, "kg/m**3"), "Density rho [kg/m3]."),
            Field("stack_length", quantity(0.02, "m"), "Length L [m]."),
            Field("area", quantity(25e-6, "m**2"), "Cross-section A [m2]."),
            Field("platform_mass", quantity(0.5552, "kg"), "Mass M [kg] that the tip carries."),
        ]
    return []


def _hysteresis_fields(composition: Composition) -> list[Field]:
    weight = quantity(0.2e-7 / max(composition.elements, 1), "m/V", positive=False, low=0.0, linear=True)
    if composition.hysteresis == "bouc-wen":
        return [
            Field("hysteresis", weight, "Displacement per volt that is missing right after a turn [m/V]."),
            Field("beta", quantity(0.03, "1/V"), "Rate b with which h forgets along the path [1/V]."),
            Field(
                "gamma",
                quantity(0.01, "1/V", positive=False),
                "Difference g of that rate between loading and unloading, halved [1/V]; from -beta to beta.",
            ),
        ]
    if not composition.has_elements:
        return []
    word, what = (
        ("play", "adds once it moves") if composition.hysteresis == "play" else ("stop", "holds back until it slips")
    )
    return [
        *(
            Field(f"{word}_{j}", weight, f"Displacement per volt that element {j} {what} [m/V].")
            for j in range(1, composition.elements + 1)
        ),
        Field(
            f"{word}_range",
            quantity(30.0, "V"),
            f"Threshold of the last element [V]; element j has j/{composition.elements} of it.",
        ),
    ]


_SHARE = 0.2
"""Fraction of the displacement that is hysteresis, where a fit begins."""

_PASSED = 1.5
"""Voltage before the record over that at which the last element slips: at 1 it tells nothing yet, from 2 on no more."""

_FEW, _LONG = 10.0, 3.0
"""Sample intervals that the fastest element of creep takes at least, and lengths of the longest record that the slowest
takes at most: quicker, one takes over the gain or a lag of the mechanics, and slower, the other is a drift."""

_NARROW = 0.05
"""Part of the voltage's swing at which the last element slips at least: elements that slip within the flicker of a
converter take over the gain, 0.067 of 0.1 um/V within two counts of 12 bits.  A ceramic's reach over most of it."""


def composed_guess(
    composition: Composition,
    nominal: Mapping[str, float],
    shown: Shown,
    known: Mapping[str, float],
    guess: dict[str, float],
) -> dict[str, float]:
    """`guess`, what records show of any stack, with what follows for one of this `composition`; numbers by name.

    **Arguments:** `nominal` numbers of its parameters; what its records have `shown`; `known` numbers are given.
    """
    guess = dict(guess)
    swing = shown.swing or USUAL_SWING
    gain = known.get("gain", guess.get("gain", nominal["gain"]))
    if composition.hysteresis in ("play", "bouc-wen"):
        # The records show what follows in the end.
        guess["gain"] = (1.0 - _SHARE) * gain
    if composition.has_elements:
        word = "play" if composition.hysteresis == "play" else "stop"
        guess |= {f"{word}_range": nominal[f"{word}_range"] * swing / USUAL_SWING}
        guess |= {f"{word}_{j}": _SHARE * gain / composition.elements for j in range(1, composition.elements + 1)}
        guess["initial_peak"] = _PASSED * known.get(f"{word}_range", guess[f"{word}_range"])
    if composition.hysteresis == "bouc-wen":
        beta = known.get("beta", nominal["beta"] * USUAL_SWING / swing)
        guess |= {"hysteresis": _SHARE * gain, "beta": beta, "gamma": beta / 3.0, "initial_peak": 0.5 * swing}
    guess |= {f"asymmetry_{k}": 0.01 * gain / swing ** (k - 1) for k in range(2, composition.asymmetry + 1)}
    guess |= {f"initial_creep_{j}": 0.01 * gain * swing for j in range(1, composition.creep + 1)}
    guess |= {f"creep_{j}": 0.01 * gain for j in range(1, composition.creep + 1)}
    if composition.creep and shown.duration:
        guess["creep_time"] = 10.0 * shown.duration / 10.0**composition.creep
    if shown.interval and "time_constant" in nominal:
        guess["time_constant"] = 2.0 * shown.interval
    return guess


def determinable_ranges_of(composition: Composition, shown: Shown) -> dict[str, DeterminableRange]:
    """Ranges in which records can determine the fastest element of creep, and the thresholds of hysteresis."""
    found = {}
    if composition.creep and shown.interval and shown.duration:
        low = _FEW * shown.interval
        high = max(_LONG * shown.duration / 10.0 ** (composition.creep - 1), _LONG * low)
        slowest = "" if composition.creep == 1 else f" for element {composition.creep}, the slowest"
        found["creep_time"] = DeterminableRange(
            low, high, f"{_FEW:g} sample intervals", f"{_LONG:g} times the length of the longest record{slowest}"
        )
    if composition.has_elements and shown.swing:
        found[f"{'play' if composition.hysteresis == 'play' else 'stop'}_range"] = DeterminableRange(
            _NARROW * shown.swing,
            composition.elements * shown.swing,
            f"{100.0 * _NARROW:g} % of the swing of the voltage",
            "so much that the first element alone slips",
        )
    return found


Samples = Float[np.ndarray, " n"]


def loop_numbers(composition: Composition) -> tuple[str, ...] | None:
    """Names of the thresholds and times that the columns of `loop_columns` depend on; None of a stack without columns.

    None of one that lags, either: the columns have no lag, and what it opens of a loop would pass for quick creep.
    """
    straight = composition.hysteresis == "none" and composition.asymmetry < 2 and not composition.creep
    if straight or composition.hysteresis not in ("none", "play") or composition.dynamics == "first-order":
        return None
    return ("play_range",) * (composition.hysteresis == "play") + ("creep_time",) * (composition.creep > 0)


def loop_columns(
    composition: Composition, time: Samples, volts: Samples, numbers: Mapping[str, float]
) -> dict[str, Samples]:
    """The motion [m] at `time` [s] per unit of each linear parameter under `volts` [V], from rest at 0 V.

    **Arguments:** the thresholds [V] and times [s] that `loop_numbers` names.
    """
    columns = {"gain": volts} | {f"asymmetry_{k}": volts**k for k in range(2, composition.asymmetry + 1)}
    if composition.hysteresis == "play":
        thresholds = numbers["play_range"] * np.arange(1, composition.elements + 1) / composition.elements
        played = _play(volts, thresholds)
        columns |= {f"play_{j + 1}": played[:, j] for j in range(composition.elements)}
    times = [numbers["creep_time"] * 10.0**j for j in range(composition.creep)]
    return columns | {f"creep_{j}": _creep_response(time, volts, lasts) for j, lasts in enumerate(times, start=1)}


def _play(volts: Samples, thresholds: Float[np.ndarray, " m"]) -> Float[np.ndarray, "n m"]:
    out, z = np.empty((volts.size, thresholds.size)), np.zeros(thresholds.size)
    rises = np.diff(volts, prepend=0.0) >= 0.0
    begins = np.flatnonzero(np.diff(rises, prepend=not rises[0]))
    for begin, end in zip(begins, [*begins[1:], volts.size], strict=True):
        run = volts[begin:end, None]
        out[begin:end] = np.maximum(z, run - thresholds) if rises[begin] else np.minimum(z, run + thresholds)
        z = out[end - 1]
    return out


def _creep_response(time: Samples, volts: Samples, lasts: float) -> Samples:
    """The voltage [V] behind a creep of the time constant `lasts` [s], from rest at 0 V."""
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
