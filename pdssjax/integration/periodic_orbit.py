"""Periodic orbits by Newton's method on the cycle map, and how fast motions near them die out.

Let P be the map of the state at the opening of a period to that at the opening of the next, without the components
that nothing depends on (where the end-effector is: its multiplier is 1, and what it gains is the drift).  A periodic
orbit is a fixed point z = P(z); with the monodromy M = dP/dz, from the linearised steps, saltation included,

    z <- z + (I - M)^-1 (P(z) - z),        dz/dp = (I - M)^-1 dP/dp

and the eigenvalues of M are its Floquet multipliers: it attracts where all lie inside the unit circle
(R. I. Leine and H. Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems, Springer 2004).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from ..core import Count, Scalar, ScalarLike
from .accuracy import Accuracy
from .restart import flat, restarted
from .solution import sample_run
from .system import AbstractHybridSystem, unflattener
from .tracing import traced_once, zeros_of

SHORT = 1e-10
"""A cycle ends this part of a period early, so that the corner there belongs to the next period.

Segments add up to a period but for rounding, a thousand of them to 1e-10 of one.
"""

CONFIRMED = 2
"""How often in a row a motion has to repeat."""

_LOOKS = 10
"""Iterations of Newton's method at most."""


class Orbit(NamedTuple):
    """A motion that repeats, or nearly."""

    x: Float[Array, " components"]
    """The state at the opening of a period, just before its corner."""
    end: Float[Array, " components"]
    """The state at the opening of the period after which it repeats."""
    monodromy: Float[Array, "components components"]
    """Derivative of `end` by `x`."""
    distance: Scalar
    """Distance [m] between the two, but for the drift."""
    looks: Count
    """How often a cycle was integrated and linearised."""
    confirmed: Count
    """How often in a row the distance was below the tolerance, each time from the end of the last cycle."""
    failure: Count
    """Index into `accuracy.FAILURES`; 0 where the integration went well."""


def newton_orbit(
    system: AbstractHybridSystem,
    x: Float[Array, " components"],
    duration: ScalarLike,
    accuracy: Accuracy,
    tolerance: ScalarLike,
    count: ScalarLike,
) -> Orbit:
    """The periodic orbit near the state `x` at the opening of a period, which takes `duration` [s].

    **Arguments:** it repeats after `count` periods, to within `tolerance` [m], and once more from the end of those.
    After `_LOOKS` iterations, or a failed run, it is the last one: `confirmed` says how good it is.  No derivatives:
    see `refined`.
    """
    system = lax.stop_gradient(system)
    unflatten = unflattener(system)

    @traced_once
    def linearised_cycle(x: Float[Array, " components"]) -> Orbit:
        reach = lambda x: cycle_end(system, x, duration, accuracy, count)
        monodromy, (end, failure) = jax.jacfwd(lambda x: (reach(x)[0], reach(x)), has_aux=True)(x)
        distance = system.state_distance(unflatten(list(end)), unflatten(list(x)))
        return Orbit(x, end, monodromy, distance, jnp.zeros((), int), jnp.zeros((), int), failure)

    def iterate(orbit: Orbit) -> Orbit:
        near = orbit.confirmed > 0
        found = linearised_cycle(jnp.where(near, orbit.end, orbit.x + _newton_step(system, orbit)))
        confirmed = jnp.where(found.distance < tolerance, orbit.confirmed + 1, 0)
        return found._replace(looks=orbit.looks + 1, confirmed=confirmed)

    goes_on = lambda orbit: (orbit.confirmed < CONFIRMED) & (orbit.looks < _LOOKS) & (orbit.failure == 0)
    # The first iteration takes a step of length zero.
    begin = lax.stop_gradient(x)
    return lax.while_loop(goes_on, iterate, zeros_of(linearised_cycle, begin)._replace(x=begin, end=begin))


def refined(
    system: AbstractHybridSystem, orbit: Orbit, duration: ScalarLike, accuracy: Accuracy, count: ScalarLike
) -> tuple[Float[Array, " components"], Float[Array, " components"]]:
    """The state at the opening of a period of an `orbit`, and its net shift until the motion repeats.

    Both are differentiable in every floating-point leaf of `system` and in `duration` [s]: by one more step of
    Newton's method, which changes values by rounding alone.
    """
    orbit = lax.stop_gradient(orbit)
    end, _ = cycle_end(system, orbit.x, duration, accuracy, count)
    step = _newton_step(system, orbit._replace(end=end))
    return orbit.x + step, end + orbit.monodromy @ step - orbit.x - step


def multipliers(system: AbstractHybridSystem, orbit: Orbit) -> Float[Array, " components"]:
    """The moduli of the Floquet multipliers of an `orbit`, the largest first; zero for what nothing depends on.

    On a CPU only, as the eigenvalues of general matrices are in JAX.
    """
    reduced = _reduced(system, orbit.monodromy)
    known = jnp.where(jnp.isfinite(reduced), reduced, 0.0)
    moduli = jnp.sort(jnp.abs(jnp.linalg.eigvals(lax.stop_gradient(known))))[::-1]
    return jnp.where(jnp.isfinite(reduced).all(), moduli, jnp.nan)


def cycle_end(
    system: AbstractHybridSystem,
    x: Float[Array, " components"],
    duration: ScalarLike,
    accuracy: Accuracy,
    count: ScalarLike,
) -> tuple[Float[Array, " components"], Count]:
    """Where the state `x` at the opening of a period is `count` periods later, and the failure on the way.

    Differentiable in `system`, `x` and `duration` [s].
    """
    duration = jnp.asarray(duration, float) * count
    horizon, from_x = duration * (1.0 - SHORT), restarted(system, x)
    run = sample_run(from_x, jnp.zeros(0), accuracy, keep=(0,), horizon=horizon)
    # The rest of the period, in value and in derivative: the end of the last step shifts with the events.
    end = lax.stop_gradient(run.end)
    segment = from_x.segment(end.index)
    rate = flat(system.rates(segment, end.t_local, unflattener(system)(list(end.x)), end.mode))
    return run.end.x + lax.stop_gradient(rate) * (duration - run.end.time), run.failure


def moved_orbit(
    system: AbstractHybridSystem,
    monodromy: Float[Array, "components components"],
    driven: Float[Array, "components *directions"],
) -> Float[Array, "components *directions"]:
    """(I - M)^-1 `driven` in the components that something depends on, zero in the others.

    If `driven` is the derivative of a cycle's end by a parameter, this is the derivative of the orbit.
    """
    deviates = _deviates(system, monodromy)
    away = jnp.where(deviates.reshape(-1, *(1,) * (driven.ndim - 1)), driven, 0.0)
    return jnp.linalg.solve(jnp.eye(len(deviates)) - _reduced(system, monodromy), away)


def _deviates(
    system: AbstractHybridSystem, monodromy: Float[Array, "components components"]
) -> Bool[Array, " components"]:
    """Which components can deviate from the orbit: something depends on them, and a cycle changes them.

    A flag (in contact, sliding fast) that a cycle leaves alone has a derivative of 1 by itself and none by anything
    else.  It takes no part in whether deviations die out.
    """
    shifts = jnp.array([i in system.shifting_components() for i in range(monodromy.shape[0])])
    return ~shifts & ~(monodromy == jnp.eye(monodromy.shape[0])).all(axis=1)


def _reduced(
    system: AbstractHybridSystem, monodromy: Float[Array, "components components"]
) -> Float[Array, "components components"]:
    """The monodromy matrix with zeros in the rows and columns of components that do not deviate."""
    deviates = _deviates(system, monodromy)
    return jnp.where(deviates[:, None] & deviates[None, :], monodromy, 0.0)


def _newton_step(system: AbstractHybridSystem, orbit: Orbit) -> Float[Array, " components"]:
    """(I - M)^-1 (P(z) - z) in the components that something depends on, zero in the others."""
    return moved_orbit(system, orbit.monodromy, orbit.end - orbit.x)
