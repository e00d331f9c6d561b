"""How residuals bend, learned by all searches for ends of intervals together.

A polynomial of third order (`residual_polynomial`) is learned from every linearisation that any of them has asked for,
as soon as there are enough to determine it.  Before that there is the curvature at the optimum, from probes.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from .residual_polynomial import SampledPolynomial, count_points, learned_polynomial
from .second_order import Curvature, Linearisation, learned

_GROWTH = 1.1
"""So many times as many points as last time, and the polynomial is learned anew: it may take longer than they do."""


class SharedCurvature:
    """Around an `optimum`, by `probes` near it.

    **Arguments:** the `scale` in which the Jacobian's columns are orthonormal; the `factor` by which variances exceed
    those of the noise given.
    """

    def __init__(
        self,
        optimum: Linearisation,
        probes: Sequence[Linearisation],
        scale: Float[np.ndarray, "p p"],
        factor: float = 1.0,
    ):
        self.optimum, self.scale, self.factor = optimum, scale, factor
        self.at_optimum = learned(optimum, probes, scale)
        self.points: list[Linearisation] = list(probes)
        # Without probes some directions may have been seen by none: only what is learned on the way counts.
        self.learns = bool(probes)
        self.polynomial: SampledPolynomial | None = None
        self.due = count_points(optimum.at.size)
        """How many linearisations the polynomial is learned of next time, the optimum's among them."""

    @property
    def known(self) -> bool:
        """There is a polynomial."""
        return self.polynomial is not None

    def learn(self, points: Sequence[Linearisation]) -> None:
        """Of further linearisations."""
        self.points += points
        if self.learns and len(self.points) + 1 >= self.due:
            self.polynomial = learned_polynomial(self.optimum, self.points, self.scale, self.factor)
            self.due = int(_GROWTH * len(self.points)) + 1

    def at(self, place: Float[np.ndarray, " p"]) -> Curvature | None:
        """The curvature at a place by the polynomial, if there is one."""
        return None if self.polynomial is None else self.polynomial.curvature(place, self.scale)
