"""A ball under gravity, as a user writes it."""

import jax
import jax.numpy as jnp

from pdssjax.integration import HybridSystem


class BouncingBall(HybridSystem):
    """Falls, and bounces off the floor."""

    def vector_field(self, t, y, args, mode):
        return y[1], -args["gravity"]

    def guards(self, t, y, args, mode):
        return y[0]

    def after_event(self, t, y, args, mode, which):
        return (jnp.zeros(()), -args["restitution"] * y[1]), mode


def free_fall(parameters, times, impacts=3):
    """Height and speed up to the last of the impacts, and their times, from the law of free fall."""
    height, gravity, restitution = parameters
    first = jnp.sqrt(2.0 * height / gravity)
    flights = 2.0 * first * restitution ** jnp.arange(1, impacts + 1)
    struck = first + jnp.concatenate([jnp.zeros(1), jnp.cumsum(flights)])
    number = jnp.searchsorted(jax.lax.stop_gradient(struck), times, side="right")
    since = times - jnp.where(number == 0, 0.0, struck[number - 1])
    speed = jnp.where(number == 0, 0.0, gravity * first * restitution**number)
    start = jnp.where(number == 0, height, 0.0)
    return jnp.stack([start + speed * since - 0.5 * gravity * since**2, speed - gravity * since]), struck[:impacts]
