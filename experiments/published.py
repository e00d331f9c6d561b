"""What the thesis publishes of the actuator's performance, and the model that it publishes, in SI units.

Table 3.1, figures 3.7 to 3.11 and section 2.4 say how the actuator and its surfaces performed, section 5.4
with which parameters the model is to represent that.  The experiments on performance set the two beside
each other.

Of the isotropic surfaces the thesis identified nothing.  They came out of the same process, but etched
straight down (section 3.4), so the mean of the anisotropic ones' two directions stands in for them,
parameter by parameter.  They are computed with the anisotropic law, both directions alike: there the two
readings of (5.22) agree, and one compiled function does for both surfaces.
"""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp

from pdssjax import Actuator
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.friction.anisotropic_lugre import AnisotropicLuGre
from pdssjax.piezo.second_order import SecondOrder

Reading = Literal["deflection", "force"]
READINGS: tuple[Reading, ...] = ("deflection", "force")
"""Of (5.22)."""

VOLTAGE = 64.0
"""Peak of the sawtooth [V]."""
FREQUENCIES = (5.0, 20.0)
"""Of the sawtooth [Hz]."""
ANISOTROPIC, ISOTROPIC = "anisotropic", "isotropic"


class Walk(NamedTuple):
    """One of the four walks of table 3.1."""

    name: str
    surface: str
    direction: float
    """1 forward (A), -1 backward (B)."""
    efficiency: float
    """Table 3.1, as a fraction."""
    speed: float | None
    """Of the end-effector (section 3.4) [m/s]."""


WALKS = (
    Walk("AF, direction A", ANISOTROPIC, 1.0, 0.5065, 16.0e-6),
    Walk("AF, direction B", ANISOTROPIC, -1.0, 0.2172, None),
    Walk("IF, direction A", ISOTROPIC, 1.0, 0.3261, 10.0e-6),
    Walk("IF, direction B", ISOTROPIC, -1.0, 0.3295, None),
)
"""All at 64 V and 5 Hz."""


class Push(NamedTuple):
    """One of the four maximum forces of figure 3.11, read in section 3.6; direction A."""

    name: str
    surface: str
    frequency: float
    """[Hz]"""
    force: float
    """[N]"""


PUSHES = (
    Push("IF, 5 Hz", ISOTROPIC, 5.0, 0.409),
    Push("AF, 5 Hz", ANISOTROPIC, 5.0, 0.435),
    Push("IF, 20 Hz", ISOTROPIC, 20.0, 0.429),
    Push("AF, 20 Hz", ANISOTROPIC, 20.0, 0.475),
)

COEFFICIENTS = (0.495, 0.432)
"""Of friction in ball-on-disk tests, in direction A and in direction B (section 2.4)."""
TEST_LOAD = 5.0
"""Normal force in these tests [N]."""

STROKE = SecondOrder().gain * VOLTAGE
"""C V, how far the platform goes [m]."""


def law(surface: str, reading: Reading = "deflection") -> AnisotropicLuGre:
    """The friction of a surface with the parameters of section 5.4.1, or their mean of a and b."""
    law = AnisotropicLuGre(state=reading)
    if surface == ANISOTROPIC:
        return law
    sigma0, sigma1, f_ss = (
        0.5 * (a + b) for a, b in ((law.sigma0_a, law.sigma0_b), (law.sigma1_a, law.sigma1_b), (law.f_ss_a, law.f_ss_b))
    )
    return AnisotropicLuGre(sigma0, sigma0, sigma1, sigma1, f_ss, f_ss, state=reading)


def walking(walk: Walk, reading: Reading) -> tuple[Actuator, Sawtooth]:
    """Actuator and drive of one entry of table 3.1, with an ideal sawtooth."""
    actuator = Actuator(SecondOrder(), law(walk.surface, reading))
    return actuator, Sawtooth(voltage=VOLTAGE, frequency=5.0, direction=walk.direction)


def stacked(cases: Sequence[Any]) -> Any:
    """Models of one structure as one model whose leaves have a first axis, for `lax.map` and `vmap`."""
    return jax.tree.map(lambda *leaves: jnp.stack([jnp.asarray(leaf, float) for leaf in leaves]), *cases)
