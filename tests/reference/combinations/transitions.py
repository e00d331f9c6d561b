"""What follows when a slide ends, a contact lets go, a law changes its form, or a piece of the voltage begins."""

import dataclasses
import math

import numpy as np

from tests.reference.combinations.equations import Equations, Mode
from tests.reference.combinations.hysteresis import Piece

AHEAD = 1e-9, 1e-8, 1e-7
"""Times [s] by which a motion is followed as if it stuck, to see which way it wants."""
JUMP = 1e-13
"""Relative velocity [m/s] above which it has jumped."""


class Transitions:
    """State and mode where the equations change."""

    def __init__(self, equations: Equations):
        self.equations, self.law = equations, equations.law

    def begun(self, t: float, x: np.ndarray, piece: Piece, mode: Mode, way: int, v: float = 0.0) -> Mode:
        """The mode `way`, with the form in which it begins."""
        form = mode.form
        if way:
            d = self.equations.slid(self.equations.platform(t, x.tolist(), piece).y, x.tolist(), mode)
            form = self.law.turned(self.contact_state(x), form, d, way, v)
        return dataclasses.replace(mode, way=way, form=form)

    def contact_state(self, x: np.ndarray) -> list[float]:
        """The law's part of the state."""
        return x[self.equations.contact : self.equations.sensor].tolist()

    def carried(self, t: float, x: np.ndarray, piece: Piece) -> np.ndarray:
        """The state with the end-effector as fast as the platform."""
        x = x.copy()
        x[self.equations.effector + 1] = self.equations.platform(t, x.tolist(), piece).dy
        return x

    def from_rest(self, t: float, x: np.ndarray, piece: Piece, mode: Mode, before: int) -> int:
        """The direction that follows v = 0, where the slide was in the direction `before`; 0 sticks."""
        x = self.carried(t, x, piece)
        at_once = self.equations.sticking_margins
        upper, lower = at_once(t, x.tolist(), piece, mode) if before else self.margins_ahead(t, x, piece, mode)
        if upper >= 0 and lower >= 0:
            return 0 if self.law.sticks or (upper > 0 and lower > 0) else (-before or 1)
        if upper < 0 and lower < 0:
            return -before or 1
        way = 1 if upper < 0 else -1
        # It cannot go on as before: that slide has just ended.
        return -way if way == before else way

    def margins_ahead(self, t: float, x: np.ndarray, piece: Piece, mode: Mode) -> tuple[float, float]:
        """The margins a little later, later still for a contact without any: forces may be equal where both begin."""
        stuck, upper, lower = dataclasses.replace(mode, way=0), 0.0, 0.0
        for ahead in AHEAD:
            now, later = t, x
            for _ in range(4):
                first = np.array(self.equations.rates(now, later, piece, stuck))
                middle = later + ahead / 8 * first
                later = later + ahead / 4 * np.array(self.equations.rates(now + ahead / 8, middle, piece, stuck))
                now += ahead / 4
            upper, lower = self.equations.sticking_margins(now, later.tolist(), piece, mode)
            if self.law.sticks or upper != 0.0 or lower != 0.0:
                break
        return upper, lower

    def at_piece(self, t: float, x: np.ndarray, piece: Piece, mode: Mode, before: float) -> tuple[np.ndarray, Mode]:
        """State and mode as a piece begins, after a relative velocity `before` [m/s] at the end of the last."""
        v = self.equations.relative_velocity(t, x.tolist(), piece)
        jumped = self.equations.dynamics.order < 2 and abs(v - before) > JUMP
        if jumped and (mode.way == 0 or v != 0.0):
            way = int(math.copysign(1, v))
            if way != mode.way or before == 0.0:
                return x, self.begun(t, x, piece, mode, way, v)
            d = self.equations.slid(self.equations.platform(t, x.tolist(), piece).y, x.tolist(), mode)
            form = self.law.jumped(self.contact_state(x), mode.form, d, v, way)
            return x, dataclasses.replace(mode, form=form)
        if mode.way == 0 or v == 0.0:
            way = self.from_rest(t, x, piece, mode, 0)
            mode = dataclasses.replace(mode, way=0) if way == 0 else self.unless_same(t, x, piece, mode, way)
            if abs(v) < JUMP:
                x = x.copy()
                x[self.equations.effector + 1] += v
        return x, mode

    def unless_same(self, t: float, x: np.ndarray, piece: Piece, mode: Mode, way: int) -> Mode:
        """The slide `way`, begun anew unless it was one already."""
        return mode if way == mode.way else self.begun(t, x, piece, mode, way)

    def after_event(
        self, t: float, x: np.ndarray, piece: Piece, mode: Mode, which: int, rooms: int
    ) -> tuple[np.ndarray, Mode]:
        """State and mode after guard number `which`.

        Guards are, of a slide its end and the law's `rooms`, of a rest its two bounds; then that of the stop.
        """
        if which >= (1 + rooms if mode.way else 2):
            mode = dataclasses.replace(mode, touches=not mode.touches)
            if mode.way:
                return x, mode
            return x, self.begun(t, x, piece, mode, self.from_rest(t, x, piece, mode, 0))
        if mode.way == 0:
            way = 1 if which == 0 else -1
            return self.carried(t, x, piece), self.begun(t, x, piece, mode, way)
        if which == 0:
            x = self.carried(t, x, piece)
            return x, self.begun(t, x, piece, mode, self.from_rest(t, x, piece, mode, mode.way))
        d = self.equations.slid(self.equations.platform(t, x.tolist(), piece).y, x.tolist(), mode)
        form = self.law.next(self.contact_state(x), mode.form, d, mode.way, which - 1)
        return x, dataclasses.replace(mode, form=form)
