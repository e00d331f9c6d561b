"""The equations of motion in absolute coordinates, in every mode: what slides, what sticks, what pushes at a stop.

    m x_e'' = F + pull - P,   y'' as the stack has it, with feedback less (F + pull_0) / m_g

F is the friction force on the end-effector, P that of the stop; pull_0 is the pull where motion is counted from the
rest under it. A contact that sticks takes the force F* with which both accelerate alike.
"""

import dataclasses
from typing import Any

import numpy as np

from tests.reference.combinations.hysteresis import Piece
from tests.reference.combinations.rig import Rig

POSITION, VELOCITY, CREEP, FORCE = 1e-19, 1e-16, 1e-20, 1e-14
"""Absolute tolerances of positions [m], velocities [m/s], displacements by creep [m] and the stop's force [N]."""


@dataclasses.dataclass(frozen=True)
class Mode:
    """What stays as it is between two events."""

    way: int = 0
    """Sign of the relative velocity; 0 where the contact sticks."""
    form: Any = None
    """Of the law."""
    touches: bool = False
    """The end-effector is at the stop."""
    skipped: float = 0.0
    """The jumps of the platform so far [m]: at one the contact has no time to slide."""


@dataclasses.dataclass(frozen=True)
class Platform:
    """Displacement [m], velocity [m/s] and acceleration [m/s^2] without friction; rates of creep."""

    y: float
    dy: float
    ddy: float
    creep: list[float]


class Equations:
    """Rates and forces of a state x.

    It holds y and y' as far as the dynamics have them, creep, x_e and x_e', the contact's state, and the sensor's.
    """

    def __init__(self, rig: Rig):
        self.rig, self.law = rig, rig.law
        self.dynamics = rig.stack.dynamics
        self.effector = rig.stack.states
        self.contact = self.effector + (2 if rig.law else 0)
        self.sensor = self.contact + (len(rig.law.atol) if rig.law else 0)
        self.size = self.sensor + (1 if rig.sensor else 0)
        self.counted_from = rig.pull if rig.rests_under_load else 0.0

    def start(self) -> tuple[np.ndarray, Mode]:
        """State and mode before anything has moved."""
        x = np.zeros(self.size)
        if not self.law:
            return x, Mode()
        if not self.rig.rests_under_load:
            return x, Mode(form=self.law.born())
        x[self.contact : self.sensor], form = self.law.resting(-self.rig.pull)
        return x, Mode(form=form)

    def tolerances(self) -> np.ndarray:
        """Absolute tolerance of every state."""
        stack = self.rig.stack
        creep = CREEP if stack.creep_scale == 1 else POSITION / stack.creep_scale
        motion = [[], [POSITION], [POSITION, VELOCITY]]
        contact = [*motion[2], *self.law.atol] if self.law else []
        sensor = [FORCE if self.rig.stop else POSITION] if self.rig.sensor else []
        return np.array([*motion[self.dynamics.order], *[creep] * len(stack.creep), *contact, *sensor])

    def platform(self, t: float, x, piece: Piece) -> Platform:
        """The platform of a stack that no force is felt by."""
        stack, dynamics = self.rig.stack, self.dynamics
        u, du, ddu = piece.voltage.at(t)
        e = piece.expression.at(u)
        de, dde = piece.expression.derivatives(u, du, ddu) if dynamics.order < 2 else (0.0, 0.0)
        creep = []
        for (share, time), c in zip(stack.creep, x[dynamics.order :], strict=False):
            rate = (share * u - c) / time
            creep.append(rate)
            e += stack.creep_scale * c
            de += stack.creep_scale * rate
            dde += stack.creep_scale * (share * du - rate) / time
        if dynamics.order == 2:
            w, xi = dynamics.frequency, dynamics.damping
            return Platform(x[0], x[1], w * w * (e - x[0]) - 2 * xi * w * x[1], creep)
        if dynamics.order == 1:
            dy = (e - x[0]) / dynamics.time
            return Platform(x[0], dy, (de - dy) / dynamics.time, creep)
        return Platform(e, de, dde, creep)

    def relative_velocity(self, t: float, x, piece: Piece) -> float:
        """v = y' - x_e' [m/s]."""
        return self.platform(t, x, piece).dy - x[self.effector + 1]

    def slid(self, y: float, x, mode: Mode) -> float:
        """The relative displacement d [m] that the contact has gone through."""
        return y - x[self.effector] - mode.skipped

    def stop_force(self, x, mode: Mode) -> float:
        """P [N]"""
        stop = self.rig.stop
        if stop is None or not mode.touches:
            return 0.0
        return stop.stiffness * self.depth(x) * (1 + stop.dissipation * x[self.effector + 1])

    def depth(self, x) -> float:
        """How far the end-effector is beyond the gap [m]."""
        return x[self.effector] - self.rig.stop.gap

    def sticking_force(self, ddy: float, x, mode: Mode) -> float:
        """F* [N] where the platform without friction would accelerate with `ddy` [m/s^2]."""
        rig, mass = self.rig, self.dynamics.mass
        if rig.felt:
            ddy = ddy - self.counted_from / mass
        force = rig.mass * ddy - rig.pull + self.stop_force(x, mode)
        return force / (1 + rig.mass / mass) if rig.felt else force

    def bound(self, y: float, x, mode: Mode, way: int) -> float:
        """The force [N] with which a slide in the direction `way` would begin."""
        z, d = x[self.contact : self.sensor], self.slid(y, x, mode)
        return self.law.force(z, self.law.turned(z, mode.form, d, way), d, 0.0, way)

    def sticking_margins(self, t: float, x, piece: Piece, mode: Mode) -> tuple[float, float]:
        """How far [N] the sticking force is below the bound of a slide forward, and above that of one backward."""
        platform = self.platform(t, x, piece)
        force = self.sticking_force(platform.ddy, x, mode)
        return self.bound(platform.y, x, mode, 1) - force, force - self.bound(platform.y, x, mode, -1)

    def room(self, t: float, x, piece: Piece, mode: Mode) -> list[float]:
        """Positive while the contact's form lasts."""
        platform = self.platform(t, x, piece)
        z, v = x[self.contact : self.sensor], platform.dy - x[self.effector + 1]
        return self.law.room(z, mode.form, self.slid(platform.y, x, mode), v, mode.way)

    def rates(self, t: float, x: np.ndarray, piece: Piece, mode: Mode) -> list[float]:
        """x'"""
        x = x.tolist()
        rig, rates = self.rig, [0.0] * self.size
        platform = self.platform(t, x, piece)
        ddy, watched = platform.ddy, platform.y
        if self.law:
            force, moves = self.effector_rates(platform, x, mode)
            rates[self.effector : self.sensor] = moves
            if rig.felt:
                ddy -= (force + self.counted_from) / self.dynamics.mass
            if rig.of == "effector":
                watched = x[self.effector]
        rates[: self.effector] = [platform.dy, ddy][: self.dynamics.order] + platform.creep
        if rig.sensor:
            source = self.stop_force(x, mode) if rig.stop else watched
            rates[self.sensor] = rig.sensor.w * (source - x[self.sensor])
        return rates

    def effector_rates(self, platform: Platform, x: list[float], mode: Mode) -> tuple[float, list[float]]:
        """Friction force [N]; rates of the end-effector and of the contact."""
        rig = self.rig
        if mode.way == 0:
            force = self.sticking_force(platform.ddy, x, mode)
            felt = (force + self.counted_from) / self.dynamics.mass if rig.felt else 0.0
            return force, [platform.dy, platform.ddy - felt] + [0.0] * (self.sensor - self.contact)
        dx = x[self.effector + 1]
        at = x[self.contact : self.sensor], mode.form, self.slid(platform.y, x, mode), platform.dy - dx, mode.way
        force = self.law.force(*at)
        acceleration = (force + rig.pull - self.stop_force(x, mode)) / rig.mass
        return force, [dx, acceleration, *self.law.flow(*at)]

    def shown(self, t: float, x: np.ndarray, piece: Piece, mode: Mode) -> float:
        """What the record shows."""
        rig, rates, x = self.rig, self.rates(t, x, piece, mode), x.tolist()
        if rig.output == "stop_force":
            return x[self.sensor] if rig.sensor else self.stop_force(x, mode)
        platform = self.platform(t, x, piece)
        if rig.of == "effector":
            dx = x[self.effector + 1] if mode.way else platform.dy
            motion = x[self.effector], dx, rates[self.effector + 1]
        else:
            motion = platform.y, platform.dy, rates[1] if self.dynamics.order == 2 else platform.ddy
        if rig.sensor:
            # s' = w (x - s) and its derivative: the sensor's output is what is differentiated.
            ds = rates[self.sensor]
            motion = x[self.sensor], ds, rig.sensor.w * (motion[1] - ds)
        return motion[("displacement", "velocity", "acceleration").index(rig.output)]
