"""A second simulator, sharing no line with the package: slow, plain, for tests to compare against.

Absolute coordinates, SciPy's DOP853 in every mode, the platform integrated like the rest, no
steady states, no closed forms, no repetition: each of these the package has and this has not.
"""

import dataclasses

import numpy as np
from scipy.integrate import solve_ivp

REST = 2
"""The mode of what rides along until the next corner; +1, -1 and 0 slide and stick."""
STILL = 1e-17
"""Deviation [m] from rest below which the contact is taken to ride along until the next corner."""


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

    def start(self) -> np.ndarray:
        """y, y', x_e, x_e' and the contact's state at t = 0."""
        start = np.zeros(5)
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


def simulate(rig: Rig, times: np.ndarray, tolerance: float = 1e-12) -> np.ndarray:
    """Platform and end-effector [m] and friction force [N] at ascending `times` > 0, shape (m, 3)."""
    state, mode = rig.start(), None
    out = np.zeros((len(times), 3))
    for begin, end, voltage, slope in corners(rig, times[-1] * (1 + 1e-15)):
        here = Piece(rig, begin, voltage, slope)
        now = begin
        if mode in (None, 0, REST) or state[1] == state[3]:
            mode = here.leaves(now, state, 0)
        while now < end:
            state, now, mode = advance(here, now, end, state, mode, times, out, tolerance)
    return out - [rig.start()[0], rig.start()[2], 0.0]


@dataclasses.dataclass(frozen=True)
class Piece:
    """The equations of motion on one straight piece of voltage."""

    rig: Rig
    begin: float
    voltage: float
    slope: float

    def push(self, t, x):
        """y'' without friction."""
        r = self.rig
        u = self.voltage + self.slope * (t - self.begin)
        return r.frequency**2 * (r.gain * u - x[0]) - 2 * r.damping * r.frequency * x[1]

    def contact(self, x, mode):
        """Force on the end-effector and rate of the contact state, with the branch `mode` of the law."""
        r, k = self.rig, 0 if mode > 0 else 1
        v, s0, s1 = x[1] - x[3], r.s0[k], r.s1[k]
        elastic = s0 * x[4] if r.reading == "deflection" else x[4]
        flow = v - mode * v * elastic / r.f_ss[k]
        return elastic + s1 * flow, flow if r.reading == "deflection" else s0 * flow

    def sticking_force(self, t, x):
        """The force that makes both move as one body."""
        r = self.rig
        if not r.feedback:
            return r.mass * self.push(t, x) - r.load
        return r.mass * (r.stack * self.push(t, x) + r.load) / (r.stack + r.mass) - r.load

    def rates(self, t, x, mode):
        r = self.rig
        force, flow = (self.sticking_force(t, x), 0.0) if mode == 0 else self.contact(x, mode)
        back = force / r.stack if r.feedback else 0.0
        return np.array([x[1], self.push(t, x) - back, x[3], (force + r.load) / r.mass, flow])

    def relative(self, t, x, mode):
        """v' on one side of v = 0."""
        rates = self.rates(t, x, mode)
        return rates[1] - rates[3]

    def leaves(self, t, x, previous_mode):
        """The mode after v = 0: 0 where both sides push back."""
        x = x.copy()
        x[3] = x[1]
        if previous_mode == 0:  # a corner, or a contact that lets go: look a little ahead, riding along
            for _ in range(10):
                x = x + 1e-9 * self.rates(t, x, 0)
                t += 1e-9
        forward, backward = self.relative(t, x, 1) > 0, self.relative(t, x, -1) < 0
        if forward and backward:
            return -previous_mode if previous_mode else 1
        return 1 if forward else -1 if backward else 0

    def still(self, t, x, mode):
        """Only creep is left, to within `STILL`."""
        r = self.rig
        if mode != 0 and abs(x[1] - x[3]) > STILL * r.frequency:
            return False
        delay = 2 * r.damping / r.frequency
        away = x[0] - r.gain * (self.voltage + self.slope * (t - self.begin - delay))
        away -= r.load / (r.stack * r.frequency**2) if r.feedback else 0.0
        settled = abs(away) < STILL and abs(x[1] - r.gain * self.slope) < STILL * r.frequency
        return settled and (mode == 0 or abs(self.contact(x, mode)[0] + r.load) < STILL * r.s0[0])


def advance(here, now, end, state, mode, times, out, tolerance, longest=1e-4):
    """One mode, up to its end or `end`; writes the samples on the way."""
    resting, sliding = mode == REST, mode in (1, -1)

    def crosses(t, x):
        return mode * (x[1] - x[3])

    def frees_forward(t, x):
        return here.contact(here_at_rest(x), 1)[0] - here.sticking_force(t, x)

    def frees_backward(t, x):
        return here.sticking_force(t, x) - here.contact(here_at_rest(x), -1)[0]

    def calm(t, x):
        return 0.5 - here.still(t, x, mode)

    events = [crosses] if sliding else [frees_forward, frees_backward]
    for event in (*events, calm):
        event.terminal, event.direction = True, -1
    solved = solve_ivp(
        lambda t, x: here.rates(t, x, 0 if resting else mode),
        (now, end),
        state,
        method="DOP853",
        rtol=tolerance,
        atol=np.array([1e-19, 1e-16, 1e-19, 1e-16, 1e-19 if here.rig.reading == "deflection" else 1e-13]),
        events=[] if resting else [*events, calm],
        max_step=1e-2 if resting else longest,
        dense_output=True,
    )
    assert solved.success, solved.message
    stop, last = solved.t[-1], solved.y[:, -1].copy()
    if sliding and stop == now:
        # solve_ivp asks at ends of steps only: its first went over a whole motion, up to where that has reversed.
        return advance(here, now, end, state, mode, times, out, tolerance, 0.1 * longest)
    inside = (times > now) & (times <= stop)
    if inside.any():
        seen = solved.sol(times[inside])
        out[inside, 0], out[inside, 1] = seen[0], seen[2]
        riding = resting or not sliding
        force = [
            here.sticking_force(t, x) if riding else here.contact(x, mode)[0]
            for t, x in zip(times[inside], seen.T, strict=True)
        ]
        out[inside, 2] = force
    if resting or stop >= end:
        return last, end, mode
    if solved.t_events[-1].size:
        return last, stop, REST
    last[3] = last[1]
    if sliding:
        return last, stop, here.leaves(stop, last, mode)
    return last, stop, 1 if solved.t_events[0].size else -1


def here_at_rest(x):
    """The state with the relative velocity taken away."""
    x = x.copy()
    x[3] = x[1]
    return x
