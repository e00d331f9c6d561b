"""A structure that a study can have, and actuators of it drawn at random over the range that fits reach.

What a record of theirs shows is a function of the logarithms of their parameters; `derivative_judge` judges it.
"""

import dataclasses
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import jax.numpy as jnp
import numpy as np

from pdssjax import AbstractDrive, Accuracy, Actuator, Effector
from pdssjax.actuator import IDEAL, PARTS as RIG_PARTS
from pdssjax.core import member, quantities
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.simulation import (
    ACCELERATION,
    DISPLACEMENT,
    FRICTION_FORCE,
    STOP_FORCE,
    VELOCITY,
    Output,
    PlatformOnly,
    PrescribedMotion,
    StickSlip,
    sensor_samples,
)

SAMPLES = 100
WIDE, USUAL = 10.0, 1.5
"""Factors either way: of a contact's stiffness and damping, of everything else."""
_WIDELY = ("sigma0", "sigma1", "stiffness", "attraction")
SHARES = {"elastic_part": 300.0}
"""What lies between 0 and 1 is drawn by its odds, and those by this factor either way; fits go there."""
_UNITS = {VELOCITY: "m/s", ACCELERATION: "m/s2", STOP_FORCE: "N", FRICTION_FORCE: "N"}


@dataclasses.dataclass(frozen=True)
class Structure:
    """What is chosen before any number: members, parts, waveform, and what the record measures."""

    friction: str = "simplified-lugre"
    state: str = ""
    piezo: str = "second-order"
    drive: AbstractDrive = Sawtooth(64.0, 20.0, 2e-4)
    draws_drive: bool = False
    """The numbers of the drive are drawn, too."""
    given: Mapping[str, float] = dataclasses.field(default_factory=dict)
    """Numbers in place of the nominal ones, by path."""
    ranges: Mapping[str, tuple[float, float]] = dataclasses.field(default_factory=dict)
    """Ends between which numbers are drawn, by path; the others are by factors on the nominal ones."""
    cycles: float = 2.0
    feedback: bool = False
    parts: tuple[str, ...] = ()
    """Of "amplifier", "sensor", "stop"."""
    rests_under_load: bool = False
    of: str = "effector"
    """effector, platform, unloaded (the platform without an end-effector) or contact (moved as prescribed)."""
    output: Output = DISPLACEMENT
    """What is measured of it."""

    @property
    def unit(self) -> str:
        """Of the record."""
        return _UNITS.get(self.output, "m")

    @property
    def times(self) -> np.ndarray:
        """Half of the samples while it slips."""
        cycle = float(1.0 / (self.drive.cycle_frequency() or 20.0))
        slow = self.cycles * cycle * (np.arange(SAMPLES // 2) + 0.61) / (SAMPLES // 2)
        each = int(SAMPLES // 2 / self.cycles)
        fast = [k * cycle + 1.3e-5 + 0.1 * cycle * np.arange(each) / each for k in range(int(self.cycles))]
        return np.sort(np.concatenate([slow, *fast]))

    @cached_property
    def models(self) -> dict[str, type]:
        """The models whose quantities are drawn, by the name of their part."""
        named: dict[str, type] = {} if self.of == "contact" else {"piezo": member("piezo", self.piezo)}
        if self.of != "unloaded":
            named["friction"] = member("friction", self.friction)
        if self.of not in ("unloaded", "contact"):
            named["effector"] = Effector
        return named | {part: RIG_PARTS[part] for part in self.parts}

    @cached_property
    def nominal(self) -> dict[str, float]:
        """What is drawn, by path; what is 0 by default stays so, and the mass m_g counts with feedback only."""
        declared = {f"{part}.{f}": q for part, model in self.models.items() for f, q in quantities(model).items()}
        numbers = {path: float(q.nominal) for path, q in declared.items()}
        if self.draws_drive:
            numbers |= {f"drive.{field}": float(number) for field, number in self.drive.numbers().items()}
        idle = {"amplifier.slew"} | (set() if self.feedback else {"piezo.mass"})
        usual = {path: number for path, number in numbers.items() if number != 0.0 and path not in idle}
        return usual | dict(self.given) | {path: (low * high) ** 0.5 for path, (low, high) in self.ranges.items()}

    def draw(self, random: np.random.Generator) -> np.ndarray:
        """Logarithms of factors on the nominal values, or on the odds of a share."""
        spread = [self._spread(path) for path in self.nominal]
        return np.log(spread) * random.uniform(-1.0, 1.0, len(spread))

    def _spread(self, path: str) -> float:
        """The factor either way by which a number is drawn."""
        field = path.split(".")[1]
        if path in self.ranges:
            low, high = self.ranges[path]
            return (high / low) ** 0.5
        return SHARES.get(field, WIDE if field.startswith(_WIDELY) else USUAL)

    def shown(self, factors: Any, accuracy: Accuracy) -> Any:
        """What the record shows [its `unit`], shape (samples,), of actuators with these logarithms of factors."""
        numbers = {path: _scaled(path, value, factors[i]) for i, (path, value) in enumerate(self.nominal.items())}
        built = {part: model(**self._numbers(part, numbers)) for part, model in self.models.items()}
        drive, times = self.drive.with_numbers(_of_part("drive", numbers)), jnp.asarray(self.times)
        if self.of == "contact":
            moved = 4e-6 * np.sin(2 * np.pi * 15.0 * self.times) + 2e-6 * np.sin(2 * np.pi * 47.0 * self.times)
            contact = PrescribedMotion(built["friction"], times, jnp.asarray(moved))
            return sensor_samples(contact, times, accuracy, self.output)
        sensor = built.get("sensor", IDEAL)
        effector, law = built.get("effector", Effector()), built.get("friction", member("friction", "coulomb")())
        parts = {part: built[part] for part in ("stop", "amplifier") if part in built}
        rests = self.rests_under_load
        actuator = Actuator(built["piezo"], law, effector, self.feedback, **parts, rests_under_load=rests)
        if self.of == "unloaded":
            return sensor_samples(PlatformOnly(actuator.driven_platform, drive, sensor), times, accuracy, self.output)
        system = StickSlip(actuator, drive, sensor, 1.0 * (self.of == "platform"))
        return sensor_samples(system, times, accuracy, self.output)

    def _numbers(self, part: str, numbers: dict[str, Any]) -> dict[str, Any]:
        return _of_part(part, numbers) | ({"state": self.state} if part == "friction" and self.state else {})


def _scaled(path: str, value: float, factor: Any) -> Any:
    """`value` times e to the `factor`; of a share its odds."""
    scaled = value * jnp.exp(factor)
    return scaled / (1.0 - value + scaled) if path.split(".")[1] in SHARES else scaled


def _of_part(part: str, numbers: dict[str, Any]) -> dict[str, Any]:
    return {path.split(".")[1]: number for path, number in numbers.items() if path.startswith(f"{part}.")}
