"""A hybrid system as its author writes it: a vector field, guards that end a mode, and what follows an event."""

import abc
from collections.abc import Sequence
from typing import TypeAlias

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Count, Scalar, Tree

Mode: TypeAlias = int | Count
"""A whole number from 0 on, which may be traced."""


class HybridSystem(eqx.Module):
    """A motion that is smooth within each of its modes, and what ends a mode; `integrate` solves it.

    Derive from it and write `vector_field`; a system with events adds `guards` and `after_event`.  Time, state and
    arguments have whatever units you choose.  The state is a pytree of floating-point arrays, the same in every mode;
    a mode is a whole number from 0 on, which may be traced (choose with `jnp.where` or `lax.switch`).  Derivatives can
    be taken by every floating-point leaf of the system, of the arguments and of the first state.

    ```python
    import jax.numpy as jnp
    from pdssjax.integration import HybridSystem, integrate


    class Ball(HybridSystem):
        def vector_field(self, t, y, args, mode):
            return y[1], -args["gravity"]

        def guards(self, t, y, args, mode):
            return y[0]

        def after_event(self, t, y, args, mode, which):
            return (jnp.zeros(()), -args["restitution"] * y[1]), mode


    args = {"gravity": 9.81, "restitution": 0.7}
    solution = integrate(Ball(), 0.0, 1.5, (0.8, 0.0), args, saveat=jnp.linspace(0.0, 1.5, 40))
    solution.ys[0], solution.events.ts[:3]
    ```
    """

    @abc.abstractmethod
    def vector_field(self, t: Scalar, y: Tree, args: Tree, mode: Count) -> Tree:
        """Give the time derivative of `y`, a pytree like it, in its units over that of the time.

        It is smooth inside a mode and between corners.
        """

    def guards(
        self, t: Scalar, y: Tree, args: Tree, mode: Count
    ) -> Scalar | Sequence[Scalar] | Float[Array, " guards"]:
        """Give numbers of any scale that are positive inside `mode`: it ends where the first falls through zero.

        As many in every mode; give 1.0 for one that cannot end this mode.  None by default.
        """
        return ()

    def after_event(self, t: Scalar, y: Tree, args: Tree, mode: Count, which: Count) -> tuple[Tree, Mode]:
        """Give the state and the mode after guard number `which`, from 0 on, has fallen through zero.

        No guard may be negative there, but for rounding.
        """
        raise NotImplementedError(f"{type(self).__name__} has guards, but no `after_event` to say what follows.")

    def corners(self, args: Tree) -> Float[Array, " corners"]:
        """Give the ascending times, in the unit of the time, at which the field jumps or bends: a step ends there.

        None by default.  Just before a corner the field is asked for times below it, from it on for times above, so
        that `jnp.where(t < corner, ...)` is right.
        """
        return jnp.zeros(0)

    def after_corner(self, t: Scalar, y: Tree, args: Tree, mode: Count, which: Count) -> tuple[Tree, Mode]:
        """Give the state and the mode after corner number `which`, from 0 on; by default nothing changes."""
        return y, mode
