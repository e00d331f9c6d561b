"""How right are the derivatives of one actuator's record?

Those at the default accuracy are judged by central differences of the values at the tightest one, column by column.
Where a column seems off, differences with ever finer steps are taken, too, and the best judges: a record that a small
change of a parameter leads past a discontinuity, or many, has a derivative that wider ones do not see.  Where the first
two disagree by as much as the derivative is off from all, the record lies at a discontinuity, which they show as well.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from experiments.actuator_structure import Structure
from pdssjax import Accuracy
from pdssjax.integration import TIGHT

ROOM = 60_000
"""Steps of an actuator that hardly settles, at the tightest accuracy or of a law with many events."""
STEP, OTHERS = 1e-5, (1e-6, 1e-4, 1e-8, 1e-10, 1e-11)
"""Of the central differences, in the logarithm of a parameter.

Finer ones for records between discontinuities; the coarse one for stiff contacts, whose force is known to 1e-15 m
times the stiffness.
"""
SEEN = 1e-3
"""A column below this part of the largest is not judged."""
ASKED, SUSPECT = 1e-3, 5e-4
"""Error of a column, relative to its norm, that is asked for; and above which other differences are taken."""
REVERSE = 1e-8
"""What forward and reverse mode may disagree by."""
VALUES = {"m": 1e-10, "m/s": 1e-6, "m/s2": 1e-2, "N": 1e-4}
"""Error of the record that is allowed, by its unit: the natural frequency makes the others of 1e-10 m."""

Columns = Float[np.ndarray, "samples parameters"]


class Verdict(NamedTuple):
    """How right one actuator's record and derivatives are."""

    column: str
    """The parameter whose derivative is the furthest off; of those at no discontinuity, if one of them is above."""
    error: float
    """Of that column, relative to its norm; by the best of the differences."""
    weight: float
    """Norm of that column, relative to the largest."""
    discontinuity: float | None
    """What the differences with two steps disagree by there; None where one step was enough."""
    tight: float | None
    """The error of that column at the tightest accuracy; None where one step was enough."""
    above: int
    """How many columns have a larger error than is asked, and no discontinuity."""
    value: float
    """Largest error of the record itself [its unit]."""
    reverse: float
    """What forward and reverse mode disagree by, relative to the norm of a column; the worst of them."""
    failure: str
    """"usual" or "tight" where the integration at that accuracy did not finish; else empty."""

    @property
    def is_cliff(self) -> bool:
        """A discontinuity, which the differences show as well."""
        return self.error > ASKED and self.discontinuity is not None and self.error <= 2.0 * self.discontinuity

    @property
    def is_right(self) -> bool:
        """But for the record itself, whose unit is the structure's."""
        return not self.failure and (self.error <= ASKED or self.is_cliff) and self.reverse <= REVERSE


class Judge:
    """The compiled functions of a structure."""

    def __init__(self, structure: Structure):
        self.structure = structure
        self.weights = np.cos(np.arange(structure.times.size))
        self._value = jax.jit(self._shown_with(ROOM))
        self._slopes = jax.jit(self._slopes_with, static_argnames="room")

    def values(self, factors: Float[np.ndarray, " parameters"], accuracy: Accuracy) -> Float[np.ndarray, " samples"]:
        return np.asarray(self._value(factors, float(accuracy.tolerance), float(accuracy.settle_tolerance)))

    def slopes(self, factors: Float[np.ndarray, " parameters"], accuracy: Accuracy) -> tuple[Columns, np.ndarray]:
        """The Jacobian, forwards, and the `weights` times it, backwards."""
        for room in (Accuracy().max_steps, ROOM):
            found = self._slopes(
                factors, self.weights, float(accuracy.tolerance), float(accuracy.settle_tolerance), room=room
            )
            if np.isfinite(found[0]).all():
                break
        return np.asarray(found[0]), np.asarray(found[1])

    def differences(self, factors: Float[np.ndarray, " parameters"], step: float) -> Columns:
        """d shown / d factors by central differences at the tightest accuracy, shape (samples, parameters)."""
        ends = [
            self.values(factors + step * e, TIGHT) - self.values(factors - step * e, TIGHT)
            for e in np.eye(factors.size)
        ]
        return np.stack(ends, axis=1) / (2.0 * step)

    def verdict(self, factors: Float[np.ndarray, " parameters"]) -> Verdict:
        """The judgement on one actuator."""
        jacobian, back = self.slopes(factors, Accuracy())
        value = np.abs(self.values(factors, Accuracy()) - self.values(factors, TIGHT)).max()
        found = [self.differences(factors, STEP)]
        apart = lambda columns: np.fmin.reduce([_distance(columns, each) for each in found])
        error = apart(jacobian)
        failure = "usual" if not np.isfinite(jacobian).all() else "tight" if not np.isfinite(value) else ""
        disagree, tight = np.zeros(factors.size), None
        if not error.max() <= SUSPECT and not failure:
            for step in OTHERS:
                if not apart(jacobian).max() <= SUSPECT:
                    found += [self.differences(factors, step)]
            error, tight = apart(jacobian), apart(self.slopes(factors, TIGHT)[0])
            disagree = _distance(found[1], found[0])
        error = np.where(np.isfinite(error), error, np.inf)
        wrong = (error > ASKED) & (error > 2.0 * disagree)
        worst = int(np.argmax(np.where(wrong, error, 0.0) if wrong.any() else error))
        sizes = np.linalg.norm(jacobian, axis=0)
        return Verdict(
            column=list(self.structure.nominal)[worst],
            error=float(error[worst]),
            weight=float(sizes[worst] / (sizes.max() or 1.0)),
            discontinuity=None if tight is None else float(disagree[worst]),
            tight=None if tight is None else float(tight[worst]),
            above=int(wrong.sum()),
            value=float(value),
            reverse=_apart(back, jacobian, self.weights),
            failure=failure,
        )

    def _shown_with(self, room: int) -> Any:
        """The record as a function of factors, tolerance [m] and settle tolerance [m]."""
        accuracy = lambda tolerance, rest: Accuracy(tolerance, rest, max_steps=room)
        return lambda factors, tolerance, rest: self.structure.shown(factors, accuracy(tolerance, rest))

    def _slopes_with(
        self,
        factors: Float[Array, " parameters"],
        weights: Float[Array, " samples"],
        tolerance: Any,
        rest: Any,
        room: int,
    ) -> tuple[Any, Any]:
        # Both modes from one linearisation: less to compile.
        shown = lambda p: self._shown_with(room)(p, tolerance, rest)
        _, along = jax.linearize(shown, factors)
        (back,) = jax.linear_transpose(along, factors)(weights)
        return jax.vmap(along, out_axes=1)(jnp.eye(factors.size)), back


def _distance(columns: Columns, judge: Columns) -> Float[np.ndarray, " parameters"]:
    """Of each column from that of the judge, relative to the judge's norm; 0 where the record does not show it."""
    sizes = np.linalg.norm(judge, axis=0)
    seen = ~(sizes <= SEEN * sizes.max())
    return np.where(seen, np.linalg.norm(columns - judge, axis=0) / np.where(seen, sizes, 1.0), 0.0)


def _apart(back: np.ndarray, jacobian: Columns, weights: Float[np.ndarray, " samples"]) -> float:
    sizes = np.linalg.norm(jacobian, axis=0)
    # A record may show nothing: the velocity of a static stack under a staircase.
    counted = np.maximum(sizes, SEEN * (sizes.max() or 1.0))
    return float((np.abs(back - weights @ jacobian) / (np.linalg.norm(weights) * counted)).max())
