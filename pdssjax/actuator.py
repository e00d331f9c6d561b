"""Joins drive, piezo, friction and end-effector: the vector field, its modes, its events.

Relative motion d = y - x_e, v = d'.  With friction force F on the end-effector,

    v' = y'' - (F + load) / m_e,      y'' = free acceleration [ - F / m_g ],

the bracket with friction feedback (5.25), without it (5.27).  The field is smooth while v
keeps its sign.  At v = 0 the force may jump from F(-) to F(+), and F* is the force that
would keep v = 0 (Filippov):

- F(-) <= F* <= F(+): the contact sticks, v stays 0, until F* leaves the interval;
- otherwise v takes the sign that its acceleration has on the side it moves to.

A set-valued law (Coulomb) and the switching parameters of (5.22) are both of this shape.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from .drive.base import AbstractDrive, Segment
from .effector import Effector
from .friction.base import AbstractFriction
from .integration import RESTING
from .piezo.base import AbstractPiezo

ADVANCING, STUCK, RETREATING = 1.0, 0.0, -1.0
"""Modes: v > 0, v = 0 held by friction, v < 0; the fourth is `RESTING`."""

_LOOK_AHEAD = 1e-9
"""Time [s] by which a tie between modes is broken: far below every time constant."""


class State(NamedTuple):
    """Relative displacement and velocity, platform displacement and velocity, contact memory."""

    d: Any
    v: Any
    y: Any
    w: Any
    memory: tuple


class Actuator(eqx.Module):
    """A piezo stack with platform, and an end-effector held on it by friction."""

    piezo: AbstractPiezo
    friction: AbstractFriction
    effector: Effector = Effector()
    feedback: bool = eqx.field(static=True, default=False)
    """Friction acts back on the platform (5.25); else the platform ignores it (5.27)."""


class StickSlip(eqx.Module):
    """The hybrid system of one actuator under one drive, as `integration` wants it."""

    actuator: Actuator
    drive: AbstractDrive

    def initial(self) -> State:
        zero = jnp.zeros(())
        return State(zero, zero, zero, zero, self.actuator.friction.initial())

    def segment(self, index) -> Segment:
        return self.drive.segment(index)

    def period(self) -> tuple[int, int] | None:
        return self.drive.period()

    def displaced(self) -> tuple[int, ...]:
        """The components, counted as in `State`, of which the displacements are made."""
        return (0, 2) if self.actuator.feedback else (0,)

    def scales(self) -> State:
        """What one unit of each state amounts to as a displacement [m]."""
        one, slow = jnp.ones(()), 1.0 / self.actuator.piezo.rate()
        return State(one, slow, one, slow, self.actuator.friction.length())

    def field(self, segment: Segment, after, x: State, mode) -> State:
        """Time derivative of the state in `mode`, `after` [s] into a segment."""
        moves, held, _ = _kind(mode)
        free = self._free(segment, after, x)
        force = self.actuator.friction.force(x.memory, x.v, mode)
        sliding = self._platform(free, force)
        relative = sliding - (force + self.actuator.effector.load) * (1.0 / self.actuator.effector.mass)
        stuck = self._platform(free, self._holding(free)) if self.actuator.feedback else free
        rates = self.actuator.friction.rate(x.memory, x.v, mode)
        return State(
            x.v * moves,
            relative * moves,
            x.w * 1.0,
            sliding * moves + stuck * held,
            tuple(rate * moves for rate in rates),
        )

    def guards(self, segment: Segment, after, x: State, mode) -> tuple[Any, Any]:
        """Positive inside the mode, which ends where the first of them falls through zero."""
        moves, held, rests = _kind(mode)
        upper, lower = self._margins(segment, after, x)
        return x.v * (moves * mode) + upper * held + rests, lower * held + (moves + rests)

    def switch(self, segment: Segment, after, x: State, mode) -> tuple[State, Any]:
        """State and mode where v has reached 0, or where the contact has let go."""
        x = x._replace(v=jnp.zeros_like(x.v))
        return x, self._mode_at_rest(segment, after, x, came=mode)

    def enter(self, segment: Segment, x: State, mode) -> Any:
        """The mode in which a new segment begins; the state is continuous at a corner."""
        standing = (jnp.abs(mode) != 1.0) | (x.v == 0.0)
        return jnp.where(standing, self._mode_at_rest(segment, 0.0, x, came=0.0), mode)

    def settled(self, segment: Segment, after, x: State, mode, tolerance):
        """Nothing but the steady creep of the platform is left, to within `tolerance` [m].

        A sliding contact has settled once every deviation from the steady solution is
        below the tolerance; a stuck one already when the ringing that is left in the
        platform can no longer free it.
        """
        rate = self.actuator.piezo.rate()
        y, w = self._steady(segment, after)
        ringing = jnp.maximum(jnp.abs(x.y - y), jnp.abs(x.w - w) / rate)
        memory, _ = self._relaxed(x)
        lengths = self.actuator.friction.length()
        away = [jnp.abs(a - b) * c for a, b, c in zip(x.memory, memory, lengths, strict=True)]
        still = 2.0 * jnp.abs(x.v) / rate < tolerance
        for distance in away:
            still &= distance < tolerance
        still &= ringing < tolerance
        upper, lower = self._margins(segment, after, x)
        shake = 4.0 * self.actuator.effector.mass * rate**2 * ringing
        safe = (jnp.minimum(upper, lower) > shake) & (ringing < tolerance if self.actuator.feedback else True)
        return jnp.where(jnp.abs(mode) == 1.0, still, (mode == STUCK) & safe)

    def settle(self, segment: Segment, after, x: State, mode) -> State:
        """The state with the last of the deviations gone, elastic recovery included."""
        slid = jnp.abs(mode) == 1.0
        memory, yields = self._relaxed(x)
        y, w = self._steady(segment, after) if self.actuator.feedback else (x.y, x.w)
        return State(
            jnp.where(slid, x.d + yields, x.d),
            jnp.zeros_like(x.v),
            y,
            w,
            tuple(jnp.where(slid, new, old) for new, old in zip(memory, x.memory, strict=True)),
        )

    def alike(self, x: State, earlier: State, tolerance):
        """Both begin the same motion, to within `tolerance` [m], but for where the end-effector is."""
        away = jax.tree.map(lambda a, b, unit: jnp.abs(a - b) * unit, x, earlier, self.scales())
        return jnp.stack(jax.tree.leaves(away._replace(d=jnp.zeros_like(x.d)))).max() < tolerance

    def exact(self, segment: Segment, after, begin: State, lapse, end: State) -> State:
        """`end` with what is known in closed form put right: the platform without feedback."""
        if self.actuator.feedback:
            return end
        y, w = self.actuator.piezo.motion(begin.y, begin.w, segment, after, lapse)
        return end._replace(y=y, w=w)

    def force(self, segment: Segment, after, x: State, mode):
        """Friction force [N] in any mode; at rest and stuck it is the force that holds."""
        free = self._free(segment, after, x)
        sliding = self.actuator.friction.force(x.memory, x.v, mode)
        return jnp.where(jnp.abs(mode) == 1.0, sliding, self._holding(free))

    def _free(self, segment, after, x):
        voltage = segment.start + segment.slope * after
        return self.actuator.piezo.acceleration(x.y, x.w, voltage)

    def _platform(self, free, force):
        return free - force * (1.0 / self.actuator.piezo.mass) if self.actuator.feedback else free

    def _holding(self, free):
        """F*: the friction force that keeps v = 0."""
        effector = self.actuator.effector
        if not self.actuator.feedback:
            return free * effector.mass - effector.load
        mass = self.actuator.piezo.mass
        share = mass / (mass + effector.mass)
        return (free * effector.mass - effector.load) * share

    def _margins(self, segment, after, x):
        free = self._free(segment, after, x)
        force: Any = self.actuator.friction.force  # of series, too
        holding = self._holding(free)
        upper = force(x.memory, 0.0, ADVANCING) - holding
        return upper, holding - force(x.memory, 0.0, RETREATING)

    def _mode_at_rest(self, segment, after, x, came):
        """Which mode begins at v = 0: Filippov's rule, ties broken by looking ahead."""

        def margins(lapse):
            free = self._free(segment, after, x)
            riding = self._platform(free, self._holding(free))
            moved = x._replace(y=x.y + lapse * x.w, w=x.w + lapse * riding)
            return jnp.stack(self._margins(segment, after + lapse, moved))

        now, rate = jax.jvp(margins, (jnp.zeros_like(x.v),), (jnp.ones_like(x.v),))
        upper, lower = now + _LOOK_AHEAD * rate
        torn = jnp.where(came == 0.0, ADVANCING, -came)
        freed = jnp.where(upper < 0, ADVANCING, RETREATING)
        sticks = (upper >= 0) & (lower >= 0)
        return jnp.where(sticks, STUCK, jnp.where((upper < 0) & (lower < 0), torn, freed))

    def _steady(self, segment, after):
        y, w = self.actuator.piezo.steady(segment, after)
        if self.actuator.feedback:
            stiffness = self.actuator.piezo.mass * self.actuator.piezo.rate() ** 2
            y = y + self.actuator.effector.load / stiffness
        return y, w

    def _relaxed(self, x):
        return self.actuator.friction.relaxed(x.memory, -1.0 * jnp.asarray(self.actuator.effector.load, float))


def _kind(mode):
    """Weights 1 and 0 that say whether the contact slides, sticks or rests."""
    one, none = jnp.ones_like(mode), jnp.zeros_like(mode)
    return (
        jnp.where(jnp.abs(mode) == 1.0, one, none),
        jnp.where(mode == STUCK, one, none),
        jnp.where(mode == RESTING, one, none),
    )
