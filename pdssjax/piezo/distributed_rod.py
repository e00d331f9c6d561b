"""The stack as a rod that carries the platform at its end: its first modes, side by side (4.3-4.12).

    y = y_1 + … + y_n,   y_j'' + 2 xi_j w_j y_j' + w_j^2 y_j = g_j w_j^2 u   [ - F / m_j (5.25) ]

`pdssjax.piezo._rod` makes frequencies w_j, damping ratios xi_j, gains g_j and modal masses m_j of the
stack's and the platform's data.  The damping ratio grows with the frequency, so that high
modes do not oscillate; their motion is known in closed form as well.  With the nominal numbers the
second mode moves the platform by a millionth of what the first does, and its fast root is at
4e6 rad/s: for records of the platform it costs nothing, but with an end-effector every step
would have to be shorter than its time.  So one mode is kept unless `count` says otherwise.
"""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from ..core import Choice, Scalar, ScalarLike, choice, quantities, quantity
from ..drive.base import Segment, Voltage
from ..integration import N, Term
from ._oscillator import accelerated, damped, forced, tends_to
from ._rod import Modes, Rod, modes
from .base import AbstractPiezo, Shown, State, Terms


class DistributedRod(AbstractPiezo):
    """Pairs (y_j, y_j'), one a mode."""

    closed = True

    count: int = eqx.field(static=True, default=1)
    """How many modes n are kept."""
    mechanical = ("modulus", "viscosity", "density", "stack_length", "area", "platform_mass")

    modulus: float = quantity(1.8967e10, "Pa")
    """Young's modulus E [Pa]."""
    viscosity: float = quantity(1.2106e6, "Pa*s")
    """Viscosity eta [Pa s] of the Kelvin-Voigt material (4.4)."""
    density: float = quantity(8000.0, "kg/m**3")
    """Density rho [kg/m3]."""
    stack_length: float = quantity(0.02, "m")
    """Length L [m]."""
    area: float = quantity(25e-6, "m**2")
    """Cross-section A [m2]."""
    strain: float = quantity(4.897e-6, "1/V")
    """Strain per volt s [1/V] of the unloaded stack."""
    platform_mass: float = quantity(0.5552, "kg")
    """Mass M [kg] that the tip carries."""
    excitation: Choice = choice({"strain": 0.0, "equal": 1.0})
    """How the voltage drives the modes: `strain` (the default) or `equal`, see `pdssjax.piezo._rod`."""

    @classmethod
    def first_guess(cls, shown: Shown, known: Mapping[str, float]) -> dict[str, float]:
        """Modulus, viscosity and strain that give the first mode the gain, frequency and damping ratio shown."""
        numbers: dict[str, Any] = {
            name: known.get(name, declared.nominal) for name, declared in quantities(cls).items()
        }
        guess = {}
        if shown.natural_frequency is not None:
            rate = float(cls(**numbers).modes.natural_frequency[0])
            guess["modulus"] = numbers["modulus"] * (shown.natural_frequency / rate) ** 2
        numbers |= {"modulus": known.get("modulus", guess.get("modulus", numbers["modulus"]))}
        if shown.damping_ratio is not None:
            rate = float(cls(**numbers).modes.natural_frequency[0])
            guess["viscosity"] = 2.0 * numbers["modulus"] * shown.damping_ratio / rate
        if shown.gain is not None:
            guess["strain"] = shown.gain / numbers["stack_length"]
        return guess

    @property
    def rod(self) -> Rod:
        """Stack and platform."""
        return Rod(
            modulus=self.modulus,
            viscosity=self.viscosity,
            density=self.density,
            length=self.stack_length,
            area=self.area,
            strain=self.strain,
            platform_mass=self.platform_mass,
            excitation=self.excitation,
        )

    @property
    def modes(self) -> Modes:
        """The modes of `rod`, by `pdssjax.piezo._rod`."""
        return modes(self.rod, self.count)

    @property
    def mass(self) -> Scalar:
        """Mass [kg] that a force at the tip accelerates at first, in all the modes kept."""
        return 1.0 / jnp.sum(1.0 / self.modes.mass)

    def initial(self) -> State:
        return tuple(jnp.zeros(()) for _ in range(2 * self.count))

    def rate(self, state: Terms, voltage: Voltage[Term], force: Term) -> Terms:
        rates = []
        for (y, w), (gain, frequency, damping), mass in self._pairs(state):
            pushed = accelerated(y, w, voltage.level * gain, frequency, damping) + force * (1.0 / mass)
            rates += [w, pushed]
        return tuple(rates)

    def platform(self, state: tuple[N, ...]) -> tuple[N, N]:
        return sum(state[2::2], state[0]), sum(state[3::2], state[1])

    def acceleration(self, state: Terms, voltage: Voltage[Term]) -> Term:
        total: Any = 0.0
        for (y, w), (gain, frequency, damping), _ in self._pairs(state):
            total = accelerated(y, w, voltage.level * gain, frequency, damping) + total
        return total

    def steady(self, state: State, segment: Segment, t_local: ScalarLike, force: ScalarLike) -> State:
        found = []
        for _, mode, mass in self._pairs(self.initial()):
            y, w = tends_to(*mode, segment, t_local)
            found += [y + force / (mass * mode[1] ** 2), w]
        return tuple(found)

    def motion(self, state: State, segment: Segment, t_local: ScalarLike, elapsed: ScalarLike) -> State:
        moved = []
        for (y, w), mode, _ in self._pairs(state):
            y0, w0 = forced(*mode, segment, t_local)
            y1, w1 = forced(*mode, segment, t_local + elapsed)
            free, speed = damped(y - y0, w - w0, *mode[1:], elapsed)
            moved += [y1 + free, w1 + speed]
        return tuple(moved)

    def error_scale(self) -> State:
        lengths = []
        for frequency in self.modes.natural_frequency:
            lengths += [jnp.ones(()), 1.0 / frequency]
        return tuple(lengths)

    def static_gain(self) -> Scalar:
        return jnp.sum(self.modes.gain)

    def frequency_scale(self) -> Scalar:
        # That of the mode that moves the platform: the others are over before it has begun to.
        return self.modes.natural_frequency[0]

    def _pairs(self, state: tuple[N, ...]) -> list[tuple[tuple[N, N], tuple[Scalar, Scalar, Scalar], Scalar]]:
        """For each mode its (y, w), its (gain, frequency, damping), and its mass."""
        kept = self.modes
        return [
            (
                (state[2 * j], state[2 * j + 1]),
                (kept.gain[j], kept.natural_frequency[j], kept.damping_ratio[j]),
                kept.mass[j],
            )
            for j in range(self.count)
        ]
