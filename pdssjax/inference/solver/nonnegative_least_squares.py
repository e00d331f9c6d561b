"""Linear least squares of unknowns that may not be negative, by NumPy.

The active set of C. L. Lawson and R. J. Hanson (Solving Least Squares Problems, Prentice-Hall 1974, chapter 23), with
unknowns of any sign inside from the start.
"""

import numpy as np
from jaxtyping import Bool, Float

_LEAST = 1e-10
"""Multiplier, relative to columns and residual of norm 1, from which an unknown is let off its bound."""


def nonnegative_least_squares(
    columns: Float[np.ndarray, "n q"], target: Float[np.ndarray, " n"], signed: Bool[np.ndarray, " q"]
) -> tuple[Float[np.ndarray, " q"], float]:
    """The x that leaves least of ||columns x - target||^2, none negative but those `signed`, and what it leaves."""
    norms = np.linalg.norm(columns, axis=0)
    norms = np.where(norms > 0.0, norms, 1.0)
    factor, upper = np.linalg.qr(columns / norms)
    aim = factor.T @ target
    x, inside = np.zeros(norms.size), signed.copy()
    x[inside] = _solved(upper, aim, inside)
    tolerance = _LEAST * float(np.linalg.norm(target))
    for _ in range(4 * norms.size + 4):
        slope = np.where(inside, -np.inf, upper.T @ (aim - upper @ x))
        if not slope.max(initial=-np.inf) > tolerance:
            break
        inside[int(np.argmax(slope))] = True
        x = _feasible(upper, aim, x, inside, signed)
    left = float(np.sum((columns @ (x / norms) - target) ** 2))
    return x / norms, left


def _feasible(
    upper: Float[np.ndarray, "q q"],
    aim: Float[np.ndarray, " q"],
    x: Float[np.ndarray, " q"],
    inside: Bool[np.ndarray, " q"],
    signed: Bool[np.ndarray, " q"],
) -> Float[np.ndarray, " q"]:
    """From x to the minimum over those `inside`, which is changed: those that meet zero on the way leave it."""
    while True:
        there = np.zeros(x.size)
        there[inside] = _solved(upper, aim, inside)
        stops = inside & ~signed & (there <= 0.0)
        if not stops.any():
            return there
        share = float(np.min(x[stops] / np.maximum(x[stops] - there[stops], 1e-300)))
        x = x + share * (there - x)
        inside &= signed | (x > 1e-14 * np.max(np.abs(x)))
        x = np.where(inside, x, 0.0)


def _solved(
    upper: Float[np.ndarray, "q q"], aim: Float[np.ndarray, " q"], inside: Bool[np.ndarray, " q"]
) -> Float[np.ndarray, " k"]:
    return np.linalg.lstsq(upper[:, inside], aim, rcond=1e-12)[0]
