"""The second simulator of `independent` with the other friction laws, each written from its equations alone.

Plain floats and SciPy's DOP853 in absolute coordinates.  A law whose force depends on the path
only (Dahl, Bliman and Sorine) is taken in its closed form along the path since the last
reversal; Coulomb's and Stribeck's maps really stick; what jumps (a bond that is dragged, an
element that slips) ends a piece by SciPy's event location.  No power series, no flags for
fast sliding, no steady states, no repetition.
"""

import dataclasses
import math
from typing import Any

import numpy as np
from independent import REST, STILL, Piece, Rig, corners
from scipy.integrate import solve_ivp

AHEAD = 1e-8
"""Time [s] by which a corner's consequences are looked at."""


class Law:
    """A contact: `z` its continuous memory, `form` all else it remembers, `d` the relative displacement [m].

    `way` is the sign of the relative velocity `v` [m/s].
    """

    atol: tuple[float, ...] = ()
    """Absolute tolerance of each continuous memory."""

    def born(self) -> Any:
        """The form before anything has moved."""
        return None

    def turned(self, z, form, d, way) -> Any:
        """The form with which a motion in the direction `way` begins at d."""
        return form

    def force(self, z, form, d, v, way) -> float:
        """Friction force on the end-effector [N]."""
        raise NotImplementedError

    def flow(self, z, form, d, v, way) -> list[float]:
        """Rates of the memory."""
        return []

    def room(self, z, form, d, v, way) -> list[float]:
        """Positive while the form lasts."""
        return []

    def next(self, z, form, d, way, which) -> Any:
        """The form after room number `which` is used up."""
        return form


def curve(v, f_c, f_s, v_s, delta=2.0):
    """The Stribeck curve [N]."""
    return f_c + (f_s - f_c) * math.exp(-(abs(v / v_s) ** delta))


@dataclasses.dataclass(frozen=True)
class Coulomb(Law):
    f_c: float = 0.65

    def force(self, z, form, d, v, way):
        return self.f_c * way


@dataclasses.dataclass(frozen=True)
class Stribeck(Law):
    f_c: float = 0.55
    f_s: float = 0.65
    v_s: float = 1e-3
    sigma2: float = 2.0
    delta: float = 2.0

    def force(self, z, form, d, v, way):
        return way * curve(v, self.f_c, self.f_s, self.v_s, self.delta) + self.sigma2 * v


@dataclasses.dataclass(frozen=True)
class LuGre(Law):
    sigma0: float = 1e6
    sigma1: float = 45.0
    sigma2: float = 2.0
    f_c: float = 0.55
    f_s: float = 0.65
    v_s: float = 1e-3
    atol = (1e-19,)

    def flow(self, z, form, d, v, way):
        return [v - self.sigma0 * abs(v) * z[0] / curve(v, self.f_c, self.f_s, self.v_s)]

    def force(self, z, form, d, v, way):
        return self.sigma0 * z[0] + self.sigma1 * self.flow(z, form, d, v, way)[0] + self.sigma2 * v


@dataclasses.dataclass(frozen=True)
class Elastoplastic(LuGre):
    elastic_part: float = 0.6

    def flow(self, z, form, d, v, way):
        most = curve(v, self.f_c, self.f_s, self.v_s) / self.sigma0
        least = self.elastic_part * min(self.f_c, self.f_s) / self.sigma0
        size = abs(z[0])
        if z[0] * way <= 0.0 or size <= least:
            return [v]
        alpha = 1.0
        if size < most:
            alpha = 0.5 + 0.5 * math.sin(math.pi * (size - 0.5 * (most + least)) / (most - least))
        return [v * (1.0 - alpha * size / most)]


@dataclasses.dataclass(frozen=True)
class Dahl(Law):
    """Form: displacement and force [N] at the last reversal."""

    sigma0: float = 1e6
    f_c: float = 0.65
    exponent: float = 1.0

    def born(self):
        return 0.0, 0.0, 1

    def turned(self, z, form, d, way):
        return d, self.force(z, form, d, 0.0, form[2]), way

    def force(self, z, form, d, v, way):
        begin, force, _ = form
        left, path = 1.0 - way * force / self.f_c, way * (d - begin) * self.sigma0 / self.f_c
        if self.exponent == 1.0:
            left *= math.exp(-path)
        else:
            rest = 1.0 - self.exponent
            left = max(max(left, 1e-300) ** rest - rest * path, 0.0) ** (1.0 / rest)
        return way * self.f_c * (1.0 - left)


@dataclasses.dataclass(frozen=True)
class BlimanSorine(Law):
    """Form: displacement at the last reversal, both parts of the force [N] there, and the direction since."""

    f_c: float = 0.55
    f_2: float = 0.3
    epsilon: float = 3e-6
    eta: float = 0.2

    def born(self):
        return 0.0, 0.0, 0.0, 1

    def parts(self, form, d):
        begin, first, second, way = form
        path, f_1 = way * (d - begin) / self.epsilon, self.f_c + self.f_2
        first = way * f_1 + (first - way * f_1) * math.exp(-path / self.eta)
        return first, way * self.f_2 + (second - way * self.f_2) * math.exp(-path)

    def turned(self, z, form, d, way):
        return d, *self.parts(form, d), way

    def force(self, z, form, d, v, way):
        first, second = self.parts((*form[:3], way), d)
        return first - second


@dataclasses.dataclass(frozen=True)
class ResetIntegrator(Law):
    """Form: the displacement at which the bond is loose, or the way that it is dragged; and whether it is."""

    sigma0: float = 1e6
    f_c: float = 0.55
    a: float = 0.2
    beta: float = 45.0

    def born(self):
        return 0.0, False

    def turned(self, z, form, d, way):
        loose, dragged = form
        # At the end of a slide in the other direction the bond begins to let up.
        return (d + way * self.f_c / self.sigma0, False) if dragged and loose != way else form

    def force(self, z, form, d, v, way):
        if form[1]:
            return way * self.f_c
        return (1.0 + self.a) * self.sigma0 * (d - form[0]) + self.beta * v

    def room(self, z, form, d, v, way):
        return [1.0] if form[1] else [self.f_c / self.sigma0 - way * (d - form[0])]

    def next(self, z, form, d, way, which):
        return way, True


@dataclasses.dataclass(frozen=True)
class GeneralizedMaxwellSlip(Law):
    """Form: for each element whether it slips."""

    stiffness_1: float = 4e5
    stiffness_2: float = 3e5
    stiffness_3: float = 2e5
    stiffness_4: float = 1e5
    strength_1: float = 0.06
    strength_2: float = 0.14
    strength_3: float = 0.2
    strength_4: float = 0.25
    weakened: float = 0.85
    v_s: float = 1e-3
    attraction: float = 3e3
    sigma2: float = 2.0
    atol = (1e-19,) * 4

    def _springs(self):
        return self.stiffness_1, self.stiffness_2, self.stiffness_3, self.stiffness_4

    def _limits(self):
        return self.strength_1, self.strength_2, self.strength_3, self.strength_4

    def born(self):
        return (False,) * 4

    def turned(self, z, form, d, way):
        springs = zip(z, self._springs(), self._limits(), strict=True)
        return tuple(bool(way * k * x >= w * (1 - 1e-12)) for x, k, w in springs)

    def force(self, z, form, d, v, way):
        return sum(k * x for k, x in zip(self._springs(), z, strict=True)) + self.sigma2 * v

    def flow(self, z, form, d, v, way):
        whole = sum(self._limits())
        level = curve(v, self.weakened * whole, whole, self.v_s)
        rates = []
        for x, k, w, slips in zip(z, self._springs(), self._limits(), form, strict=True):
            rates.append(self.attraction * (way * w / whole - k * x / level) / k if slips else v)
        return rates

    def room(self, z, form, d, v, way):
        left = curve(v, self.weakened, 1.0, self.v_s)
        springs = zip(z, self._springs(), self._limits(), form, strict=True)
        return [1.0 if slips else left * w - way * k * x for x, k, w, slips in springs]

    def next(self, z, form, d, way, which):
        return tuple(slips or i == which for i, slips in enumerate(form))


@dataclasses.dataclass(frozen=True)
class LawRig(Rig):
    """The rig of `independent` on a contact of any kind, and tilted."""

    law: Any = LuGre()
    tilt: float = 0.0

    def pulled(self) -> "LawRig":
        """The same rig with its weight along the tilt as a load."""
        return dataclasses.replace(self, load=self.load + self.mass * 9.80665 * math.sin(self.tilt), tilt=0.0)


@dataclasses.dataclass(frozen=True)
class Contact(Piece):
    """The equations of motion on one straight piece of voltage; x holds y, y', x_e, x_e' and the law's memory."""

    def push(self, t, x):
        r = self.rig
        u = self.voltage + self.slope * (t - self.begin)
        return r.frequency**2 * (r.gain * u - x[0]) - 2 * r.damping * r.frequency * x[1]

    def on_law(self, what, x, form, way, v=None):
        return what(x[4:], form, x[0] - x[2], x[1] - x[3] if v is None else v, way)

    def moving(self, t, x, form, way):
        """All rates while it slides."""
        r: Any = self.rig
        x = x.tolist()
        force = self.on_law(r.law.force, x, form, way)
        back = force / r.stack if r.feedback else 0.0
        pulled = [x[1], self.push(t, x) - back, x[3], (force + r.load) / r.mass]
        return np.array(pulled + self.on_law(r.law.flow, x, form, way))

    def riding(self, t, x):
        """All rates while both move as one body."""
        r: Any = self.rig
        x = x.tolist()
        force = self.holding(t, x)
        back = force / r.stack if r.feedback else 0.0
        return np.array([x[1], self.push(t, x) - back, x[3], (force + r.load) / r.mass] + [0.0] * (len(x) - 4))

    def bound(self, x, form, way):
        """The force with which a motion in the direction `way` would begin."""
        law: Any = self.rig.law  # pyright: ignore[reportAttributeAccessIssue]
        turned = law.turned(x[4:], form, x[0] - x[2], way)
        return self.on_law(law.force, x, turned, way, 0.0)

    def next_mode(self, t, x, form, came):
        """+1 or -1 as it starts to slide, 0 where neither direction has enough force."""
        x = x.copy()
        x[3] = x[1]
        if came == 0:
            x, t = x + AHEAD * self.riding(t, x), t + AHEAD
        needed = self.holding(t, x)
        forward, backward = needed > self.bound(x, form, 1), needed < self.bound(x, form, -1)
        if forward and backward:
            return -came if came else 1
        return 1 if forward else -1 if backward else 0

    def calm(self, t, x, form, mode):
        """Only creep is left, to within `STILL`."""
        r: Any = self.rig
        if mode != 0 and abs(x[1] - x[3]) > STILL * r.frequency:
            return False
        away = x[0] - r.gain * (self.voltage + self.slope * (t - self.begin - 2 * r.damping / r.frequency))
        away -= r.load / (r.stack * r.frequency**2) if r.feedback else 0.0
        if abs(away) > STILL or abs(x[1] - r.gain * self.slope) > STILL * r.frequency:
            return False
        return mode == 0 or abs(self.on_law(r.law.force, x, form, mode) + r.load) < STILL * 1e6


def simulate(rig: LawRig, times: np.ndarray, tolerance: float = 1e-12, longest: float = 2e-5) -> np.ndarray:
    """Platform and end-effector [m] and friction force [N] at ascending `times` > 0, shape (m, 3)."""
    rig = rig.pulled()
    state, form, mode = np.zeros(4 + len(rig.law.atol)), rig.law.born(), 0
    out = np.full((len(times), 3), np.nan)
    for begin, end, voltage, slope in corners(rig, times[-1] * (1 + 1e-15)):
        here, now = Contact(rig, begin, voltage, slope), begin
        if mode in (0, REST) or state[1] == state[3]:
            mode = here.next_mode(now, state, form, 0)
            form = begun(rig, state, form, mode)
        while now < end:
            state, form, now, mode = advance(here, (now, end), state, form, mode, times, out, (tolerance, longest))
    return out


def begun(rig, x, form, mode):
    """The form with which `mode` begins."""
    return rig.law.turned(x[4:], form, x[0] - x[2], mode) if mode in (1, -1) else form


def advance(here, span, state, form, mode, times, out, accuracy):
    """One mode in one form, up to its end or the end of the span; writes the samples on the way."""
    law, slides = here.rig.law, mode in (1, -1)
    rates = (lambda t, x: here.moving(t, x, form, mode)) if slides else here.riding
    events = []
    if slides:
        events.append(lambda t, x: mode * (x[1] - x[3]))
        count = len(here.on_law(law.room, state, form, mode))
        events += [lambda t, x, i=i: here.on_law(law.room, x, form, mode)[i] for i in range(count)]
    elif mode == 0:
        events.append(lambda t, x: here.bound(x, form, 1) - here.holding(t, x))
        events.append(lambda t, x: here.holding(t, x) - here.bound(x, form, -1))
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
    inside = (times > span[0]) & (times <= stop)
    if inside.any():
        seen = solved.sol(times[inside])
        force = here.on_law
        out[inside, 0], out[inside, 1] = seen[0], seen[2]
        out[inside, 2] = [
            force(law.force, x, form, mode) if slides else here.holding(t, x)
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
    return last, begun(here.rig, last, form, following), stop, following
