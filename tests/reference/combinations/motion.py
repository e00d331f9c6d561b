"""A second simulator of whole actuators: drive, amplifier, stack, contact, stop and sensor in any combination.

It shares no line with the package. Voltage and hysteresis are known in closed form on pieces (`drives`, `voltage`,
`hysteresis`); the rest is SciPy's DOP853 from event to event, the relative velocity taken from absolute coordinates. No
power series, no flags for fast sliding, no steady states, no repetition of cycles.
"""

import dataclasses
from collections.abc import Callable
from functools import cached_property

import numpy as np
from scipy.integrate import DOP853
from scipy.optimize import brentq

from tests.reference.combinations.equations import Equations
from tests.reference.combinations.hysteresis import Piece
from tests.reference.combinations.rig import Rig
from tests.reference.combinations.roots import EXACT, crossing
from tests.reference.combinations.transitions import Transitions

FIRST = 1e-8
"""First step [s] after an event."""
SHORT = 1e-13
"""What is left of a piece [s] and takes a single step of Euler's."""
ENDING = 1e-17
"""Velocity [m/s] below which a slide of a contact that never sticks is not taken to have ended."""
NEAR = 1e-6, 1e-4, 1e-3, 1e-2, 0.1, 0.25, 0.5, 0.75
"""Parts of a step, to find where a guard that begins on its border is positive."""
WITHIN = 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 0.95, 0.99, 1.0
"""Parts of a step, to find where a law runs out of room and has it again before the end."""
Event = tuple[float, int]
"""Time [s] and number of the guard."""


class Step:
    """A step that has been made, with its interpolation."""

    def __init__(self, solver: DOP853):
        self.solver, self.begin, self.end, self.last = solver, solver.t_old, solver.t, solver.y

    @cached_property
    def at(self) -> Callable[[float], np.ndarray]:
        """The state at a time [s]; it costs three evaluations of the rates."""
        return self.solver.dense_output()


class Motion:
    """The motion of a rig as it is integrated: state, mode, and the record so far."""

    def __init__(self, rig: Rig, times: np.ndarray, tolerance: float, longest: float):
        self.rig, self.equations = rig, Equations(rig)
        self.transitions = Transitions(self.equations)
        self.tolerance, self.longest = tolerance, longest
        self.atol = self.equations.tolerances() * (tolerance / 1e-12)
        self.state, self.mode = self.equations.start()
        self.relative_velocity, self.platform_end = 0.0, 0.0
        self.times = np.asarray(times) - (rig.sensor.delay if rig.sensor else 0.0)
        self.record = np.zeros(self.times.size)
        self.seen = int(np.searchsorted(self.times, 0.0))

    def run(self) -> np.ndarray:
        """What the record shows at every time; 0 up to the sensor's delay."""
        for piece in self.rig.pieces(self.times[-1] + 1e-9):
            if self.seen < self.times.size:
                self.follow(piece)
        return self.record

    def follow(self, piece: Piece) -> None:
        """One piece of the voltage."""
        now, end = piece.voltage.begin, piece.voltage.end
        if self.rig.law:
            self.begin(piece)
        while now < end - 1e-18:
            if end - now < SHORT:
                self.state = self.state + (end - now) * np.array(self.rates(piece)(now, self.state))
                break
            now = self.advance(piece, now)
        if self.rig.law:
            stuck = self.mode.way == 0
            self.relative_velocity = 0.0 if stuck else self.equations.relative_velocity(end, self.state.tolist(), piece)
            if stuck:
                self.state = self.transitions.carried(end, self.state, piece)
            self.platform_end = self.equations.platform(end, self.state.tolist(), piece).y

    def begin(self, piece: Piece) -> None:
        """What the corner at the begin of a piece makes of state and mode."""
        now = piece.voltage.begin
        if self.equations.dynamics.order == 0:
            jump = self.equations.platform(now, self.state.tolist(), piece).y - self.platform_end
            self.mode = dataclasses.replace(self.mode, skipped=self.mode.skipped + jump)
        self.state, self.mode = self.transitions.at_piece(now, self.state, piece, self.mode, self.relative_velocity)

    def rates(self, piece: Piece) -> Callable[[float, np.ndarray], list[float]]:
        """The right side of the present mode."""
        mode = self.mode
        return lambda t, x: self.equations.rates(t, x, piece, mode)

    def advance(self, piece: Piece, now: float) -> float:
        """One mode up to its end or that of the piece, and the time [s] of it; samples on the way are recorded."""
        end = piece.voltage.end
        accuracy = dict(rtol=self.tolerance, atol=self.atol, max_step=self.longest, first_step=min(FIRST, end - now))
        solver = DOP853(self.rates(piece), now, self.state, end, **accuracy)
        while solver.status == "running":
            message = solver.step()
            assert solver.status != "failed", message
            step = Step(solver)
            event = self.event(piece, step)
            self.note(piece, step, event[0] if event else step.end)
            if event:
                when, which = event
                state = step.at(when)
                rooms = len(self.room(piece, when, state))
                self.state, self.mode = self.transitions.after_event(when, state, piece, self.mode, which, rooms)
                return when
        self.state = solver.y.copy()
        return end

    def note(self, piece: Piece, step: Step, until: float) -> None:
        """Records the samples up to `until` [s]."""
        while self.seen < self.times.size and self.times[self.seen] <= until:
            time = self.times[self.seen]
            self.record[self.seen] = self.equations.shown(time, step.at(time), piece, self.mode)
            self.seen += 1

    def room(self, piece: Piece, t: float, x: np.ndarray) -> list[float]:
        """Of the law; none where it sticks."""
        return self.equations.room(t, x.tolist(), piece, self.mode) if self.mode.way else []

    def guards(self, piece: Piece, t: float, x: np.ndarray) -> list[float]:
        """Positive inside the mode, in the order in which `Transitions.after_event` counts them."""
        if not self.rig.law:
            return []
        values, equations, mode = x.tolist(), self.equations, self.mode
        if mode.way:
            v = equations.relative_velocity(t, values, piece)
            guards = [mode.way * v + (0.0 if self.rig.law.sticks else ENDING), *self.room(piece, t, x)]
        else:
            guards = [*equations.sticking_margins(t, values, piece, mode)]
        if self.rig.stop:
            depth = equations.depth(values)
            guards.append(depth if mode.touches else -depth)
        return guards

    def event(self, piece: Piece, step: Step) -> Event | None:
        """The first event of the last step."""
        found = [i for i, guard in enumerate(self.guards(piece, step.end, step.last)) if guard < 0]
        events = [(self.root(piece, step, i), i) for i in found]
        event = min(events) if events else None
        return self.room_used_up(piece, step, event) or event

    def root(self, piece: Piece, step: Step, which: int) -> float:
        """Where a guard that is negative at the end of the step falls through zero."""
        begin = step.begin
        guard = lambda t: self.guards(piece, t, step.at(t))[which]
        if guard(begin) <= 0:
            # It begins on its border.
            inside = [step.begin + part * (step.end - step.begin) for part in NEAR]
            begin = next((t for t in inside if guard(t) > 0), None)
        return step.begin if begin is None else brentq(guard, begin, step.end, **EXACT)

    def room_used_up(self, piece: Piece, step: Step, event: Event | None) -> Event | None:
        """A law's room that is used up within the step, before `event`, and may be there again at its end."""
        count = len(self.room(piece, step.end, step.last)) if self.rig.law else 0
        if not count:
            return None
        begin, last = step.begin, event[0] if event else step.end
        for part in WITHIN:
            here = begin + part * (last - begin)
            guards = self.guards(piece, here, step.at(here))
            found = [i for i in range(1, 1 + count) if guards[i] < 0 and not (event and event[1] == i)]
            events = []
            for i in found:
                guard = lambda t, i=i: self.guards(piece, t, step.at(t))[i]
                events.append((crossing(guard, begin, here) if guard(begin) > 0 else begin, i))
            earlier = [e for e in events if event is None or e[0] < event[0]]
            if found:
                return min(earlier) if earlier else None
        return None


def simulate(rig: Rig, times: np.ndarray, tolerance: float = 1e-12, longest: float = 2e-5) -> np.ndarray:
    """What a rig's record shows at ascending `times` [s], in SI units, shape (times,); `longest` is the step [s]."""
    return Motion(rig, times, tolerance, longest).run()
