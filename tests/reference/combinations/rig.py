"""A rig as its parts, made of numbers by path: "piezo.gain", "effector.mass", ... in SI units."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

from tests.reference.combinations.contacts import contact_of
from tests.reference.combinations.drives import segments_of
from tests.reference.combinations.hysteresis import Piece
from tests.reference.combinations.stacks import Stack, stack_of
from tests.reference.combinations.voltage import Amplifier, ideal
from tests.reference.independent_friction import Law

GRAVITY = 9.80665
"""Standard acceleration of free fall [m/s^2]."""


@dataclasses.dataclass(frozen=True)
class Stop:
    """A force sensor in the way: P = k depth (1 + d depth'), K. H. Hunt and F. R. E. Crossley, 1975."""

    stiffness: float
    """[N/m]"""
    dissipation: float = 0.0
    """[s/m]"""
    gap: float = 0.0
    """[m]"""


@dataclasses.dataclass(frozen=True)
class Sensor:
    """A low-pass s' = w (x - s) behind a delay."""

    bandwidth: float
    """[Hz]"""
    delay: float = 0.0
    """[s]"""

    @property
    def w(self) -> float:
        """[1/s]"""
        return 2 * math.pi * self.bandwidth


@dataclasses.dataclass(frozen=True)
class Rig:
    """What moves, and what is shown of it."""

    drive: tuple[str, dict[str, Any]]
    """Kind and numbers of the waveform."""
    stack: Stack
    law: Law | None = None
    """The contact; none where the platform is without an end-effector."""
    mass: float = 1.0
    """Of the end-effector [kg]."""
    pull: float = 0.0
    """Load and weight along the tilt, on the end-effector [N]."""
    feedback: bool = False
    """The stack feels the friction force (5.25)."""
    rests_under_load: bool = False
    """Motion begins, and is counted, from where the pull has brought contact and stack to rest."""
    amplifier: Amplifier | None = None
    stop: Stop | None = None
    sensor: Sensor | None = None
    of: str = "effector"
    """Whose motion is shown: effector or platform."""
    output: str = "displacement"
    """What of it: displacement, velocity, acceleration; or stop_force."""

    @property
    def felt(self) -> bool:
        """The friction force moves a platform that has a mass."""
        return self.feedback and math.isfinite(self.stack.dynamics.mass)

    def pieces(self, until: float) -> list[Piece]:
        """The voltage up to a time [s], cut wherever rates may jump."""
        segments = segments_of(*self.drive, until)
        return self.stack.pieces(self.amplifier.path(segments) if self.amplifier else ideal(segments))


def rig_of(
    piezo: str,
    friction: str,
    drive: tuple[str, dict[str, Any]],
    numbers: Mapping[str, float],
    state: str = "",
    parts: tuple[str, ...] = (),
    **chosen: Any,
) -> Rig:
    """A rig of members by name; `chosen` are fields of `Rig`, of = "unloaded" a platform without end-effector."""
    part = lambda word: {key.split(".")[1]: x for key, x in numbers.items() if key.startswith(f"{word}.")}
    law = None
    if chosen.get("of") != "unloaded":
        law = contact_of(friction, part("friction") | ({"state": state} if state else {}))
    effector = part("effector")
    mass = effector.get("mass", 1.0)
    return Rig(
        drive=drive,
        stack=stack_of(piezo, part("piezo")),
        law=law,
        mass=mass,
        pull=effector.get("load", 0.0) + mass * GRAVITY * math.sin(effector.get("tilt", 0.0)),
        amplifier=Amplifier(**part("amplifier")) if "amplifier" in parts else None,
        stop=Stop(**part("stop")) if "stop" in parts else None,
        sensor=Sensor(**part("sensor")) if "sensor" in parts else None,
        **chosen,
    )
