"""The piezo stack as a fixed-free rod that carries the platform at its end (thesis, 4.3-4.13).

A visco-elastic rod (Kelvin-Voigt, 4.4) of length L, cross-section A and mass m = rho A L is
clamped at y = 0 and carries the platform, a mass M, at y = L.  The voltage u strains every
element of the rod by s u, if nothing holds it:

    rho v_tt = E v_yy + eta v_yyt                                     (4.5)
    v(0, t) = 0                                                       (4.6)
    A (E (v_y - s u) + eta v_yt) = -M v_tt   at y = L                 (4.7, with the strain of the voltage)

It moves in the modes sin(x_j y / L), whose roots x_j = p_j L solve, with the mass ratio r = M / m,

    r x tan x = 1                                                     (4.10)

    w_j = x_j sqrt(E / rho) / L,   xi_j = eta w_j / (2 E)             (below 4.12)

and the tip moves as the sum of second-order systems with gains g_j (4.11, 4.12).  Two
readings of the gains are offered, by the field `excitation`:

- `strain` projects the equations above on the modes.  By (4.10), sin^2 x = 1 / (1 + r^2 x^2), so
  that a force at the tip sees the modal mass m_j and the gain is what that mass makes of E A s:

      m_j = m (1 + r + r^2 x_j^2) / 2,   g_j = E A s / (m_j w_j^2) = 2 s L / (x_j^2 (1 + r + r^2 x_j^2))

  The gains are positive, fall with the fourth power of j, and sum to s L, the displacement at rest.
- `equal` is the thesis's: one coefficient D in every mode, so g_j = H sin x_j with one H, here the
  one that gives the first mode its gain above.  The gains alternate in sign and fall with the
  first power of j only: they are not what (4.5)-(4.7) make of any finite load, and overstate
  the modes left out by far.

Keeping the first n modes leaves out the rest of the sum: (4.13), `truncation_error`.
"""

import math
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.typing import ArrayLike
from jaxtyping import Array, Complex, Float

from ..core import AbstractModel, Choice, Count, InputError, Scalar, ScalarLike, Truth, choice, quantity


class Rod(AbstractModel):
    """Stack and platform; nominal values have the first mode that the thesis's step tests gave (section 4.4).

    The stack's data are 5 x 5 x 20 mm and 8000 kg/m3; modulus, viscosity and strain follow from
    6527 rad/s, 0.2083 and 0.098 um/V at a mass ratio of 138.8.  The modulus is less than half of a
    piezo ceramic's, since it stands for the compliance of the mounting too.
    """

    modulus: float = quantity(1.8967e10, "Pa")
    """Young's modulus E [Pa]."""
    viscosity: float = quantity(1.2106e6, "Pa*s")
    """Viscosity eta [Pa s] of the Kelvin-Voigt material (4.4)."""
    density: float = quantity(8000.0, "kg/m**3")
    """Density rho [kg/m3]."""
    length: float = quantity(0.02, "m")
    """Length L [m]."""
    area: float = quantity(25e-6, "m**2")
    """Cross-section A [m2]."""
    strain: float = quantity(4.897e-6, "1/V", positive=False)
    """Strain per volt s [1/V] of the unloaded stack; negative if it contracts."""
    platform_mass: float = quantity(0.5552, "kg", positive=False, low=0.0)
    """Mass M [kg] that the tip carries; may be 0."""
    excitation: Choice = choice({"strain": 0.0, "equal": 1.0})
    """How the voltage drives the modes: `strain` (the default) or `equal`, see above."""

    @property
    def mass(self) -> Float[Array, ""]:
        """Mass of the stack m [kg]."""
        return jnp.asarray(self.density * self.area * self.length, float)

    @property
    def mass_ratio(self) -> Float[Array, ""]:
        """Platform to stack, M / m [1]."""
        return self.platform_mass / self.mass

    @property
    def static_gain(self) -> Float[Array, ""]:
        """Displacement of the tip at rest [m/V], s L: no force is left then, so neither M nor E matters."""
        return jnp.asarray(self.strain * self.length, float)


class Modes(eqx.Module):
    """The first n modes as the tip sees them."""

    root: Float[Array, " n"]
    """x_j = p_j L [1], a root of (4.10)."""
    natural_frequency: Float[Array, " n"]
    """Undamped natural frequency w_j [rad/s]."""
    damping_ratio: Float[Array, " n"]
    """Damping ratio xi_j [1]; it grows with the frequency, and high modes do not oscillate."""
    gain: Float[Array, " n"]
    """Displacement of the tip at rest per volt g_j [m/V]."""
    mass: Float[Array, " n"]
    """Modal mass m_j [kg] that a force at the tip sees: F / m_j drives the mode's share of the tip."""


def modes(rod: Rod, count: int) -> Modes:
    """The first `count` modes, by rising frequency; differentiable in every number of the rod.

    **Raises:** `InputError` if `count` is below 1.
    """
    ratio = rod.mass_ratio
    root = roots(ratio, count)
    frequency = root * jnp.sqrt(rod.modulus / rod.density) / rod.length
    heaviness = 1.0 + ratio + (ratio * root) ** 2
    projected = 2.0 * rod.static_gain / (root**2 * heaviness)
    tip = _tip(ratio, root)
    equal = projected[0] * tip / tip[0]
    return Modes(
        root=root,
        natural_frequency=frequency,
        damping_ratio=rod.viscosity * frequency / (2.0 * rod.modulus),
        gain=jnp.where(rod.excitation > 0.5, equal, projected),
        mass=rod.mass * heaviness / 2.0,
    )


def roots(mass_ratio: ScalarLike, count: int) -> Float[Array, " count"]:
    """The first `count` roots x = p L of r x tan x = 1 (4.10), to rounding; differentiable in `mass_ratio` >= 0.

    A negative ratio gives NaN.

    **Raises:** `InputError` if `count` is below 1.
    """
    if count < 1:
        raise InputError(f"Expected at least one mode, but got {count}.")
    ratio = jnp.asarray(mass_ratio, float)
    return _roots(count, jnp.where(ratio >= 0.0, ratio, jnp.nan))


@jax.custom_jvp
def _root(start: Scalar, ratio: Scalar) -> Scalar:
    """The root in [start, start + pi/2], by Newton's method kept within that bracket.

    (4.10) reads x - start = arctan(1 / (r x)) there.  The difference of its sides rises and is
    concave, so that Newton's method climbs to the root from the left, whatever the start.
    """

    def improve(state: tuple[Scalar, Scalar, Count]) -> tuple[Scalar, Scalar, Count]:
        x, _, step = state
        slope = 1.0 + ratio / (1.0 + (ratio * x) ** 2)
        new = jnp.clip(x - (x - start - jnp.arctan2(1.0, ratio * x)) / slope, start, start + math.pi / 2)
        return new, jnp.abs(new - x), step + 1

    def unfinished(state: tuple[Scalar, Scalar, Count]) -> Truth:
        x, change, step = state
        return (change > 2.0 * jnp.finfo(x.dtype).eps * x) & (step < 100)

    guess = jnp.where(start > 0.0, start, 0.0) + jnp.where(
        start > 0.0, jnp.arctan2(1.0, ratio * (start + 0.5)), 1.0 / jnp.sqrt(ratio + 4.0 / math.pi**2)
    )
    return lax.while_loop(unfinished, improve, (guess, jnp.full_like(guess, jnp.inf), jnp.zeros((), int)))[0]


@_root.defjvp
def _root_tangent(primals: tuple[Scalar, Scalar], tangents: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
    """The implicit function theorem on x - start - arctan(1 / (r x)) = 0."""
    start, ratio = primals
    x = _root(start, ratio)
    fall = 1.0 / (1.0 + (ratio * x) ** 2)
    return x, (tangents[0] - x * fall * tangents[1]) / (1.0 + ratio * fall)


@partial(jax.jit, static_argnums=0)
def _roots(count: int, ratio: Scalar) -> Float[Array, " count"]:
    return jax.vmap(_root, in_axes=(0, None))(math.pi * jnp.arange(count, dtype=ratio.dtype), ratio)


def _tip(ratio: Scalar, root: Float[Array, " n"]) -> Float[Array, " n"]:
    """sin x_j at the roots of (4.10), free of the cancellation in sin(x) near a multiple of pi."""
    sign = jnp.where(jnp.arange(len(root)) % 2 == 0, 1.0, -1.0)
    return sign / jnp.sqrt(1.0 + (ratio * root) ** 2)


def shapes(rod: Rod, count: int, positions: Float[ArrayLike, " points"]) -> Float[Array, "count points"]:
    """The modes sin(p_j y) at the `positions` y [m] from the clamped end, scaled to 1 at the tip."""
    root = roots(rod.mass_ratio, count)
    return jnp.sin(root[:, None] * jnp.asarray(positions) / rod.length) / _tip(rod.mass_ratio, root)[:, None]


@jax.jit
def mode_responses(modes: Modes, voltage: ScalarLike, times: Float[ArrayLike, " times"]) -> Float[Array, "n times"]:
    """Each mode's share [m] of the tip's displacement after a step of `voltage` [V] at t = 0, at `times` [s]."""
    step = jax.vmap(_unit_step, in_axes=(0, 0, None))
    return modes.gain[:, None] * voltage * step(modes.natural_frequency, modes.damping_ratio, jnp.asarray(times))


def step_response(modes: Modes, voltage: ScalarLike, times: Float[ArrayLike, " times"]) -> Float[Array, " times"]:
    """Displacement of the tip [m] after a step of `voltage` [V] at t = 0, at `times` [s]; 0 before it."""
    return mode_responses(modes, voltage, times).sum(axis=0)


def truncation_error(
    rod: Rod, kept: int, voltage: ScalarLike, times: Float[ArrayLike, " times"], among: int = 200
) -> Float[Array, " times"]:
    """What keeping the first `kept` modes leaves out [m] (4.13), for a step of `voltage` [V] at t = 0, at `times` [s].

    It is the sum of the modes kept + 1 to `among`.  With `strain` the modes beyond hold 0.007 /
    (r^2 among^3) of the displacement (0.2 / among without a platform).  With `equal` the sum
    converges like 1 / among only, and without a platform it does not converge at all.

    **Raises:** `InputError` if `kept` is negative or not below `among`.
    """
    return mode_responses(_dropped_modes(rod, kept, among), voltage, times).sum(axis=0)


def truncation_transfer(
    rod: Rod, kept: int, frequency: Float[ArrayLike, " frequencies"], among: int = 200
) -> Complex[Array, " frequencies"]:
    """E(s) / U(s) [m/V] of (4.13) on the imaginary axis: s = i `frequency`, in rad/s.

    **Raises:** as `truncation_error`.
    """
    left = _dropped_modes(rod, kept, among)
    turn = jnp.asarray(frequency) / left.natural_frequency[:, None]
    return (left.gain[:, None] / (1.0 - turn**2 + 2j * left.damping_ratio[:, None] * turn)).sum(axis=0)


def modes_needed(
    rod: Rod, error: float, voltage: float, times: Float[ArrayLike, " times"] | None = None, among: int = 200
) -> int:
    """The smallest number of modes whose truncation error stays within `error` [m] at all `times`.

    **Arguments:** the drive is a step of `voltage` [V] at t = 0.  Without `times` [s], 2000 of
    them are spread from well within the fastest of the `among` modes to well after the slowest.
    More modes than those returned keep within `error` too.

    **Raises:** `InputError` if `error` is not positive, or not even `among` - 1 modes are enough.
    """
    if not error > 0.0:
        raise InputError(f"Expected a positive error [m], but got {error!r}.")
    every = modes(rod, among)
    responses = np.asarray(mode_responses(every, voltage, _moments(every) if times is None else times))
    left_out = np.cumsum(responses[::-1], axis=0)[::-1]
    peaks = np.abs(left_out).max(axis=1)[1:]
    excessive = np.flatnonzero(~(peaks <= error))
    needed = int(excessive[-1]) + 2 if excessive.size else 1
    if needed >= among:
        raise InputError(
            f"Expected an error of {peaks[-1]:.3g} m or more, what {among - 1} modes can keep, but got {error!r}."
        )
    return needed


def _dropped_modes(rod: Rod, kept: int, among: int) -> Modes:
    if not 0 <= kept < among:
        raise InputError(f"Expected a number of kept modes from 0 to {among - 1}, but got {kept}.")
    return jax.tree.map(lambda array: array[kept:], modes(rod, among))


def _moments(modes: Modes) -> Float[np.ndarray, " times"]:
    """Times [s] that show every mode's rise and the slowest one's end."""
    frequency, damping = np.asarray(modes.natural_frequency), np.asarray(modes.damping_ratio)
    # The slow root of an overdamped mode is near w / (2 xi).
    slowest = np.min(frequency * np.minimum(damping, 0.5 / damping))
    return np.geomspace(0.1 / frequency[-1], 10.0 / slowest, 2000)


def _unit_step(frequency: Scalar, damping: Scalar, time: Float[Array, " times"]) -> Float[Array, " times"]:
    """Response of w^2 / (s^2 + 2 xi w s + w^2) to a unit step at t = 0, for any damping ratio xi > 0.

    With z = (xi^2 - 1) (w t)^2 and a = xi w t it is 1 - e^-a (C(z) + a S(z)), where C is cosh of
    sqrt(z) (cos where z < 0) and S is sinh of sqrt(z) over sqrt(z); a power series near z = 0,
    and above it a form in decaying exponentials alone.
    """
    turn = frequency * jnp.maximum(time, 0.0)
    z = (damping**2 - 1.0) * turn**2
    a = damping * turn
    near = jnp.abs(z) < 0.05
    under = jnp.sqrt(jnp.where(near | (z > 0.0), 1.0, -z))
    over = jnp.sqrt(jnp.where(near | (z < 0.0), 1.0, z))
    middle = jnp.where(near, z, 0.0)
    slow = turn**2 / (a + over)
    series = _even_series(middle, 0) + a * _even_series(middle, 1)
    oscillating = jnp.cos(under) + a * jnp.sin(under) / under
    creeping = jnp.exp(-slow) * (1.0 - slow * jnp.expm1(-2.0 * over) / (2.0 * over))
    return 1.0 - jnp.where(z > 0.05, creeping, jnp.exp(-a) * jnp.where(near, series, oscillating))


def _even_series(z: Float[Array, " times"], first: int) -> Float[Array, " times"]:
    """Sum of z^k / (2 k + first)!, to rounding for |z| < 0.05."""
    total = jnp.zeros_like(z)
    for k in reversed(range(7)):
        total = total * z + 1.0 / math.factorial(2 * k + first)
    return total
