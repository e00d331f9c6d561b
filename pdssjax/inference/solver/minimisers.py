"""Other least-squares solvers of optimistix in place of the package's own.

They know no bounds.  Where a parameter has both, it is the mean of them plus half their distance times a sine; with
one it is the bound plus or minus sqrt(z^2 + 1) - 1 (F. James and M. Roos, Computer Physics Communications 10, 343,
1975).  What is held is not given to them at all.
"""

from typing import Any, TypeAlias

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from ...core import InputError, Tree
from .levenberg_marquardt import BoundedLevenbergMarquardt, ResidualFunction
from .lm_state import Vector

Minimiser: TypeAlias = optx.AbstractLeastSquaresSolver[Any, Any, Any, Any]
"""Whatever its own state is."""

_INSIDE = 1e-6
"""A start on a bound, where the sine has no slope, is moved inwards by this share of the distance."""


def check_minimiser(given: object) -> None:
    """**Raises** `InputError` for what is given and no least-squares solver of optimistix."""
    if given is not None and not isinstance(given, optx.AbstractLeastSquaresSolver):
        raise InputError(
            f"minimiser: found {given!r:.80}, expected a least-squares solver of optimistix, such as "
            "optimistix.Dogleg(rtol=1e-8, atol=1e-8)."
        )


def minimised(
    minimiser: Minimiser,
    residual: ResidualFunction,
    point: Float[np.ndarray, " p"],
    args: Tree,
    options: dict[str, Float[np.ndarray, " p"]],
    limit: int,
) -> tuple[Float[np.ndarray, " p"], int, str]:
    """Where `minimiser` ends from `point` within the bounds of `options`, after how many steps, and why in words.

    It takes `limit` steps at most.
    """
    low, high = options["lower"], options["upper"]
    free = np.flatnonzero(low < high)
    point = np.clip(np.asarray(point, float), low, high)
    begin = _Bounded(jnp.asarray(low[free]), jnp.asarray(high[free]))
    fn = _Inserted(residual, jnp.asarray(point), jnp.asarray(free), begin)
    if isinstance(minimiser, BoundedLevenbergMarquardt):
        found = _run(minimiser, residual, jnp.asarray(point), args, options, limit)
        end = np.asarray(found.value)
    else:
        found = _run(minimiser, fn, begin.unbounded(jnp.asarray(point[free])), args, {"jac": "fwd"}, limit)
        end = np.asarray(fn.point(found.value))
    message = optx.RESULTS[found.result] or "converged by its own tests"
    ended = f"{type(minimiser).__name__} ended ({message})"
    return np.where(np.isfinite(end), end, point), int(found.stats["num_steps"]), ended


@eqx.filter_jit
def _run(minimiser: Minimiser, fn: Tree, y: Tree, args: Tree, options: dict[str, Tree], limit: int) -> Tree:
    return optx.least_squares(fn, minimiser, y, args, options, has_aux=True, max_steps=limit, throw=False)


class _Bounded(eqx.Module):
    """Parameters between bounds as functions of unbounded ones."""

    low: Vector
    high: Vector

    def bounded(self, z: Vector) -> Vector:
        has_low, has_high, low, high = self._ends()
        reach = jnp.sqrt(z**2 + 1.0) - 1.0
        single = jnp.where(has_low, low + reach, jnp.where(has_high, high - reach, z))
        return jnp.where(has_low & has_high, 0.5 * (low + high) + 0.5 * (high - low) * jnp.sin(z), single)

    def unbounded(self, y: Vector) -> Vector:
        has_low, has_high, low, high = self._ends()
        half = 0.5 * (high - low)
        share = (y - 0.5 * (low + high)) / jnp.where(half > 0.0, half, 1.0)
        away = jnp.maximum(jnp.where(has_low, y - low, high - y), _INSIDE)
        single = jnp.where(has_low | has_high, jnp.sqrt((away + 1.0) ** 2 - 1.0), y)
        return jnp.where(has_low & has_high, jnp.arcsin(jnp.clip(share, -1.0 + _INSIDE, 1.0 - _INSIDE)), single)

    def _ends(self) -> tuple[Array, Array, Array, Array]:
        """Whether each parameter has a lower and an upper bound, and the bounds, 0 for none."""
        has_low, has_high = jnp.isfinite(self.low), jnp.isfinite(self.high)
        return has_low, has_high, jnp.where(has_low, self.low, 0.0), jnp.where(has_high, self.high, 0.0)


class _Inserted(eqx.Module):
    """A residual as a function of the unbounded parameters that are free."""

    residual: ResidualFunction
    whole: Vector
    free: Tree
    scale: _Bounded

    def point(self, z: Float[Array, " free"]) -> Vector:
        return self.whole.at[self.free].set(self.scale.bounded(z))

    def __call__(self, z: Float[Array, " free"], args: Tree) -> tuple[Float[Array, " n"], Tree]:
        return self.residual(self.point(z), args)
