"""The cycle of a given number, counted from rest."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...core import Count
from ...integration import Accuracy, Taylor, integrate_to_times
from ...metrics import cycle_metrics
from ...simulation import StickSlip
from .base import METRICS, AbstractCycle, effector_at, timing


class Numbered(AbstractCycle):
    """Cycle `number`; the flank of the next one tells its slip."""

    number: int = eqx.field(static=True, default=4)

    @property
    def described(self) -> int | str:
        return self.number

    @property
    def accuracy(self) -> Accuracy:
        """Side by side a low order is faster; this agrees with single runs to 1e-4 um."""
        return Accuracy(tolerance=3e-11, method=Taylor(8))

    def measure(self, system: StickSlip, accuracy: Accuracy) -> tuple[Float[Array, " metrics"], Count]:
        when = timing(system.drive)
        begin = (self.number - 1) * when.period
        times = jnp.concatenate([begin + when.phases, self.number * when.period + when.phases])
        state, _, _, failure = integrate_to_times(system, times, accuracy)
        measured = cycle_metrics(times, effector_at(system, state), when.frequency, begin, 1, when.fall)
        return jnp.stack([getattr(measured, name)[0] for name in METRICS]), failure
