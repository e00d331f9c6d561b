"""Resonances of a rig, and which records are sampled finely enough to show them.

The contact at rest is a spring k with a damper c between platform and end-effector, so the mass m
rings with sqrt(k/m) and the damping ratio c/(2 sqrt(k m)).  k and c are those of the friction
law linearised about its undisturbed state: sigma0 and sigma1 of a bristle.  On a force sensor
the stop's stiffness adds to k.  The platform rings in the modes of its piezo.

Samples that are Ts apart cannot tell a frequency f from its aliases |f - j/Ts|: a mode above half
of the sampling rate may be the image of another.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..core import Scalar, ScalarLike, kept_jit
from ..friction.base import AbstractFriction
from .measurement.base import AbstractMeasurement
from .models import Models
from .record import Record

SHOWN = 0.4
"""The part of the sampling rate up to which a record shows a frequency: two and a half samples a period."""


class Resonance(NamedTuple):
    """One way in which the rig rings."""

    what: str
    """"contact", or "platform"."""
    frequency: float
    """Undamped natural frequency [Hz]."""
    damping_ratio: float
    blocked: bool | None = None
    """Whether a stop adds its stiffness to the resonance of a contact; None for other resonances."""

    def acts_on(self, measurement: AbstractMeasurement) -> bool:
        """Whether what is measured has this mode in it."""
        if self.blocked is None:
            return measurement.driven
        return measurement.effector_moves and measurement.blocked == self.blocked


def resonances(models: Models, values: dict[str, float]) -> list[Resonance]:
    """All modes of a rig with the parameters `values` [SI] that oscillate; what is left out is nominal."""
    actuator = models.actuator(values)
    stacked = getattr(actuator.piezo, "modes", actuator.piezo)
    rates = np.atleast_1d(getattr(stacked, "natural_frequency", ()))
    damping = np.atleast_1d(getattr(stacked, "damping_ratio", ()))
    found = [Resonance("platform", w / (2 * np.pi), xi) for w, xi in zip(rates, damping, strict=True)]
    mass, stop = float(actuator.effector.mass), float(values.get("stop.stiffness", 0.0))
    for sign in (1.0, -1.0):
        stiffness, damper = linearised(actuator.friction, sign)
        for blocked, spring in ((False, stiffness), (True, stiffness + stop)):
            if spring > 0.0:
                w = np.sqrt(spring / mass)
                found.append(Resonance("contact", float(w / (2 * np.pi)), float(damper / (2 * mass * w)), blocked))
    return [mode for mode in dict.fromkeys(found) if mode.damping_ratio < 1.0]


def linearised(contact: AbstractFriction, sign: float) -> tuple[float, float]:
    """Stiffness [N/m] and damping [N s/m] of an undisturbed `contact` that begins to move in the direction `sign`."""
    # As arrays, numbers do not make another function of each contact.
    contact = jax.tree.map(lambda x: np.asarray(x) if isinstance(x, float) else x, contact)
    stiffness, damping = _linearised(contact, np.float64(sign))
    return float(stiffness), float(damping)


@kept_jit
def _linearised(contact: AbstractFriction, sign: ScalarLike) -> tuple[Scalar, Scalar]:
    state, still = contact.initial(), jnp.zeros(())
    numbers = lambda rates: tuple(jnp.asarray(rate, float) for rate in rates)

    def force_rate(v: Scalar) -> Scalar:
        moves = numbers(contact.rate(state, v, sign))
        return jax.jvp(lambda s: jnp.asarray(contact.force(s, still, sign), float), (state,), (moves,))[1]

    stiffness = jax.jvp(force_rate, (still,), (jnp.ones(()),))[1] if state else still
    force = lambda v: jnp.asarray(contact.force(state, v, sign), float)
    damping = jax.jvp(force, (still,), (jnp.ones(()),))[1]
    return stiffness, damping


def depends_on(models: Models, values: dict[str, float], paths: Sequence[str]) -> dict[Resonance, list[str]]:
    """Which of the parameters `paths` set the frequency or the damping of each resonance."""
    modes = resonances(models, values)
    found: dict[Resonance, list[str]] = {mode: [] for mode in modes}
    for path in paths:
        # Towards zero, as all parameters may go.
        moved = resonances(models, values | {path: values[path] * (1.0 - 1e-3)})
        for mode in modes:
            if mode not in moved:
                found[mode].append(path)
    return found


def shown_up_to(record: Record) -> float:
    """The highest frequency [Hz] that a `record` shows, by the finest tenth of its sample intervals."""
    return SHOWN / float(np.percentile(np.diff(record.time), 10.0))


def hidden_from(mode: Resonance, records: Sequence[Record]) -> list[Record]:
    """The `records` that have the `mode` in them, where not one is sampled finely enough for it; else none."""
    seen = [record for record in records if mode.acts_on(record.measurement)]
    return [] if any(mode.frequency <= shown_up_to(record) for record in seen) else seen
