"""The hysteresis of Bouc and Wen along the path of the voltage, where it is exponential."""

import jax.numpy as jnp

from ..core import Scalar, ScalarLike


def after_jump(h: Scalar, change: ScalarLike, slope: ScalarLike, beta: ScalarLike, gamma: ScalarLike) -> Scalar:
    """h after the voltage has run a way of `change` [V]: unloading until h vanishes, loading then.

    **Arguments:** `slope` is dh/du where h vanishes; on a branch dh = (slope - (beta +- gamma) h) du.
    """
    side = jnp.where(change < 0.0, -1.0, 1.0)
    # Not |change|, which JAX gives no slope at 0, nor below a minimum of two zeros, which it halves: a stack begins so.
    path, ahead = side * change, side * h
    unloads, loads = beta - gamma, beta + gamma
    behind = jnp.minimum(ahead, 0.0)
    # The way on which the unloading branch reaches h = 0; it may never.
    growth = -behind * unloads / jnp.where(slope > 0.0, slope, 1.0)
    far = jnp.where((growth > -1.0) & (slope > 0.0), -behind / jnp.where(slope > 0.0, slope, 1.0), jnp.inf)
    way = jnp.where(jnp.isfinite(far), jnp.where(jnp.isfinite(far), far, 0.0) * _log_ratio(growth), jnp.inf)
    first = jnp.where(ahead < 0.0, jnp.minimum(way, path), 0.0)
    remainder = path - first
    unloaded = jnp.where(first < way, _branch(behind, slope, unloads, first), 0.0)
    begun = jnp.where(ahead < 0.0, unloaded, ahead)
    return side * _branch(begun, slope, loads, remainder)


def _branch(h: Scalar, slope: ScalarLike, rate: ScalarLike, path: Scalar) -> Scalar:
    """h after a way of `path` [V] with dh = (slope - rate h) du."""
    x = rate * path
    safe = jnp.where(jnp.abs(x) < 1e-5, 1.0, x)
    part = jnp.where(jnp.abs(x) < 1e-5, 1.0 - x * (0.5 - x / 6.0), -jnp.expm1(-safe) / safe)
    return h + (slope - rate * h) * path * part


def _log_ratio(x: Scalar) -> Scalar:
    """log(1 + x) / x; for x > -1."""
    near = jnp.abs(x) < 1e-5
    safe = jnp.where(near | (x <= -1.0), 1.0, x)
    return jnp.where(near, 1.0 - x * (0.5 - x / 3.0), jnp.log1p(safe) / safe)
