"""Accuracy of an integration: tolerances, step method, room for steps; and why a run ended early."""

import equinox as eqx
import jax.numpy as jnp

from ..core import InputError, Scalar, ScalarLike, as_number
from .step_methods.base import AbstractStepMethod
from .step_methods.taylor import Taylor

FAILURES = (
    "",
    "the integration ran out of steps before the end of the record: look for a stiffness, frequency or bandwidth that "
    "is too high, take a shorter record, or allow more steps (in Python: `Accuracy(max_steps=...)`)",
    "the motion did not stay finite",
)


ROUNDING = 1e-15
"""Deviation [m] that is never stepped: at 1e-17 m derivatives of one random actuator in forty were lost."""


class Accuracy(eqx.Module):
    """Tolerances and step method of an integration."""

    tolerance: ScalarLike = eqx.field(default=1e-14, converter=as_number)
    """Local error allowed in one step, as a displacement [m]; hundreds of steps and reversals make 1e-11 m of it."""
    settle_tolerance: ScalarLike = eqx.field(default=3e-14, converter=as_number)
    """Deviation [m] from the steady solution below which the remainder of a segment is not stepped.

    Well below the accuracy of the motion: the derivatives of an oscillation exceed it by a factor of its phase [rad].
    """
    method: AbstractStepMethod = Taylor()
    """The one-step method for the smooth pieces."""
    max_steps: int = eqx.field(static=True, default=8192)
    """Room for this many steps; an integration that needs more ends there and says so."""

    def __check_init__(self) -> None:
        # A checker is sure of it; a user who passes a bare solver of diffrax is not.
        if not isinstance(self.method, AbstractStepMethod):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(
                f"Accuracy.method: found {self.method!r:.80}, expected a step method: pdssjax.Taylor(), or a "
                "solver of diffrax within one, pdssjax.OneStep(solver)."
            )

    @property
    def effective_settle_tolerance(self) -> Scalar:
        """`settle_tolerance`, but above the noise of the method, and above rounding.

        Below that amplitude rounding decides when a velocity reverses, and such an event has no derivative.
        """
        return jnp.maximum(jnp.maximum(self.settle_tolerance, self.method.velocity_noise * self.tolerance), ROUNDING)


TIGHT = Accuracy(tolerance=1e-15, settle_tolerance=1e-15)
"""Accuracy to rounding: trajectories to about 1e-7 um, weak columns of derivatives to some 1e-5."""
