"""All devices of this machine, side by side: each takes an equal share of the points, and none waits for another."""

import os
from collections.abc import Callable
from typing import TypeVar

import jax
import numpy as np
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import Array, Float

from .block_plan import LANES

_ACCELERATED = 4096
"""Points side by side on a device other than a CPU: it has as many lanes, and a step costs it its launches."""

Found = TypeVar("Found")
"""A pytree of arrays, one row a point."""


def shared_out(look: Callable[[Float[Array, "points paths"]], Found], points: Float[Array, "points paths"]) -> Found:
    """What `look` finds at `points`, each device of this machine looking at its share of them.

    **Arguments:** `look` treats points alike, in any number; there are a multiple of `whole_shares(1)` of them.
    """
    devices = np.array(jax.local_devices())
    if devices.size == 1:
        return look(points)
    share = PartitionSpec("points")
    # Loops end at another turn on each device, which what JAX knows of replicated values does not allow for.
    return jax.shard_map(look, mesh=Mesh(devices, ("points",)), in_specs=share, out_specs=share, check_vma=False)(
        points
    )


def whole_shares(points: int) -> int:
    """The least number of points, at least so many, that the devices of this machine can share equally."""
    devices = jax.local_device_count()
    return -(-points // devices) * devices


def lanes_here() -> int:
    """Points of a block that suits the devices of this machine."""
    devices = jax.local_devices()
    return len(devices) * (LANES if devices[0].platform == "cpu" else _ACCELERATED)


def default_workers() -> int:
    """Threads that keep this machine busy: one a core, or two where there are several devices or other than CPUs.

    One then prepares a block while the devices compute another.
    """
    devices = jax.local_devices()
    return 2 if len(devices) > 1 or devices[0].platform != "cpu" else os.cpu_count() or 1
