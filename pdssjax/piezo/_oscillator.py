"""A second-order system under a segment of voltage, in closed form.

    y'' + 2 xi w y' + w^2 y = C w^2 u

On a straight piece u = u0 + k s it tends to y = C (u - 2 xi k / w); a harmonic of the
voltage adds its own response; what is left of the initial state decays as the free oscillation does.
"""

import jax.numpy as jnp

from ..core import Scalar, ScalarLike
from ..drive.base import Segment
from ..integration import Term


def tends_to(
    gain: ScalarLike, frequency: ScalarLike, damping: ScalarLike, segment: Segment, t_local: ScalarLike
) -> tuple[Scalar, Scalar]:
    """Displacement [m] and velocity [m/s] to which the system tends, `t_local` [s] into a straight segment."""
    delay = 2.0 * damping / frequency
    return gain * (segment.start + segment.slope * (t_local - delay)), gain * segment.slope


def forced(
    gain: ScalarLike, frequency: ScalarLike, damping: ScalarLike, segment: Segment, t_local: ScalarLike
) -> tuple[Scalar, Scalar]:
    """Displacement [m] and velocity [m/s] that a segment forces, its harmonic included, without the transient."""
    y, w = tends_to(gain, frequency, damping, segment, t_local)
    if segment.wave is None:
        return y, w
    amplitude, rate, phase = segment.wave
    ratio = rate / frequency
    stiff, lossy = 1.0 - ratio**2, 2.0 * damping * ratio
    size = gain * amplitude / (stiff**2 + lossy**2)
    cosine, sine = jnp.cos(rate * t_local + phase), jnp.sin(rate * t_local + phase)
    return (
        y + size * (stiff * cosine + lossy * sine),
        w + size * rate * (lossy * cosine - stiff * sine),
    )


def underdamped(
    y: Scalar, w: Scalar, frequency: ScalarLike, damping: ScalarLike, elapsed: ScalarLike
) -> tuple[Scalar, Scalar]:
    """The free motion `elapsed` [s] after displacement y [m] and velocity w [m/s]; damping ratio below 1."""
    decay = damping * frequency
    ring = frequency * jnp.sqrt(1.0 - damping**2)
    b = (w + decay * y) / ring
    fade = jnp.exp(-decay * elapsed)
    c, s = fade * jnp.cos(ring * elapsed), fade * jnp.sin(ring * elapsed)
    oscillation = y * c + b * s
    return oscillation, -decay * oscillation + ring * (b * c - y * s)


def damped(
    y: Scalar, w: Scalar, frequency: ScalarLike, damping: ScalarLike, elapsed: ScalarLike
) -> tuple[Scalar, Scalar]:
    """The free motion as above, for any damping ratio.

    With z = (xi^2 - 1)(w t)^2 the fundamental solutions are e^(-xi w t) times C = cos or cosh and
    S = sin or sinh of sqrt|z|, over it; both are even, so that nothing happens at xi = 1.
    """
    decay = damping * frequency
    square = (damping**2 - 1.0) * frequency**2
    z = square * elapsed**2
    near = jnp.abs(z) < 1e-3
    under = jnp.sqrt(jnp.where(near | (z > 0.0), 1.0, -z))
    over = jnp.sqrt(jnp.where(near | (z < 0.0), 1.0, z))
    middle = jnp.where(near, z, 0.0)
    fade = jnp.exp(-decay * elapsed)
    # The slow root of an overdamped system, free of cancellation.
    slow = jnp.exp(-((frequency * elapsed) ** 2) / (decay * elapsed + over))
    fast = jnp.exp(-decay * elapsed - over)
    grown = z > 0.0
    c = jnp.where(grown, 0.5 * (slow + fast), fade * jnp.cos(under))
    s = jnp.where(grown, 0.5 * (slow - fast) / over, fade * jnp.sin(under) / under)
    c = jnp.where(near, fade * (1.0 + middle * (1.0 / 2 + middle * (1.0 / 24 + middle / 720))), c)
    s = jnp.where(near, fade * (1.0 + middle * (1.0 / 6 + middle * (1.0 / 120 + middle / 5040))), s)
    push = w + decay * y
    moved = y * c + push * elapsed * s
    return moved, push * c + y * square * elapsed * s - decay * moved


def accelerated(y: Term, w: Term, drives: Term, frequency: ScalarLike, damping: ScalarLike) -> Term:
    """y'' [m/s2] at displacement y and velocity w where `drives` is C u [m]; numbers or series."""
    return frequency * (frequency * (drives - y) - 2.0 * damping * w)
