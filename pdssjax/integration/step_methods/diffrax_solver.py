"""One smooth step of a solver, as polynomials in time.

`Taylor` is the default: inside a mode the field is polynomial or rational, its series
follows from a short recurrence, and the last coefficients say how far it holds, so that no
step is ever rejected.  `OneStep` takes any adaptive one-step solver of diffrax, explicit or
implicit, and its dense output.
"""

import abc
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from .series import Series, solution

Polynomials = list[list[Any]]
"""For each component the coefficients in theta = lapse/reach, lowest first."""


class Piece(NamedTuple):
    """A step on trial."""

    polynomials: Polynomials
    reach: Any
    """Length for which the polynomials hold [s]."""
    accepted: Any
    following: Any
    """A length to try for the next step [s]."""


class AbstractExpansion(eqx.Module):
    """How a smooth piece is advanced.

    `units` turn each component into tolerances.  `one` is a 1 unknown to the compiler: see
    `series.solution`.
    """

    noise: ClassVar[float]
    """Tolerances below which the sign of a small velocity means nothing: its reversals are not events."""

    @property
    @abc.abstractmethod
    def span(self) -> float:
        """Time constants of the quickest transient that a step may span, so that derivatives do not grow over it."""

    @abc.abstractmethod
    def attempt(self, field: Callable, after: Any, x: list, units: list, remaining: Any, trial: Any, one: Any) -> Piece:
        """A step from `x` at time `after`, over `remaining` [s] at most; `trial` is its wish."""

    @abc.abstractmethod
    def expand(self, field: Callable, after: Any, x: list, units: list, reach: Any, one: Any) -> Polynomials:
        """The same step again for a known `reach`, differentiable in all the rest."""


class Taylor(AbstractExpansion):
    """Taylor series of a given order; step control after À. Jorba and M. Zou,
    Experimental Mathematics 14(1), 2005."""

    order: int = eqx.field(static=True, default=16)
    noise: ClassVar[float] = 0.0

    @property
    def span(self):
        # Inside the circle of this radius in the left half-plane the series of e^z is at most 1: radius 4.1 at order
        # 12, 5.5 at order 16, 8.6 at order 20.
        return self.order / 3.0

    def attempt(self, field, after, x, units, remaining, trial, one):
        series = solution(field, after, x, self.order, one)
        reach = jnp.minimum(_resolved(series, units), remaining) / one
        # Always accepted: a series that is not finite would not be so the next time either.
        return Piece(_rescaled(series, reach), reach, jnp.ones((), bool), reach)

    def expand(self, field, after, x, units, reach, one):
        return _rescaled(solution(field, after, x, self.order, one, divide=True), reach)


class OneStep(AbstractExpansion):
    """Any diffrax solver with an error estimate, for example `OneStep(diffrax.Kvaerno5())`.

    The dense output is rewritten as a polynomial of degree `degree`, exactly where that is
    at least its own.  The root finder of an implicit solver works to a hundredth of the tolerance.
    """

    solver: diffrax.AbstractSolver = diffrax.Tsit5()
    degree: int = eqx.field(static=True, default=8)
    noise: ClassVar[float] = 10.0

    @property
    def span(self):
        # Explicit Runge-Kutta methods are stable up to 2.5 and more; implicit ones damp whatever dies out.
        return np.inf if isinstance(self._inner(), diffrax.AbstractImplicitSolver) else 2.5

    def __check_init__(self):
        if not isinstance(self.solver, diffrax.AbstractAdaptiveSolver | diffrax.HalfSolver):
            raise ValueError(
                f"`solver` must estimate its error, but {type(self.solver).__name__} does not. "
                "Try diffrax.HalfSolver around it."
            )

    def attempt(self, field, after, x, units, remaining, trial, one):
        reach = jnp.minimum(trial, remaining)
        polynomials, error, ok = self._step(field, after, x, units, reach)
        size = jnp.max(jnp.abs(error))
        size = jnp.where(ok & jnp.isfinite(size), size, 1e10)
        order = self.solver.order(diffrax.ODETerm(lambda t, y, args: y)) or 1
        factor = jnp.clip(0.9 * (size + 1e-30) ** (-1.0 / (order + 1.0)), 0.1, 5.0)
        accepted = size <= 1.0
        grown = jnp.where(accepted & (reach == remaining), jnp.maximum(trial, reach * factor), reach * factor)
        return Piece(polynomials, reach, accepted, grown)

    def expand(self, field, after, x, units, reach, one):
        return self._step(field, after, x, units, reach)[0]

    def _step(self, field, after, x, units, reach) -> tuple[Polynomials, Any, Any]:
        scale = jnp.stack(units)

        def scaled(time, state, args):
            return jnp.stack(field(after + time * reach, tuple(state / scale))) * scale * reach

        term, solver = diffrax.ODETerm(scaled), self._ready()
        start = jnp.stack(x) * scale
        zero, one = jnp.zeros_like(after), jnp.ones_like(after)
        memory = solver.init(term, zero, one, start, None)
        _, error, dense, _, result = solver.step(term, zero, one, start, None, memory, False)
        inner = solver.interpolation_cls(t0=zero, t1=one, **dense)
        nodes, fit = _fit(self.degree)
        values = jax.vmap(inner.evaluate)(jnp.asarray(nodes) + 0.0 * after)
        coefficients = (jnp.asarray(fit) @ values) / scale
        polynomials = [[coefficients[k, i] for k in range(self.degree + 1)] for i in range(len(x))]
        return polynomials, error, result == diffrax.RESULTS.successful

    def _inner(self) -> Any:
        return self.solver.solver if isinstance(self.solver, diffrax.HalfSolver) else self.solver

    def _ready(self):
        solver: Any = _differentiable(self.solver)
        if isinstance(solver, diffrax.HalfSolver):
            solver = eqx.tree_at(lambda s: s.solver, solver, _differentiable(solver.solver))
        if not isinstance(solver, diffrax.AbstractImplicitSolver):
            return solver
        kind = type(solver.root_finder)
        if issubclass(kind, diffrax.VeryChord):
            # It fails where an exact first guess leaves it nothing but rounding, unless that is below 1e-13 of
            # `atol`.  What counts as solved is `kappa * atol`, so both are shifted.
            precise = kind(rtol=0.0, atol=1e6, kappa=1e-8, norm=optx.max_norm)
        else:
            precise = kind(rtol=1e-12, atol=1e-2, norm=optx.max_norm)
        return eqx.tree_at(lambda s: s.root_finder, solver, precise)


def shortened(piece: Piece, hidden: Sequence[Series], tolerance: Any, one: Any) -> Piece:
    """As much of `piece` as also resolves the series `hidden`, made of its polynomials, to `tolerance`."""
    size = len(piece.polynomials[0])
    rows = [[series[k] for k in range(size)] for series in hidden]
    part = jnp.minimum(_resolved(rows, [1.0 / tolerance] * len(rows)), 1.0) / one
    return piece._replace(polynomials=_rescaled(piece.polynomials, part), reach=piece.reach * part)


def _resolved(series: list[list], units: list) -> Any:
    """The length over which the last two of the coefficients stay below one unit."""
    lengths = []
    for k in (len(series[0]) - 2, len(series[0]) - 1):
        largest = 1e-100
        for coefficients, unit in zip(series, units, strict=True):
            largest = jnp.maximum(largest, jnp.abs(coefficients[k]) * unit)
        lengths.append(jnp.exp(jnp.log(largest) * (-1.0 / k)))
    return 0.95 * jnp.minimum(*lengths)


def _differentiable(solver: Any) -> Any:
    """The solver with its loop over the stages open to forward as well as to reverse mode."""
    if getattr(solver, "scan_kind", "") is not None:
        return solver
    return eqx.tree_at(lambda s: s.scan_kind, solver, "bounded", is_leaf=lambda leaf: leaf is None)


def horner(coefficients: list, theta: Any) -> Any:
    """The polynomial with the given coefficients, lowest first, at `theta`."""
    total = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        total = total * theta + coefficient
    return total


def _rescaled(series: list[list], reach: Any) -> Polynomials:
    powers = [jnp.ones_like(reach)]
    for _ in range(len(series[0]) - 1):
        powers.append(powers[-1] * reach)
    return [[c * p for c, p in zip(row, powers, strict=True)] for row in series]


def _fit(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Chebyshev points of [0, 1] and the matrix from values there to coefficients."""
    nodes = 0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 1) / degree)
    return nodes, np.linalg.inv(np.vander(nodes, increasing=True))
