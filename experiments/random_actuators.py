"""Every structure that a study can have, with which laws, piezos, waveforms, parts and records.

Actuators of each are drawn at random (`actuator_structure`).
"""

from typing import Any

import numpy as np

from experiments.actuator_structure import SHARES, Structure
from pdssjax import AbstractDrive
from pdssjax.actuator import ZeroOrderHold
from pdssjax.core import member, members, quantities
from pdssjax.drive.cycloidal import Cycloidal
from pdssjax.drive.sampled import Sampled
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.drive.sine import Sine
from pdssjax.drive.step import Step
from pdssjax.drive.trapezoid import Trapezoid
from pdssjax.drive.triangle import Triangle
from pdssjax.piezo import DYNAMICS, HYSTERESES, Composition
from pdssjax.simulation import ACCELERATION, DISPLACEMENT, FRICTION_FORCE, STOP_FORCE, VELOCITY


def _readings(**chosen: Any) -> dict[str, Structure]:
    """The anisotropic law in both readings."""
    return {state: Structure("anisotropic-lugre", state, cycles=3.0, **chosen) for state in ("deflection", "force")}


PUBLISHED = {
    f"{state}, {way}, 5 Hz": structure
    for way, sign in (("forward", 1.0), ("backward", -1.0))
    for state, structure in _readings(drive=Sawtooth(64.0, 5.0, 0.0, sign)).items()
}
"""The published actuator: its law in both readings, in both directions."""
QUICKLY = {f"{state}, 20 Hz": structure for state, structure in _readings().items()}
"""The same at 20 Hz, with a fall time."""
ASIDE = {"anisotropic-lugre": "among the PUBLISHED, in both readings"}
"""Laws that LAWS leaves out, and why."""


def _cycles(law: str) -> float:
    """How many of them to judge a law by; bonds that snap are hundreds of events in each."""
    return 1.25 if law == "bristle" else 3.0


LAWS = {law: Structure(law, cycles=_cycles(law)) for law in members("friction") if law not in ASIDE}
"""Every law, found by its file."""
_FORCES = ("f_c", "f_s", "strength")
"""What the fields begin with that say how much force a contact holds."""
LITTLE = {
    f"{law} with little friction": Structure(
        law,
        given={
            f"friction.{field}": 0.03 * q.nominal
            for field, q in quantities(member("friction", law)).items()
            if field.startswith(_FORCES)
        },
        cycles=3.0,
    )
    for law in members("friction")
    if law != "bristle"
}
"""Every law on a contact that slides on for long, as fits of measured records have it.

But for the bristle law: its bonds would snap ten thousand times a cycle.
"""
_RATE, _SWING = 6736.0, 6.4e-6
"""Natural frequency [rad/s] and displacement [m] of the published platform at 64 V."""
_STACKS = {"piezo.natural_frequency": (0.3 * _RATE, 3.0 * _RATE), "piezo.damping_ratio": (0.03, 0.6)}
_FALLS = {"drive.fall_time": (1e-4, 5e-3)}
_SLIGHT = Sawtooth(8.0, 20.0, 2e-4)
"""For a law whose bonds snap thousands of times where it holds little."""


def _searched(law: str) -> dict[str, tuple[float, float]]:
    """Where a fit without starts looks for a law's numbers, on a rig like the published one."""
    ranges = member("friction", law).search_ranges(0.086, _SWING * _RATE**2, _RATE)
    return {f"friction.{field}": ends for field, ends in ranges.items() if field not in SHARES}


SEARCHED = {
    f"{law}{f', {state}' if state else ''}, over the ranges of the search": Structure(
        law,
        state,
        drive=_SLIGHT if law == "bristle" else Structure.drive,
        ranges=_STACKS | _FALLS | _searched(law),
        cycles=_cycles(law),
    )
    for law in members("friction")
    for state in (("deflection", "force") if law == "anisotropic-lugre" else ("",))
}
"""Every law, and the stack and the fall, over the whole ranges in which a fit without starts looks for them."""
LONE = {
    f"{piezo}, unloaded": Structure(piezo=piezo, of="unloaded", cycles=3.0)
    for piezo in (*members("piezo"), "composed:second-order+play-3+asymmetry-2+creep-2")
    if piezo != "static"  # which jumps as the voltage does: nothing is stepped
}
"""Every piezo, found by its file."""
KINDS = [
    f"composed:{Composition(dynamics, hysteresis, 2, asymmetry=2, creep=1).text}"
    for dynamics in DYNAMICS
    for hysteresis in HYSTERESES
]
"""Stacks put together of every kind of mechanics and of hysteresis."""
LOADED = {
    f"{piezo}, loaded": Structure(piezo=piezo)
    for piezo in (*members("piezo"), *KINDS)
    if piezo != "second-order"  # as everywhere else
}
"""Piezos under a contact."""
JUMPING = {f"{law} on a static stack": Structure(law, piezo="static", cycles=3.0) for law in LAWS}
"""Every law on a stack whose velocity jumps at the corners of the voltage."""
PULL = {"effector.load": 0.1, "effector.tilt": 0.05}
PULLED = {
    f"{law} under a load and on a tilt": Structure(law, state, given=PULL, cycles=3.0)
    for law, state in (("anisotropic-lugre", "deflection"), ("coulomb", ""), ("dahl", ""), ("elastoplastic", ""))
}
PULLED |= {
    f"{law} at rest under its load{felt}": Structure(law, given=PULL, feedback=bool(felt), rests_under_load=True)
    for law, felt in (("lugre", ", which the stack feels"), ("generalized-maxwell-slip", ""))
}
"""A constant force on the end-effector."""

_INSTANTS = np.linspace(0.0, 0.1, 51)
_UNEVEN = 40.0 * (1200.0 * _INSTANTS % 60.0) / 60.0 + 6.0 * np.sin(300.0 * _INSTANTS)
_SAWTOOTH = Sawtooth(64.0, 20.0, 2e-4, duty=0.6)
DRIVES: dict[str, AbstractDrive] = {
    "sawtooth": _SAWTOOTH,
    "triangle": Triangle(64.0, 20.0),
    "trapezoid": Trapezoid(64.0, 20.0, 0.5, 1e-3, 2e-3),
    "sine": Sine(64.0, 20.0),
    "sine that begins with a jump": Sine(64.0, 20.0, 10.0, 0.5),
    "step": Step(64.0, 1e-3),
    "cycloidal": Cycloidal(64.0, 20.0, 2e-3),
    "sampled": Sampled(_INSTANTS, _UNEVEN),
    "sampled, held": Sampled(_INSTANTS, _UNEVEN, "held"),
    "sawtooth, held": ZeroOrderHold(_SAWTOOTH, 1e-3),
}
"""Waveforms with numbers that show what is special of them."""
_OTHERS = {name: member("drive", name) for name in members("drive")}
DRIVES |= {name: kind() for name, kind in _OTHERS.items() if kind not in {type(drive) for drive in DRIVES.values()}}
WAVEFORMS = {f"under a {name}": Structure(drive=drive, draws_drive=True) for name, drive in DRIVES.items()}
"""Every waveform, found by its file: those above, and of others the nominal one."""
PARTS = {
    "feedback": Structure(feedback=True, cycles=3.0),
    "amplifier": Structure(parts=("amplifier",), cycles=3.0),
    "amplifier that slews": Structure(parts=("amplifier",), given={"amplifier.slew": 1e5}, cycles=3.0),
    "amplifier in front of elements that return": Structure(
        piezo="maxwell-slip", parts=("amplifier",), drive=Trapezoid(64.0, 20.0, 0.5, 1e-3, 2e-3), draws_drive=True
    ),
    "sensor": Structure(parts=("sensor",), cycles=3.0),
    "stop": Structure(parts=("stop",), output=STOP_FORCE),
    "stop and sensor": Structure(parts=("stop", "sensor"), output=STOP_FORCE),
    "stop behind an amplifier that slews": Structure(
        parts=("stop", "amplifier"), given={"amplifier.slew": 1e5, "stop.gap": 3e-7}, output=STOP_FORCE
    ),
    "stop in front of a load": Structure("lugre", parts=("stop",), given={"stop.gap": 3e-7} | PULL, output=STOP_FORCE),
    "stop in front of a contact that sticks": Structure(
        "coulomb", parts=("stop",), given={"stop.gap": 3e-7}, output=STOP_FORCE
    ),
    "platform behind amplifier and sensor": Structure(
        parts=("amplifier", "sensor"), of="unloaded", drive=Step(64.0), cycles=1.0
    ),
}
RECORDS = {
    "platform with feedback": Structure(feedback=True, of="platform", cycles=3.0),
    "velocity": Structure(output=VELOCITY),
    "acceleration": Structure(output=ACCELERATION),
    "platform's acceleration": Structure(feedback=True, of="platform", output=ACCELERATION),
    "friction record": Structure("lugre", of="contact", output=FRICTION_FORCE, cycles=3.0),
    "friction record, anisotropic": Structure(
        "anisotropic-lugre", "deflection", of="contact", output=FRICTION_FORCE, cycles=3.0
    ),
}
RECORDS |= {
    f"friction record, {law}": Structure(law, of="contact", output=FRICTION_FORCE, cycles=3.0)
    for law in members("friction")
    if law not in ("lugre", "anisotropic-lugre")
}
"""Kinds of records that those above leave out."""
SLEWING = {
    f"{law} on a static stack, held voltage, amplifier that slews": Structure(
        law, piezo="static", drive=DRIVES["sawtooth, held"], parts=("amplifier",), given={"amplifier.slew": 1e5}
    )
    for law in LAWS
    if law != "bristle"
}
"""Every law where a jump of the velocity begins a slip, and a smooth return ends it.

But for the bristle law: of hundreds of bonds that snap in a slip each depends on the one before.
"""
_PLAY = "composed:{}+play-2+asymmetry-2+creep-1"
LET_GO = {
    "coulomb on a static stack, amplifier that slews": Structure(
        "coulomb", piezo="static", parts=("amplifier",), given={"amplifier.slew": 2e4}
    ),
    "stribeck on a static stack, amplifier that slews for long": Structure(
        "stribeck",
        piezo="static",
        drive=Sawtooth(64.0, 20.0, 1e-2),
        parts=("amplifier",),
        given={"amplifier.slew": 5e3},
    ),
    "stribeck on a static stack with play, amplifier that slews": Structure(
        "stribeck", piezo=_PLAY.format("static"), parts=("amplifier",), given={"amplifier.slew": 2e4}
    ),
    "coulomb on a stack of the first order with play": Structure(
        "coulomb",
        piezo=_PLAY.format("first-order"),
        drive=Sawtooth(64.0, 20.0, 6e-3),
        given={"friction.f_c": 0.2, "piezo.time_constant": 2e-5, "piezo.play_1": 4e-8, "piezo.play_2": 4e-8},
    ),
}
"""A contact that sticks and is let go where the platform's acceleration jumps, at an event of amplifier or stack."""
RINGING = {"coulomb, corners while it rings": Structure("coulomb", drive=Sawtooth(64.0, 20.0, 2e-3), cycles=3.0)}
"""A contact that sticks for good while the platform still rings at the next corner."""
_OUTPUTS = {
    "effector": (DISPLACEMENT, DISPLACEMENT, VELOCITY, ACCELERATION),
    "platform": (DISPLACEMENT, VELOCITY),
    "unloaded": (DISPLACEMENT, VELOCITY),
}
"""What of a motion is drawn as a record; an end-effector's displacement twice as often."""


def combination(number: int) -> Structure:
    """A structure drawn at random: any law, piezo, waveform, parts and record together."""
    random = np.random.default_rng([17, number])
    pick = lambda names: names[int(random.integers(len(names)))]
    law = pick([name for name in members("friction") if name != "bristle"])
    parts = tuple(part for part in ("amplifier", "sensor", "stop") if random.random() < 0.35)
    feedback = bool(random.random() < 0.3)
    of = pick(["effector", "effector", "effector", "unloaded", *(["platform"] if feedback else [])])
    if of == "unloaded":
        parts = tuple(part for part in parts if part != "stop")
        feedback = False
    # A sensor beside a stop is that of the force.
    of = "effector" if {"stop", "sensor"} <= {*parts} else of
    present = {*parts, *(["effector"] if of != "unloaded" else [])}
    piezo = pick(members("piezo"))
    pushes = "stop" in parts and of == "effector" and (random.random() < 0.5 or "sensor" in parts)
    return Structure(
        friction=law,
        state=pick(["deflection", "force"]) if law == "anisotropic-lugre" else "",
        piezo=pick(KINDS) if piezo == "composed" else piezo,
        drive=pick(list(DRIVES.values())),
        draws_drive=bool(random.random() < 0.5),
        given={path: low for path, low in _TOLD.items() if path.split(".")[0] in present and random.random() < 0.5},
        cycles=2.0,
        feedback=feedback,
        parts=parts,
        of=of,
        output=STOP_FORCE if pushes else pick(_OUTPUTS[of]),
    )


_TOLD = {"amplifier.slew": 1e5, "stop.gap": 3e-7} | PULL
"""An amplifier that slews, a stop that is met at once, a load and a tilt."""


def named(name: str) -> Structure:
    """One of STRUCTURES, or a "combination 7"."""
    return STRUCTURES[name] if name in STRUCTURES else combination(int(name.split()[1]))


STRUCTURES = (
    PUBLISHED
    | QUICKLY
    | LAWS
    | LITTLE
    | SEARCHED
    | LONE
    | LOADED
    | JUMPING
    | PULLED
    | WAVEFORMS
    | PARTS
    | RECORDS
    | SLEWING
    | LET_GO
    | RINGING
)
