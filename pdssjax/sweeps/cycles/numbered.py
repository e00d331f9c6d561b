"""The cycle of a given number, counted from rest."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...core import Count
from ...integration import Accuracy, flat, integrate_steps, integrate_to_times
from ...simulation import StickSlip
from .base import FINE, METRICS, SIDE_BY_SIDE, AbstractCycle, Course, Opening, cycles_at, effector_at, timing


class Numbered(AbstractCycle):
    """Cycle `number`; the flank of the next one tells its slip."""

    number: int = eqx.field(static=True, default=4)

    @property
    def described(self) -> int | str:
        return self.number

    @property
    def accuracy(self) -> Accuracy:
        """This agrees with single runs to 1e-4 um."""
        return Accuracy(tolerance=3e-11, method=SIDE_BY_SIDE)

    def measure(self, system: StickSlip, accuracy: Accuracy) -> tuple[Float[Array, " metrics"], Count]:
        when = timing(system.drive)
        begin = (self.number - 1) * when.period
        times = jnp.concatenate([begin + when.phases, self.number * when.period + when.phases])
        state, _, _, failure = integrate_to_times(system, times, accuracy)
        measured = cycles_at(when, effector_at(system, state).reshape(2, -1))
        return jnp.stack([getattr(measured, name)[0] for name in METRICS]), failure

    def opening(self, system: StickSlip) -> Opening:
        none, unknown = jnp.zeros((), int), jnp.full((), jnp.nan)
        return Opening(flat(system.initial()), none, unknown, unknown, none)

    def course(self, system: StickSlip, opening: Opening) -> Course:
        when = timing(system.drive)
        run = integrate_steps(system, self.number * when.period + when.phases[-1], FINE)
        return Course(system, system, run, (self.number - 1) * when.period, jnp.ones((), int), 1, run.failure)
