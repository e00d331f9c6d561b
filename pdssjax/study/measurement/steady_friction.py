"""Friction force in steady sliding against the velocity: a friction curve, or Stribeck curve, as a tribometer gives it.

Each sample stands by itself: the contact slides at its velocity until nothing changes any more.  A record needs no
times.  Read for laws that know in closed form what steady sliding does to them; what they say of presliding (a
stiffness, a path) no such record tells.
"""

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...core import member, member_name, members
from ...integration import AbstractHybridSystem
from ...simulation import FRICTION_FORCE, Output, PrescribedMotion
from ..models import Models, Values
from ..setups import AbstractSetup, Run
from .base import AbstractContactMeasurement, MeasuredRecord

_FAR = 1e3
"""Path [m] after which sliding is steady; laws forget over micrometres."""


class _SteadySliding(AbstractSetup):
    """The contact at one velocity after the other, each held for so long that its sliding is steady."""

    output: Output = eqx.field(static=True, default=FRICTION_FORCE)

    def system(self, models: Models, values: Values, run: Run) -> AbstractHybridSystem:
        begins, velocities = self._velocity_steps(run)
        path = jnp.where(velocities < 0.0, -_FAR, _FAR)
        return PrescribedMotion(models.contact(values), begins, jnp.append(0.0, jnp.cumsum(path)))

    def times(self, run: Run) -> Float[Array, " samples"]:
        begins, _ = self._velocity_steps(run)
        return 0.5 * (begins[1:] + begins[:-1])

    def goes_on_moving(self, models: Models) -> bool:
        return False

    def _velocity_steps(self, run: Run) -> tuple[Float[Array, " samples+1"], Float[Array, " samples"]]:
        """When each velocity sets in and the last one ends [s], and the velocities [m/s]."""
        if run.motion is None:
            raise ValueError("Expected prescribed velocities, but the run has none.")
        velocities = jnp.asarray(run.motion)
        return jnp.append(0.0, jnp.cumsum(_FAR / jnp.abs(velocities))), velocities


class SteadyFriction(AbstractContactMeasurement):
    """The contact in steady sliding, by a tribometer."""

    columns: ClassVar = {"time": "s", "velocity": "m/s", "force": "N"}

    def setup(self, models: Models) -> AbstractSetup:
        return _SteadySliding()

    def refused(self, models: Models, fixed: Mapping[str, float], record: MeasuredRecord) -> str:
        if not models.friction.slides_in_closed_form():
            known = [name for name in members("friction") if member("friction", name).slides_in_closed_form()]
            return (
                f'found the law "{member_name(models.friction)}", whose steady sliding is not known in closed form, '
                f"expected one of {', '.join(known)}"
            )
        still = np.flatnonzero(np.asarray(record.motion) == 0.0)
        if still.size:
            return (
                f"found a velocity of 0 in sample {still[0] + 1} of those kept, where nothing slides steadily, "
                "expected other velocities (leave such samples out of the file)"
            )
        return ""

    def planned(
        self, time: Float[np.ndarray, " samples"], numbers: Mapping[str, float]
    ) -> dict[str, Float[np.ndarray, " samples"]]:
        peak = 2.0 * np.pi * numbers["frequency"] * numbers["amplitude"]
        # Shifted by a quarter of a sample, so that none of the velocities is 0.
        shift = 0.25 * float(time[1] - time[0])
        return {"velocity": peak * np.cos(2.0 * np.pi * numbers["frequency"] * (time + shift))}
