"""Steps along a friction law alone, many side by side: how far its power series are from the law where they end.

The velocity changes steadily, and nothing but the law limits a step: the series of its state and of its
`extra_error_terms` have to be resolved as the integrator asks, and its guards end the step.  A law with a curve
in v that neither of them sees lets a step run past the curve; derivatives by its parameters are wrong then.
"""

from typing import NamedTuple

import numpy as np
from sliding import Contact, slid

from pdssjax import AbstractFriction, Accuracy
from pdssjax.friction.bristle import Bristle
from pdssjax.integration.polynomials import horner
from pdssjax.integration.step_methods.taylor import resolved_radius
from pdssjax.integration.taylor_series import Series, polynomial, unknown

SPEEDS = np.array([0.0, 1e-5, 3e-4, 2e-3, 9e-3, 4e-2, 0.1])
"""Velocities [m/s] at which steps begin, in either direction; far above 0 a contact slides steadily there."""
SLOPES = np.array([-300.0, -20.0, -1.0, 1.0, 20.0, 300.0])
"""By how much the speed changes [m/s2]."""
LONGEST = 2e-3
"""Of a step [s]."""
PARTS = np.linspace(0.0, 1.0, 41)
"""Where in a step its guards, its force and its rates are looked at."""


class Misfit(NamedTuple):
    """How far series are from the law where it is worst."""

    force: float
    """[N]"""
    rate: float
    """Of a state, as a displacement a unit of the way that is slid [1]."""
    where: str
    """Velocity and slope of that step."""


def misfit(law: AbstractFriction) -> Misfit:
    """The worst of all steps that begin at `SPEEDS` and `SLOPES`, in both directions."""
    order = Accuracy().method.order  # pyright: ignore[reportAttributeAccessIssue]
    v, slope, sign, state = _begins(law)
    room = np.where(slope * sign < 0.0, np.minimum(np.abs(v / slope), LONGEST), LONGEST)
    series = _expanded(law, v, slope, sign, state, order)
    contact_state, motion = [polynomial(c) for c in series], polynomial([v, slope])
    extra = law.extra_error_terms(tuple(contact_state), motion, sign)
    radius = np.minimum(room, _resolved(law, series, [[e[k] for k in range(order + 1)] for e in extra]))
    time = PARTS * radius[:, None]
    at = lambda given: _values(given, time, order)
    open_until = np.full(v.shape, PARTS.size)
    for guard in law.guards(tuple(contact_state), motion, sign):
        # At its begin a guard may be zero: there the last event was.
        falls = (at(guard)[:, 1:] < 0.0) if isinstance(guard, Series) else np.zeros(time[:, 1:].shape, bool)
        open_until = np.where(falls.any(axis=1), np.minimum(open_until, 1 + falls.argmax(axis=1)), open_until)
    inside = np.arange(PARTS.size) < open_until[:, None]
    speed = v[:, None] + slope[:, None] * time
    then, way = tuple(at(m) for m in contact_state), sign[:, None]
    off = np.abs(at(law.force(tuple(contact_state), motion, sign)) - np.asarray(law.force(then, speed, way))) * inside
    drift = np.zeros(())
    for given, exact, unit in zip(
        law.rate(tuple(contact_state), motion, sign), law.rate(then, speed, way), law.error_scale(), strict=True
    ):
        rate_error = np.abs(at(given) - np.asarray(exact)) * float(unit) * inside
        drift = np.maximum(drift, rate_error / np.abs(speed).max(axis=1, keepdims=True))
    worst = int(off.max(axis=1).argmax())
    return Misfit(float(off.max()), float(np.max(drift)), f"{v[worst]:g} m/s, {slope[worst]:g} m/s2")


def _begins(law):
    """Velocity, its slope, sign and state of the contact of every step, side by side."""
    contact, lanes = Contact(law), []
    for sign in (1.0, -1.0):
        for speed in SPEEDS:
            v = sign * speed
            m = contact.on_reversal(contact.initial, sign)
            if speed >= 3e-4 and not isinstance(law, Bristle):  # whose bonds stretch and snap for ever
                m = np.asarray(slid(law, 1e-5, v), float)
            m = contact.begun(m, v, sign)
            lanes += [(v, sign * slope, sign, m) for slope in SLOPES if speed > 0.0 or slope > 0.0]
    v, slope, sign = (np.array([lane[i] for lane in lanes]) for i in range(3))
    return v, slope, sign, list(np.array([lane[3] for lane in lanes]).T) if contact.initial.size else []


def _expanded(law, v, slope, sign, state, order):
    """The coefficients of every state, in time [s], each with all steps side by side."""
    known = [unknown(np.asarray(x)) for x in state]
    rates = law.rate(tuple(known), polynomial([v, slope]), sign)
    for k in range(order):
        for series, rate in zip(known, rates, strict=True):
            given = rate[k] if isinstance(rate, Series) else rate if k == 0 else 0
            series.append(np.asarray(given) / (k + 1.0) + np.zeros(v.shape))
    return [[series[k] for k in range(order + 1)] for series in known]


def _resolved(law, series, extra):
    """How long the steps may be [s] so that the last coefficients stay below the tolerance."""
    tolerance, units = Accuracy().tolerance, [float(unit) for unit in law.error_scale()]
    length = np.asarray(LONGEST)
    for rows, scales in ((series, units), (extra, [1.0] * len(extra))):
        if rows:
            found = np.asarray(resolved_radius(rows, [scale / tolerance for scale in scales]))
            length = np.minimum(length, found)
    return length


def _values(given, time, order) -> np.ndarray:
    """A series, or numbers, at `time` [s], shape (steps, parts)."""
    if not isinstance(given, Series):
        return np.zeros(time.shape) + np.reshape(np.asarray(given, float), (-1, 1) if np.ndim(given) else ())
    column = lambda c: np.reshape(np.asarray(c, float), (-1, 1) if np.ndim(c) else ())
    return np.asarray(horner([column(given[k]) for k in range(order + 1)], time))
