"""The hybrid system of an actuator under a drive: the vector field, its modes, its events.

Relative motion d = y - x_e, v = d'.  With friction force F on the end-effector,

    v' = y'' - (F + pull) / m_e,      y'' = free acceleration [ - F / m_g ],

the bracket with friction feedback (5.25), without it (5.27).  The field is smooth while v
keeps its sign.  At v = 0 the force may jump from F(-) to F(+), and F* is the force that
would keep v = 0 (Filippov):

- F(-) <= F* <= F(+): the contact sticks, v stays 0, until F* leaves the interval;
- otherwise v takes the sign that its acceleration has on the side it moves to.

A set-valued law (Coulomb) and the switching parameters of (5.22) are both of this shape.
Laws, piezos, amplifiers and the stop add guards of their own.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from .actuator import Actuator
from .crossing import LOOK_AHEAD
from .drive.base import AbstractDrive, Segment
from .friction.base import AbstractFriction
from .modes import ADVANCING, RESTING, RETREATING, STUCK, State, chosen, kind
from .sensor import IDEAL, Sensor
from .series import constant, weighted

_FAINT = 1e-17
"""Amplitude [m] of an oscillation that is rounding."""


class StickSlip(eqx.Module):
    """One actuator under one drive, as `integration` wants it."""

    actuator: Actuator
    drive: AbstractDrive
    sensor: Sensor = IDEAL
    on_platform: Any = 0.0
    """1 where the sensor looks at the platform, 0 at the end-effector; with a stop it measures the force."""

    def initial(self) -> State:
        zero = jnp.zeros(())
        touch = () if self.actuator.stop is None else (zero,)
        stage, memory = self.actuator.stage.initial(), self.actuator.friction.initial()
        return State(zero, zero, stage, memory, touch, self.sensor.initial())

    def segment(self, index) -> Segment:
        return self.drive.segment(index)

    def period(self) -> tuple[int, int] | None:
        return self.drive.period()

    @property
    def jumps(self) -> bool:
        """The state may jump at the corners of the drive."""
        return self.actuator.stage.jumps

    @property
    def alters(self) -> bool:
        """The state may change at the corners in any way, flags included."""
        flagged = type(self.actuator.friction).turned is not AbstractFriction.turned
        return self.jumps or flagged or self.actuator.amplifier is not None

    def displaced(self) -> tuple[int, ...]:
        """The components, counted as the leaves of `State`, of which the measured motion is made."""
        count = len(jax.tree.leaves(self.initial()))
        if self.actuator.stop is not None:
            return tuple(range(count))
        stack = () if self._exact() else range(2, 2 + len(self.actuator.piezo.initial()))
        return (0, *stack, count - 1) if self.initial().lag else (0, *stack)

    def scales(self) -> State:
        """What one unit of each state amounts to as a displacement [m]."""
        one, slow = jnp.ones(()), 1.0 / self._slowest()
        lag = one if self.actuator.stop is None else 1.0 / jnp.asarray(self.actuator.stop.stiffness, float)
        first = self.initial()
        return State(
            one,
            slow,
            self.actuator.stage.length(),
            self.actuator.friction.length(),
            tuple(one for _ in first.touch),
            tuple(lag for _ in first.lag),
        )

    def field(self, segment: Segment, after, x: State, mode) -> State:
        """Time derivative of the state in `mode`, `after` [s] into a segment."""
        moves, held, _ = kind(mode)
        stage = self.actuator.stage
        free = stage.acceleration(segment, after, x.stage)
        force = self.actuator.friction.force(x.memory, x.v, mode)
        relative = self._platform(free, force) - (force + self._outer(x)) * (1.0 / self.actuator.effector.mass)
        reaction: Any = 0.0
        if self.actuator.feedback:
            reaction = (force * moves + self._holding(free, x) * held) * (-1.0)
        rates = self.actuator.friction.rate(x.memory, x.v, mode)
        return State(
            x.v * moves,
            relative * moves,
            stage.rate(segment, after, x.stage, reaction, moves + held),
            tuple(weighted(rate, moves) for rate in rates),
            tuple(0 for _ in x.touch),
            self._lagging(x, moves + held),
        )

    def guards(self, segment: Segment, after, x: State, mode) -> tuple:
        """Positive inside the mode, which ends where the first of them falls through zero."""
        moves, held, rests = kind(mode)
        upper, lower = self._margins(segment, after, x)
        own = (x.v * (moves * mode) + upper * held + rests, lower * held + (moves + rests))
        law = self.actuator.friction.guards(x.memory, x.v, mode)
        law = tuple(guard * moves + (held + rests) for guard in law)
        return (*own, *law, *self.actuator.stage.guards(segment, after, x.stage), *self._stop_guards(x))

    def switch(self, segment: Segment, after, x: State, mode, which) -> tuple[State, Any]:
        """State and mode after guard `which` has reached zero."""
        friction, stage = self.actuator.friction, self.actuator.stage
        laws = len(friction.guards(x.memory, x.v, mode))
        others = len(stage.guards(segment, after, x.stage))
        stopped = x._replace(v=jnp.zeros_like(x.v))
        reversed_mode = self._mode_at_rest(segment, after, stopped, came=mode)
        # What held the contact tells by its margin which way it goes, however slowly that begins.
        let_go = jnp.where(which == 0, ADVANCING, RETREATING)
        reversed_mode = jnp.where(mode == STUCK, let_go, reversed_mode)
        turned = friction.turned(x.memory, reversed_mode)
        # A contact at rest knows no guards but those of the stage and of the stop, which wakes it.
        turns = (which < 2) | (mode == RESTING)
        begins = turns & (jnp.abs(reversed_mode) == 1.0)
        memory = chosen(begins, turned, x.memory)
        if laws:
            within = (which >= 2) & (which < 2 + laws)
            memory = chosen(within, friction.passed(x.memory, x.v, mode, which - 2), memory)
        y = x.stage
        if others:
            y = stage.passed(segment, after, y, which - 2 - laws)
        touch = tuple(jnp.where(which == 2 + laws + others, 1.0 - flag, flag) for flag in x.touch)
        v = jnp.where(turns, 0.0, x.v)
        return x._replace(v=v, memory=memory, stage=y, touch=touch), jnp.where(turns, reversed_mode, mode)

    def enter(self, segment: Segment, x: State, mode) -> tuple[State, Any]:
        """State and mode in which a new segment begins: the end-effector goes on as it was."""
        if self.jumps:
            stage = self.actuator.stage
            y = stage.entered(segment, x.stage)
            before, after = stage.platform(x.stage), stage.platform(y)
            x = x._replace(d=x.d + (after[0] - before[0]), v=x.v + (after[1] - before[1]), stage=y)
            mode = jnp.where(after[1] == before[1], mode, jnp.sign(x.v))
        elif self.actuator.amplifier is not None:
            x = x._replace(stage=self.actuator.stage.entered(segment, x.stage))
        standing = (jnp.abs(mode) != 1.0) | (x.v == 0.0)
        begun = self._mode_at_rest(segment, 0.0, x, came=0.0)
        memory = chosen(standing & (jnp.abs(begun) == 1.0), self.actuator.friction.turned(x.memory, begun), x.memory)
        return x._replace(memory=memory), jnp.where(standing, begun, mode)

    def settled(self, segment: Segment, after, x: State, mode, tolerance):
        """Nothing but the steady creep of the platform is left, to within `tolerance` [m].

        A sliding contact has settled once every deviation from the steady solution is
        below the tolerance; a stuck one already when the ringing that is left in the
        platform can no longer free it.
        """
        if segment.wave is not None or not self.actuator.piezo.settles:
            return jnp.zeros((), bool)
        rate = self._slowest()
        ringing = self.actuator.stage.ringing(segment, after, x.stage, self._carried())
        memory, _ = self._relaxed(x)
        lengths = self.actuator.friction.length()
        away = [jnp.abs(a - b) * c for a, b, c in zip(x.memory, memory, lengths, strict=True)]
        away += [jnp.abs(a - b) for a, b in zip(x.lag, self._steady_lag(segment, after, x), strict=True)]
        still = 2.0 * jnp.abs(x.v) / rate < tolerance
        for distance in away:
            still &= distance < tolerance
        still &= ringing < tolerance
        upper, lower = self._margins(segment, after, x)
        shake = 4.0 * self.actuator.effector.mass * self.actuator.piezo.fastest() ** 2 * ringing
        safe = jnp.minimum(upper, lower) > shake
        if x.lag or not self._exact():
            safe &= ringing < tolerance
        for lag in away[len(x.memory) :]:
            safe &= lag < tolerance
        # Whoever leans on the stop is pushed ever harder by a platform that creeps on.
        for touch in x.touch:
            still, safe = still & (touch == 0.0), safe & (touch == 0.0)
        return jnp.where(jnp.abs(mode) == 1.0, still, (mode == STUCK) & safe)

    def settle(self, segment: Segment, after, x: State, mode) -> State:
        """The state with the last of the deviations gone, elastic recovery included."""
        slid = jnp.abs(mode) == 1.0
        memory, yields = self._relaxed(x)
        stage = x.stage if self._exact() else self.actuator.stage.steady(segment, after, x.stage, self._carried())
        return x._replace(
            d=jnp.where(slid, x.d + yields, x.d),
            v=jnp.zeros_like(x.v),
            stage=stage,
            memory=chosen(slid, memory, x.memory),
            lag=self._steady_lag(segment, after, x),
        )

    def alike(self, x: State, earlier: State, tolerance):
        """Both begin the same motion, to within `tolerance` [m], but for where the end-effector is.

        With a stop that matters, too.
        """
        away = jax.tree.map(lambda a, b, unit: jnp.abs(a - b) * unit, x, earlier, self.scales())
        away = away if x.touch else away._replace(d=jnp.zeros_like(x.d))
        return jnp.stack(jax.tree.leaves(away)).max() < tolerance

    def hidden(self, x: State, mode) -> tuple:
        """What a step has to resolve besides the state, as displacements [m]."""
        return self.actuator.friction.hidden(x.memory, x.v, mode)

    def closed_components(self) -> tuple[int, ...]:
        """The components, counted as the leaves of `State`, that `exact` knows: a platform that feels nothing."""
        return tuple(range(2, 2 + len(self.actuator.piezo.initial()))) if self._exact() else ()

    def faint(self, slope, mode, which):
        """Whether a reversal is nothing but the rounding of a contact that is at rest.

        Its time means nothing then, and the field does not change there.
        """
        reverses = (jnp.abs(mode) == 1.0) & (which < 2)
        return reverses & (jnp.abs(slope) < _FAINT * self.actuator.piezo.fastest() ** 2)

    def exact(self, segment: Segment, after, begin: State, lapse, end: State) -> State:
        """`end` with what is known in closed form put right: the platform without feedback."""
        if not self._exact():
            return end
        return end._replace(stage=self.actuator.stage.motion(segment, after, begin.stage, lapse))

    def force(self, segment: Segment, after, x: State, mode):
        """Friction force [N] in any mode; at rest and stuck it is the force that holds."""
        free = self.actuator.stage.acceleration(segment, after, x.stage)
        sliding = self.actuator.friction.force(x.memory, x.v, mode)
        return jnp.where(jnp.abs(mode) == 1.0, sliding, self._holding(free, x))

    def measured(self, x: State):
        """What the sensor shows: displacement of platform or end-effector [m]; with a stop the force [N]."""
        y, _ = self.actuator.stage.platform(x.stage)
        if self.actuator.stop is not None:
            return x.lag[0] if x.lag else self._push(x)
        true = y - x.d * (1.0 - self.on_platform)
        return true - x.lag[0] if x.lag else true

    def _slowest(self):
        """The slowest of the platform's and the contact's frequencies [rad/s]: velocity times 1/it is displacement."""
        law, mass = self.actuator.friction, self.actuator.effector.mass
        state, still = law.initial(), jnp.zeros(())
        frequency = jnp.asarray(self.actuator.piezo.fastest(), float)
        for sign in jnp.array([ADVANCING, RETREATING]):
            stretched = lambda v, sign=sign: tuple(jnp.asarray(rate, float) for rate in law.rate(state, v, sign))
            _, rates = jax.jvp(stretched, (still,), (jnp.ones(()),))
            elastic = lambda memory, sign=sign: jnp.asarray(law.force(memory, still, sign), float)
            stiffness = jnp.abs(jax.jvp(elastic, (state,), (rates,))[1]) if state else still
            own = jnp.sqrt(stiffness / mass)
            frequency = jnp.where(own > 0.0, jnp.minimum(frequency, own), frequency)
        return frequency

    def _exact(self):
        return self.actuator.stage.closed and not self.actuator.feedback

    def _lagging(self, x, active):
        if self.actuator.stop is not None:
            # The force does not walk away: carried is what the sensor shows of it.
            return tuple((self._push(x) - shown) * self.sensor.pole() for shown in x.lag)
        return tuple(rate * active for rate in self.sensor.rate(x.lag, self._seen_speed(x)))

    def _seen_speed(self, x):
        _, w = self.actuator.stage.platform(x.stage)
        return w - x.v * (1.0 - self.on_platform)

    def _steady_lag(self, segment, after, x):
        if not x.lag or self.actuator.stop is not None:
            return x.lag
        steady = self.actuator.stage.steady(segment, after, x.stage, self._carried())
        return self.sensor.steady(x.lag, self.actuator.stage.platform(steady)[1])

    def _push(self, x):
        """Force [N] on the stop."""
        stop: Any = self.actuator.stop
        y, w = self.actuator.stage.platform(x.stage)
        return x.touch[0] * stop.push(y - x.d, w - x.v)

    def _stop_guards(self, x):
        if not x.touch:
            return ()
        stop: Any = self.actuator.stop
        y, _ = self.actuator.stage.platform(x.stage)
        return (stop.depth(y - x.d) * (x.touch[0] * 2.0 - 1.0),)

    def _outer(self, x):
        """Every force on the end-effector but friction [N]."""
        pull = self.actuator.effector.pull()
        return pull if not x.touch else self._push(x) * (-1.0) + pull

    def _carried(self):
        """The friction force [N] on the platform once all is settled, with feedback."""
        return self.actuator.effector.pull() if self.actuator.feedback else 0.0

    def _platform(self, free, force):
        return free - force * (1.0 / self.actuator.piezo.mass) if self.actuator.feedback else free

    def _holding(self, free, x):
        """F*: the friction force that keeps v = 0."""
        effector = self.actuator.effector
        inertial = free * effector.mass - self._outer(x)
        if not self.actuator.feedback:
            return inertial
        mass = self.actuator.piezo.mass
        return inertial * (mass / (mass + effector.mass))

    def _margins(self, segment, after, x):
        holding = self._holding(self.actuator.stage.acceleration(segment, after, x.stage), x)
        memory = tuple(constant(m) for m in x.memory)  # as it is while v = 0
        upper = self.actuator.friction.holding(memory, ADVANCING) - holding  # pyright: ignore[reportArgumentType]
        return upper, holding - self.actuator.friction.holding(memory, RETREATING)  # pyright: ignore[reportArgumentType]

    def _mode_at_rest(self, segment, after, x, came):
        """Which mode begins at v = 0: Filippov's rule, ties broken by looking ahead."""
        stage = self.actuator.stage

        def margins(lapse):
            holding = self._holding(stage.acceleration(segment, after, x.stage), x)
            reaction = -holding if self.actuator.feedback else 0.0
            rates = stage.rate(segment, after, x.stage, reaction, 1.0)
            moved = x._replace(stage=jax.tree.map(lambda a, b: a + lapse * b, x.stage, rates))
            return jnp.stack(self._margins(segment, after + lapse, moved))

        now, rate = jax.jvp(margins, (jnp.zeros_like(x.v),), (jnp.ones_like(x.v),))
        upper, lower = now + LOOK_AHEAD * rate
        torn = jnp.where(came == 0.0, ADVANCING, -came)
        freed = jnp.where(upper < 0, ADVANCING, RETREATING)
        sticks = (upper >= 0) & (lower >= 0)
        return jnp.where(sticks, STUCK, jnp.where((upper < 0) & (lower < 0), torn, freed))

    def _relaxed(self, x):
        return self.actuator.friction.relaxed(x.memory, -1.0 * jnp.asarray(self.actuator.effector.pull(), float))
