"""A second simulator, sharing no line with the package: slow, plain, for tests to compare against.

A second-order stack under a sawtooth, with any contact of `laws`, each written from its equations alone.  Absolute
coordinates, SciPy's DOP853 in every mode, the platform integrated like the rest.  A law whose force depends on the path
only (Dahl, Bliman and Sorine) is taken in its closed form along the path since the last reversal; Coulomb's and
Stribeck's maps really stick; what jumps (a bond that is dragged, an element that slips) ends a piece by SciPy's event
location.  No power series, no flags for fast sliding, no steady states, no repetition.
"""

import dataclasses
import math
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from tests.reference.laws.anisotropic_lugre import AnisotropicLuGre

REST = 2
"""The mode of what rides along until the next corner; +1, -1 and 0 slide and stick."""
STILL = 1e-17
"""Deviation [m] from rest below which the contact is taken to ride along until the next corner."""
AHEAD = 1e-8
"""Time [s] by which a corner's consequences are looked at."""


@dataclasses.dataclass(frozen=True)
class Rig:
    """The thesis's actuator under a sawtooth; (a, b) pairs hold v >= 0 and v < 0."""

    gain: float = 1.007e-7
    frequency: float = 6736.0
    damping: float = 0.1772
    stack: float = 0.56
    mass: float = 0.086
    load: float = 0.0
    s0: tuple[float, float] = (1.1484e6, 0.953789e6)
    s1: tuple[float, float] = (54.4, 38.9)
    f_ss: tuple[float, float] = (0.7964, 0.5458)
    reading: str = "deflection"
    feedback: bool = False
    voltage: float = 64.0
    cycle: float = 0.2
    fall: float = 0.0
    forward: bool = True
    rests_under_load: bool = False
    """Motion begins, and is counted, from where the load has brought contact and stack to rest."""
    tilt: float = 0.0
    law: Any = None
    """The contact, in place of the anisotropic one that the pairs describe."""

    @property
    def contact(self) -> Any:
        return self.law or AnisotropicLuGre(*self.s0, *self.s1, *self.f_ss, self.reading)

    def pulled(self) -> "Rig":
        """The same rig with its weight along the tilt as a load."""
        return dataclasses.replace(self, load=self.load + self.mass * 9.80665 * math.sin(self.tilt), tilt=0.0)

    def start(self) -> np.ndarray:
        """y, y', x_e, x_e' and the contact's state at t = 0."""
        start = np.zeros(4 + len(self.contact.atol))
        if self.rests_under_load:
            start[4] = -self.load / (1.0 if self.reading == "force" else self.s0[0 if self.load <= 0.0 else 1])
            start[[0, 2]] = self.load / (self.stack * self.frequency**2) if self.feedback else 0.0
        return start


def corners(rig: Rig, until: float) -> list[tuple[float, float, float, float]]:
    """(begin, end, voltage at the begin, slope) of every piece of the sawtooth."""
    pieces, k = [], 0
    while k * rig.cycle < until:
        begin, end = k * rig.cycle, (k + 1) * rig.cycle
        fall = 0.0 if rig.forward and k == 0 else rig.fall
        high, low = (rig.voltage, 0.0) if rig.forward else (0.0, rig.voltage)
        if fall > 0:
            pieces.append((begin, begin + fall, high, (low - high) / fall))
        pieces.append((begin + fall, end, low, (high - low) / (end - begin - fall)))
        k += 1
    return [(a, min(b, until), u, s) for a, b, u, s in pieces if a < until]


@dataclasses.dataclass(frozen=True)
class Piece:
    """The equations of motion on one straight piece of voltage; x holds y, y', x_e, x_e' and the law's state."""

    rig: Rig
    law: Any
    begin: float
    voltage: float
    slope: float

    def push(self, t, x):
        """y'' without friction."""
        r = self.rig
        u = self.voltage + self.slope * (t - self.begin)
        return r.frequency**2 * (r.gain * u - x[0]) - 2 * r.damping * r.frequency * x[1]

    def sticking_force(self, t, x):
        """The force that makes both move as one body."""
        r = self.rig
        if not r.feedback:
            return r.mass * self.push(t, x) - r.load
        return r.mass * (r.stack * self.push(t, x) + r.load) / (r.stack + r.mass) - r.load

    def on_law(self, what, x, form, way, v=None):
        return what(x[4:], form, x[0] - x[2], x[1] - x[3] if v is None else v, way)

    def moving(self, t, x, form, way):
        """All rates while it slides."""
        x = x.tolist()
        return np.array(
            self.rates(t, x, self.on_law(self.law.force, x, form, way), self.on_law(self.law.flow, x, form, way))
        )

    def riding(self, t, x):
        """All rates while both move as one body."""
        x = x.tolist()
        return np.array(self.rates(t, x, self.sticking_force(t, x), [0.0] * (len(x) - 4)))

    def rates(self, t, x, force, flow):
        back = force / self.rig.stack if self.rig.feedback else 0.0
        return [x[1], self.push(t, x) - back, x[3], (force + self.rig.load) / self.rig.mass, *flow]

    def begun(self, x, form, way):
        """The form with which a mode begins."""
        return self.law.turned(x[4:], form, x[0] - x[2], way) if way in (1, -1) else form

    def bound(self, x, form, way):
        """The force with which a motion in the direction `way` would begin."""
        return self.on_law(self.law.force, x, self.begun(x, form, way), way, 0.0)

    def next_mode(self, t, x, form, previous_mode):
        """+1 or -1 as it starts to slide, 0 where neither direction has enough force."""
        x = x.copy()
        x[3] = x[1]
        if previous_mode == 0:
            x, t = x + AHEAD * self.riding(t, x), t + AHEAD
        needed = self.sticking_force(t, x)
        forward, backward = needed > self.bound(x, form, 1), needed < self.bound(x, form, -1)
        if forward and backward:
            return -previous_mode if previous_mode else 1
        return 1 if forward else -1 if backward else 0

    def calm(self, t, x, form, mode):
        """Only creep is left, to within `STILL`."""
        r = self.rig
        if mode != 0 and abs(x[1] - x[3]) > STILL * r.frequency:
            return False
        away = x[0] - r.gain * (self.voltage + self.slope * (t - self.begin - 2 * r.damping / r.frequency))
        away -= r.load / (r.stack * r.frequency**2) if r.feedback else 0.0
        if abs(away) > STILL or abs(x[1] - r.gain * self.slope) > STILL * r.frequency:
            return False
        return mode == 0 or abs(self.on_law(self.law.force, x, form, mode) + r.load) < STILL * 1e6


def simulate(rig: Rig, times: np.ndarray, tolerance: float = 1e-12, longest: float = 1e-4) -> np.ndarray:
    """Platform and end-effector [m] and friction force [N] at ascending `times` > 0, shape (m, 3)."""
    rig = rig.pulled()
    law, state, mode = rig.contact, rig.start(), 0
    form, out = law.born(), np.full((len(times), 3), np.nan)
    for begin, end, voltage, slope in corners(rig, times[-1] * (1 + 1e-15)):
        here, now = Piece(rig, law, begin, voltage, slope), begin
        if mode in (0, REST) or state[1] == state[3]:
            mode = here.next_mode(now, state, form, 0)
            form = here.begun(state, form, mode)
        while now < end:
            state, form, now, mode = advance(here, (now, end), state, form, mode, times, out, (tolerance, longest))
    return out - [rig.start()[0], rig.start()[2], 0.0]


def advance(here, span, state, form, mode, times, out, accuracy):
    """One mode in one form, up to its end or the end of the span; writes the samples on the way."""
    law, slides = here.law, mode in (1, -1)
    rates = (lambda t, x: here.moving(t, x, form, mode)) if slides else here.riding
    events = []
    if slides:
        events.append(lambda t, x: mode * (x[1] - x[3]))
        count = len(here.on_law(law.room, state, form, mode))
        events += [lambda t, x, i=i: here.on_law(law.room, x, form, mode)[i] for i in range(count)]
    elif mode == 0:
        events.append(lambda t, x: here.bound(x, form, 1) - here.sticking_force(t, x))
        events.append(lambda t, x: here.sticking_force(t, x) - here.bound(x, form, -1))
    if mode != REST:
        events.append(lambda t, x: 0.5 - here.calm(t, x, form, mode))
    for event in events:
        event.terminal, event.direction = True, -1
    solved = solve_ivp(
        rates,
        span,
        state,
        method="DOP853",
        rtol=accuracy[0],
        atol=np.array([1e-19, 1e-16, 1e-19, 1e-16, *law.atol]),
        events=events,
        max_step=1e-2 if mode == REST else accuracy[1],
        dense_output=True,
    )
    assert solved.success, solved.message
    stop, last = solved.t[-1], solved.y[:, -1].copy()
    turns = slides and solved.t_events[0].size
    if turns and (stop == span[0] or min(here.on_law(law.room, last, form, mode), default=0.0) < -1e-15):
        # solve_ivp asks at ends of steps only and takes one event of each: the first step went over the whole motion
        # up to where it reverses, or a room fell within the step that did.
        return advance(here, span, state, form, mode, times, out, (accuracy[0], 0.1 * accuracy[1]))
    inside = (times > span[0]) & (times <= stop)
    if inside.any():
        seen = solved.sol(times[inside])
        force = here.on_law
        out[inside, 0], out[inside, 1] = seen[0], seen[2]
        out[inside, 2] = [
            force(law.force, x, form, mode) if slides else here.sticking_force(t, x)
            for t, x in zip(times[inside], seen.T, strict=True)
        ]
    if mode == REST or solved.status == 0:
        return last, form, span[1], mode
    which = next(i for i, when in enumerate(solved.t_events) if when.size)
    if which == len(events) - 1:
        return last, form, stop, REST
    if slides and which > 0:
        return last, law.next(last[4:], form, last[0] - last[2], mode, which - 1), stop, mode
    last[3] = last[1]
    following = here.next_mode(stop, last, form, mode) if slides else 1 - 2 * which
    return last, here.begun(last, form, following), stop, following
