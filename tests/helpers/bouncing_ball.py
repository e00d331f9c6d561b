"""A ball under gravity, as a user writes it."""

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
