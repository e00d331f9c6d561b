"""Actuators drawn at random over the range that searches and bounds allow, of every structure a study can have.

What a record of theirs shows is a function of the logarithms of their parameters.  Its derivatives at the
default accuracy are judged by central differences of its values at the tightest one, with two steps: where
these two disagree as much as the derivative does, the record lies at a discontinuity, which both show.
"""

import dataclasses
from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from pdssjax import AbstractDrive, Accuracy, Actuator, Amplifier, Effector, Sensor, Stop
from pdssjax.actuator import IDEAL
from pdssjax.core import member, members, quantities
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.drive.step import Step
from pdssjax.integration.accuracy import TIGHT
from pdssjax.simulation import (
    DISPLACEMENT,
    FRICTION_FORCE,
    STOP_FORCE,
    PlatformOnly,
    PrescribedMotion,
    StickSlip,
    measured,
)

SAMPLES = 100
ROOM = 30_000
"""Steps at the tightest accuracy of an actuator that hardly settles."""
WIDE, USUAL = 10.0, 1.5
"""Factors either way: of a contact's stiffness and damping, of everything else."""
_WIDELY = ("sigma0", "sigma1", "stiffness", "attraction")
STEPS = (1e-5, 1e-6)
"""Of the central differences, in the logarithm of a parameter."""


@dataclasses.dataclass(frozen=True)
class Structure:
    """What is chosen before any number: members, parts, waveform, and what the record measures."""

    friction: str = "anisotropic-lugre"
    state: str = ""
    piezo: str = "second-order"
    drive: AbstractDrive = Sawtooth(64.0, 20.0, 2e-4)
    cycles: float = 3.0
    feedback: bool = False
    parts: tuple[str, ...] = ()
    """Of "amplifier", "sensor", "stop"."""
    shows: str = "effector"
    """effector, platform, unloaded (the platform without an end-effector) or friction."""

    @property
    def times(self) -> np.ndarray:
        """Half of the samples while it slips."""
        cycle = 1.0 / getattr(self.drive, "frequency", 20.0)
        slow = self.cycles * cycle * (np.arange(SAMPLES // 2) + 0.61) / (SAMPLES // 2)
        each = int(SAMPLES // 2 / self.cycles)
        fast = [k * cycle + 1.3e-5 + 0.1 * cycle * np.arange(each) / each for k in range(int(self.cycles))]
        return np.sort(np.concatenate([slow, *fast]))

    @cached_property
    def models(self) -> dict[str, type]:
        """The models whose quantities are drawn, by the name of their part."""
        named: dict[str, type] = {} if self.shows == "friction" else {"piezo": member("piezo", self.piezo)}
        if self.shows != "unloaded":
            named["friction"] = member("friction", self.friction)
        if self.shows not in ("unloaded", "friction"):
            named["effector"] = Effector
        parts = {"amplifier": Amplifier, "sensor": Sensor, "stop": Stop}
        return named | {part: parts[part] for part in self.parts}

    @cached_property
    def nominal(self) -> dict[str, float]:
        """What is drawn, by path; what is 0 by default stays so, and the mass m_g counts with feedback only."""
        declared = {f"{part}.{f}": q for part, model in self.models.items() for f, q in quantities(model).items()}
        idle = {"amplifier.slew"} | (set() if self.feedback else {"piezo.mass"})
        return {path: q.nominal for path, q in declared.items() if q.nominal != 0.0 and path not in idle}

    def draw(self, random: np.random.Generator) -> np.ndarray:
        """Logarithms of factors on the nominal values."""
        spread = [WIDE if path.split(".")[1].startswith(_WIDELY) else USUAL for path in self.nominal]
        return np.log(spread) * random.uniform(-1.0, 1.0, len(spread))

    def shown(self, factors: Any, accuracy: Accuracy) -> Any:
        """What the record shows [m or N], shape (samples,)."""
        numbers = {path: value * jnp.exp(factors[i]) for i, (path, value) in enumerate(self.nominal.items())}
        built = {part: model(**self._own(part, numbers)) for part, model in self.models.items()}
        times = jnp.asarray(self.times)
        if self.shows == "friction":
            moved = 4e-6 * np.sin(2 * np.pi * 15.0 * self.times) + 2e-6 * np.sin(2 * np.pi * 47.0 * self.times)
            contact = PrescribedMotion(built["friction"], times, jnp.asarray(moved))
            return measured(contact, times, accuracy, FRICTION_FORCE)
        sensor = built.get("sensor", IDEAL)
        effector, law = built.get("effector", Effector()), built.get("friction", member("friction", "coulomb")())
        actuator = Actuator(
            built["piezo"], law, effector, self.feedback, stop=built.get("stop"), amplifier=built.get("amplifier")
        )
        if self.shows == "unloaded":
            return measured(PlatformOnly(actuator.driven_platform, self.drive, sensor), times, accuracy)
        system = StickSlip(actuator, self.drive, sensor, 1.0 * (self.shows == "platform"))
        return measured(system, times, accuracy, STOP_FORCE if "stop" in built else DISPLACEMENT)

    def _own(self, part: str, numbers: dict[str, Any]) -> dict[str, Any]:
        own = {path.split(".")[1]: number for path, number in numbers.items() if path.startswith(f"{part}.")}
        return own | ({"state": self.state} if part == "friction" and self.state else {})


class Verdict(NamedTuple):
    """How right one actuator's record and derivatives are."""

    column: str
    """The parameter whose derivative is the furthest off, among those that the record shows."""
    error: float
    """Of that column, relative to its norm; the better of the two differences."""
    discontinuity: float
    """What the two differences disagree by there."""
    value: float
    """Largest error of the record itself [m or N]."""
    reverse: float
    """What forward and reverse mode disagree by, relative to the norm."""
    finished: bool


class Judge:
    """The compiled functions of a structure."""

    def __init__(self, structure: Structure):
        self.structure = structure
        usual = dataclasses.replace(Accuracy(), max_steps=ROOM)
        tight = dataclasses.replace(TIGHT, max_steps=ROOM)
        self._value: Callable = jax.jit(
            lambda p, tolerance, rest: structure.shown(
                p, dataclasses.replace(tight, tolerance=tolerance, settle_tolerance=rest)
            )
        )
        self._jacobian: Callable = jax.jit(jax.jacfwd(lambda p: structure.shown(p, usual)))
        self._gradient: Callable = jax.jit(lambda p, w: jax.vjp(lambda p: structure.shown(p, usual), p)[1](w)[0])
        self._usual, self._tight = usual, tight

    def values(self, factors: np.ndarray, tight: bool) -> np.ndarray:
        accuracy = self._tight if tight else self._usual
        return np.asarray(self._value(factors, float(accuracy.tolerance), float(accuracy.settle_tolerance)))

    def differences(self, factors: np.ndarray, step: float) -> np.ndarray:
        """d shown / d factors by central differences at the tightest accuracy, shape (samples, parameters)."""
        ends = [
            self.values(factors + step * e, True) - self.values(factors - step * e, True) for e in np.eye(factors.size)
        ]
        return np.stack(ends, axis=1) / (2.0 * step)

    def jacobian(self, factors: np.ndarray) -> np.ndarray:
        return np.asarray(self._jacobian(factors))

    def verdict(self, factors: np.ndarray, reverse: bool = True) -> Verdict:
        """The judgement on one actuator."""
        jacobian = self.jacobian(factors)
        coarse, fine = (self.differences(factors, step) for step in STEPS)
        size = np.linalg.norm(coarse, axis=0)
        seen = size > 1e-3 * size.max()
        relative = lambda a, b: np.where(seen, np.linalg.norm(a - b, axis=0) / np.where(seen, size, 1.0), 0.0)
        error = np.minimum(relative(jacobian, coarse), relative(jacobian, fine))
        disagree = relative(coarse, fine)
        beyond = np.where(np.isfinite(error), error, np.inf) - 2.0 * disagree
        worst = int(np.argmax(beyond))
        weights = np.cos(np.arange(jacobian.shape[0]))
        back = np.asarray(self._gradient(factors, weights)) if reverse else weights @ jacobian
        forward = weights @ jacobian
        value = np.abs(self.values(factors, False) - self.values(factors, True)).max()
        return Verdict(
            list(self.structure.nominal)[worst],
            float(error[worst]),
            float(disagree[worst]),
            float(value),
            float(np.linalg.norm(back - forward) / np.linalg.norm(forward)),
            bool(np.isfinite(jacobian).all() and np.isfinite(value)),
        )


WALKS = {
    "anisotropic, deflection": Structure(state="deflection"),
    "anisotropic, force": Structure(state="force"),
    "anisotropic, deflection, backward, 5 Hz": Structure(state="deflection", drive=Sawtooth(64.0, 5.0, 0.0, -1.0)),
    "anisotropic, force, 5 Hz": Structure(state="force", drive=Sawtooth(64.0, 5.0, 0.0)),
}
ASIDE = {
    "anisotropic-lugre": "among the WALKS, in both readings",
    "bristle": "every tooth of its force is an event, thousands a cycle",
}
"""Laws that LAWS leaves out, and why."""
LAWS = {law: Structure(friction=law) for law in members("friction") if law not in ASIDE}
"""Every law, found by its file."""
STACKS = {
    f"{piezo}, unloaded": Structure(piezo=piezo, shows="unloaded")
    for piezo in members("piezo")
    if piezo != "static"  # which jumps as the voltage does: nothing is stepped
}
"""Every piezo, found by its file."""
WAVEFORMS = {
    f"under a {name}": Structure(friction="simplified-lugre", drive=member("drive", name)(), cycles=2.0)
    for name in members("drive")
    if name != "sawtooth"  # that of every other structure
}
"""Every waveform at its nominal numbers, found by its file."""
PARTS = {
    "feedback": Structure(friction="simplified-lugre", feedback=True),
    "platform with feedback": Structure(friction="simplified-lugre", feedback=True, shows="platform"),
    "amplifier": Structure(friction="simplified-lugre", parts=("amplifier",)),
    "sensor": Structure(friction="simplified-lugre", parts=("sensor",)),
    "stop": Structure(friction="simplified-lugre", parts=("stop",), cycles=2.0),
    "stop and sensor": Structure(friction="simplified-lugre", parts=("stop", "sensor"), cycles=2.0),
    "creep": Structure(friction="simplified-lugre", piezo="creep", cycles=2.0),
    "platform behind amplifier and sensor": Structure(
        parts=("amplifier", "sensor"), shows="unloaded", drive=Step(64.0), cycles=1.0
    ),
    "friction record": Structure(friction="lugre", shows="friction"),
    "friction record, anisotropic": Structure(state="deflection", shows="friction"),
}
RINGING = {
    "coulomb, corners while it rings": Structure(friction="coulomb", drive=Sawtooth(64.0, 20.0, 2e-3)),
}
"""A contact that sticks for good while the platform still rings at the next corner."""
ALL = WALKS | LAWS | STACKS | WAVEFORMS | PARTS | RINGING
