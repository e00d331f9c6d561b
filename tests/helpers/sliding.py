"""Drives a friction law by itself, along a velocity that is prescribed or with a mass that is pushed.

Every piece between two events is SciPy's (DOP853), so that nothing of the package's own
integration is used; where a guard falls through zero the law says by `after_event` what follows,
and at a reversal by `on_reversal`.
"""

import dataclasses
import functools
import itertools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

from pdssjax import AbstractFriction

TIGHT: dict[str, Any] = dict(method="DOP853", rtol=1e-11, atol=1e-16)


@dataclasses.dataclass
class Run:
    """What was seen: times [s], relative displacement [m], velocity [m/s], force [N]; and the state at the end."""

    time: np.ndarray
    x: np.ndarray
    v: np.ndarray
    force: np.ndarray
    state: tuple
    events: int
    ends: np.ndarray
    """Rows at which the legs end."""

    def work(self) -> np.ndarray:
        """Work done on the contact up to each time [J], by the trapezoidal rule along the path."""
        steps = 0.5 * (self.force[1:] + self.force[:-1]) * np.diff(self.x)
        return np.append(0.0, np.cumsum(steps))


_stack = lambda values: jnp.stack([jnp.asarray(x, float) for x in values]) if values else jnp.zeros(0)


class Programs(NamedTuple):
    """What is asked of a law, compiled: each takes the numbers of the law first."""

    rate: Callable
    force: Callable
    guards: Callable
    after_event: Callable
    on_reversal: Callable


@functools.cache
def compiled(structure: Any) -> Programs:
    """For all laws of a kind; to take a law itself would cost more at every call than what is computed."""
    law = lambda numbers: jax.tree.unflatten(structure, numbers)
    return Programs(
        jax.jit(lambda n, m, v, s: _stack(law(n).rate(tuple(m), v, s))),
        jax.jit(lambda n, m, v, s: law(n).force(tuple(m), v, s) + 0.0 * v),
        jax.jit(lambda n, m, v, s: _stack(law(n).guards(tuple(m), v, s))),
        jax.jit(lambda n, m, v, s, which: _stack(law(n).after_event(tuple(m), v, s, which))),
        jax.jit(lambda n, m, s: _stack(law(n).on_reversal(tuple(m), s))),
    )


class Contact:
    """A law on numpy vectors: compiled once for all laws of a kind."""

    def __init__(self, law: AbstractFriction):
        law = jax.tree.map(lambda leaf: jnp.asarray(leaf, float), law)
        numbers, structure = jax.tree.flatten(law)
        ask = compiled(structure)
        self.initial = np.asarray(_stack(law.initial()))
        self.rate = lambda m, v, s: np.asarray(ask.rate(numbers, m, v, s))
        self.force = lambda m, v, s: float(ask.force(numbers, m, v, s))
        # SciPy asks for one guard after the other at the same point.
        guards = functools.lru_cache(1)(lambda m, v, s: np.asarray(ask.guards(numbers, np.frombuffer(m), v, s)))
        self.guards = lambda m, v, s: guards(np.asarray(m, float).tobytes(), v, s)
        self.after_event = lambda m, v, s, which: np.asarray(ask.after_event(numbers, m, v, s, which))
        self.on_reversal = lambda m, s: np.asarray(ask.on_reversal(numbers, m, s))
        self.count = len(law.guards(law.initial(), jnp.asarray(1e-3), jnp.asarray(1.0)))

    def begun(self, m: np.ndarray, v: float, sign: float) -> np.ndarray:
        """The state once every guard that is negative already has been passed."""
        for _ in range(100):
            guards = self.guards(m, v, sign)
            if not (guards < 0).any():
                return m
            m = self.after_event(m, v, sign, int(np.argmin(guards)))
        raise AssertionError("the flags never settle")


def drive(
    law: AbstractFriction,
    velocity: Callable[[float], float],
    duration: float,
    state: Sequence | None = None,
    samples: int = 100,
) -> Run:
    """Slides for `duration` [s] at a `velocity` [m/s] that keeps its sign; `samples` rows from event to event."""
    contact = Contact(law)
    sign = float(np.sign(velocity(0.5 * duration)))
    m = contact.on_reversal(contact.initial if state is None else np.asarray(state, float), sign)
    field = lambda t, y: np.append(contact.rate(y[:-1], velocity(t), sign), velocity(t))
    stops = [_falling(lambda t, y, i=i: contact.guards(y[:-1], velocity(t), sign)[i]) for i in range(contact.count)]
    rows, events, x, time = [], 0, 0.0, 0.0
    while time < duration:
        m = contact.begun(m, velocity(time), sign)
        piece = solve_ivp(field, (time, duration), np.append(m, x), events=stops, dense_output=True, **TIGHT)
        for t in np.linspace(time, piece.t[-1], samples):
            y = piece.sol(t)
            rows.append((t, y[-1], velocity(t), contact.force(y[:-1], velocity(t), sign)))
        time, m, x = piece.t[-1], piece.y[:-1, -1], piece.y[-1, -1]
        if piece.status == 1:
            m = contact.after_event(m, velocity(time), sign, next(i for i, t in enumerate(piece.t_events) if t.size))
            events += 1
    return Run(*np.array(rows).T, tuple(m), events, np.array([len(rows) - 1]))


def _falling(event: Any) -> Any:
    event.terminal, event.direction = True, -1
    return event


def slid(law: AbstractFriction, path: float, v: float, state: Sequence | None = None) -> tuple:
    """The state after sliding over `path` [m] at the velocity `v` [m/s], undisturbed at first."""
    return drive(law, lambda _: v, path / abs(v), state, samples=2).state


def zigzag(
    law: AbstractFriction, turns: Sequence[float], speed: float | Sequence[float] = 1e-3, samples: int = 100
) -> Run:
    """Slides from 0 to each of the displacements `turns` [m] in turn, at one constant speed [m/s] or one a leg."""
    speeds = [speed] * len(turns) if isinstance(speed, float) else speed
    legs: list[Run] = []
    for (here, there), pace in zip(itertools.pairwise([0.0, *turns]), speeds, strict=True):
        v = pace * float(np.sign(there - here))
        leg = drive(law, lambda _, v=v: v, (there - here) / v, legs[-1].state if legs else None, samples)
        leg.x, leg.time = leg.x + here, leg.time + (legs[-1].time[-1] if legs else 0.0)
        legs.append(leg)
    join = lambda name: np.concatenate([getattr(leg, name) for leg in legs])
    ends = np.cumsum([leg.x.size for leg in legs]) - 1
    events = sum(leg.events for leg in legs)
    return Run(join("time"), join("x"), join("v"), join("force"), legs[-1].state, events, ends)


def push(
    law: AbstractFriction, force: Callable[[float], float], times: Sequence[float], mass: float, dashpot: float
) -> np.ndarray:
    """Displacement [m] at `times` [s] of a `mass` [kg] on the contact, from rest at times[0].

    `dashpot` [N s/m] damps it against the ground.  For laws that never hold it at v = 0.
    """
    contact = Contact(law)
    time, y = float(times[0]), np.append(contact.initial, [0.0, 0.0])
    sign = 1.0
    field = lambda t, y: np.append(
        contact.rate(y[:-2], y[-1], sign),
        [y[-1], (force(t) - dashpot * y[-1] - contact.force(y[:-2], y[-1], sign)) / mass],
    )
    guards = [_falling(lambda t, y, i=i: contact.guards(y[:-2], y[-1], sign)[i]) for i in range(contact.count)]
    reversal = _falling(lambda t, y: sign * y[-1])
    seen = [y[-2]]
    begins = True
    while time < times[-1]:
        if begins:
            sign = float(np.sign(force(time) - contact.force(y[:-2], 0.0, sign))) or 1.0
            y = np.concatenate([contact.on_reversal(y[:-2], sign), y[-2:]])
        ahead = [t for t in times if t > time]
        piece = solve_ivp(
            field,
            (time, ahead[-1]),
            y,
            t_eval=ahead,
            events=[reversal, *guards],
            method="DOP853",
            rtol=1e-9,
            atol=1e-15,
        )
        seen += [row[-2] for row in np.atleast_2d(np.transpose(piece.y))] if len(piece.t) else []
        begins = False
        if piece.status == 0:
            break
        which = next(i for i, t in enumerate(piece.t_events) if t.size)
        time, y = float(piece.t_events[which][0]), piece.y_events[which][0]
        if which:
            y = np.concatenate([contact.after_event(y[:-2], y[-1], sign, which - 1), y[-2:]])
        else:
            begins, y[-1] = True, 0.0
    return np.array(seen)
