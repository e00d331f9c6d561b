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

import jax
import jax.numpy as jnp

from ...actuator import IDEAL, Actuator, Sensor, chosen
from ...drive.base import AbstractDrive, Segment
from ...friction.base import AbstractFriction
from ...integration import LOOK_AHEAD, SETTLED, AbstractHybridSystem, constant, weighted
from ._contact_state import ADVANCING, RETREATING, STUCK, State, kind

_SPURIOUS_AMPLITUDE = 1e-17
"""Amplitude [m] of an oscillation that is rounding."""


class StickSlip(AbstractHybridSystem):
    """One actuator under one drive."""

    actuator: Actuator
    drive: AbstractDrive
    sensor: Sensor = IDEAL
    on_platform: Any = 0.0
    """1 where the sensor looks at the platform, 0 at the end-effector; with a stop it shows the force."""

    def initial(self) -> State:
        zero = jnp.zeros(())
        in_contact = () if self.actuator.stop is None else (zero,)
        driven, contact = self.actuator.driven_platform.initial(), self.actuator.friction.initial()
        return State(zero, zero, driven, contact, in_contact, self.sensor.initial())

    def segment(self, index) -> Segment:
        return self.drive.segment(index)

    def period(self) -> tuple[int, int] | None:
        return self.drive.period()

    @property
    def resets_at_corners(self) -> bool:
        """The platform jumps, the law remembers reversals, or the piezo learns that the amplifier's input turned."""
        driven_platform = self.actuator.driven_platform
        remembers = type(self.actuator.friction).on_reversal is not AbstractFriction.on_reversal
        return driven_platform.state_jumps or remembers or self.actuator.amplifier is not None

    def output_components(self) -> tuple[int, ...]:
        """The components, counted as the leaves of `State`, of which the measured motion is made."""
        count = len(jax.tree.leaves(self.initial()))
        if self.actuator.stop is not None:
            return tuple(range(count))
        stack = () if self._exact() else range(2, 2 + len(self.actuator.piezo.initial()))
        return (0, *stack, count - 1) if self.initial().sensor_lag else (0, *stack)

    def velocity_components(self) -> tuple[int, ...]:
        """The components of which the velocity shown is made."""
        count = len(jax.tree.leaves(self.initial()))
        if self.initial().sensor_lag:
            return (count - 1,)
        return (1,) if self._exact() else (1, *range(2, 2 + len(self.actuator.piezo.initial())))

    def state_scale(self) -> State:
        """What one unit of each state amounts to as a displacement [m]."""
        one, slow = jnp.ones(()), 1.0 / self._slowest()
        lag = one if self.actuator.stop is None else 1.0 / jnp.asarray(self.actuator.stop.stiffness, float)
        first = self.initial()
        return State(
            one,
            slow,
            self.actuator.driven_platform.error_scale(),
            self.actuator.friction.error_scale(),
            tuple(one for _ in first.in_contact),
            tuple(lag for _ in first.sensor_lag),
        )

    def field(self, segment: Segment, t_local, x: State, mode) -> State:
        """Time derivative of the state in `mode`, `t_local` [s] into a segment."""
        moves, held, _ = kind(mode)
        driven_platform = self.actuator.driven_platform
        free = driven_platform.acceleration(segment, t_local, x.driven)
        force = self.actuator.friction.force(x.contact_state, x.v, mode)
        relative = self._platform(free, force) - (force + self._external_force(x)) * (1.0 / self.actuator.effector.mass)
        reaction: Any = 0.0
        if self.actuator.feedback:
            reaction = (force * moves + self._sticking_force(free, x) * held) * (-1.0)
        rates = self.actuator.friction.rate(x.contact_state, x.v, mode)
        return State(
            x.v * moves,
            relative * moves,
            driven_platform.rate(segment, t_local, x.driven, reaction, moves + held),
            tuple(weighted(rate, moves) for rate in rates),
            tuple(0 for _ in x.in_contact),
            self._sensor_rate(x, moves + held),
        )

    def rates(self, segment: Segment, t_local, x: State, mode) -> State:
        """The true time derivative in any mode: a contact that has settled sticks, on a platform that may ring on."""
        return super().rates(segment, t_local, x, jnp.where(mode == SETTLED, STUCK, mode))

    def guards(self, segment: Segment, t_local, x: State, mode) -> tuple:
        """Positive inside the mode, which ends where the first of them falls through zero."""
        moves, held, settled = kind(mode)
        upper, lower = self._margins(segment, t_local, x)
        contact_guards = (x.v * (moves * mode) + upper * held + settled, lower * held + (moves + settled))
        law = self.actuator.friction.guards(x.contact_state, x.v, mode)
        law = tuple(guard * moves + (held + settled) for guard in law)
        return (
            *contact_guards,
            *law,
            *self.actuator.driven_platform.guards(segment, t_local, x.driven),
            *self._stop_guards(x),
        )

    def after_event(self, segment: Segment, t_local, x: State, mode, which) -> tuple[State, Any]:
        """State and mode after guard `which` has reached zero."""
        friction, driven_platform = self.actuator.friction, self.actuator.driven_platform
        laws = len(friction.guards(x.contact_state, x.v, mode))
        others = len(driven_platform.guards(segment, t_local, x.driven))
        stopped = x._replace(v=jnp.zeros_like(x.v))
        reversed_mode = self._mode_at_rest(segment, t_local, stopped, came=mode)
        # What held the contact tells by its margin which way it goes, however slowly that begins.
        let_go = jnp.where(which == 0, ADVANCING, RETREATING)
        reversed_mode = jnp.where(mode == STUCK, let_go, reversed_mode)
        reversed_state = friction.on_reversal(x.contact_state, reversed_mode)
        # A contact at rest knows no guards but those of the stage and of the stop, which wakes it.
        turns = (which < 2) | (mode == SETTLED)
        begins = turns & (jnp.abs(reversed_mode) == 1.0)
        contact = chosen(begins, reversed_state, x.contact_state)
        if laws:
            within = (which >= 2) & (which < 2 + laws)
            contact = chosen(within, friction.after_event(x.contact_state, x.v, mode, which - 2), contact)
        y = x.driven
        if others:
            y = driven_platform.after_event(segment, t_local, y, which - 2 - laws)
        in_contact = tuple(jnp.where(which == 2 + laws + others, 1.0 - flag, flag) for flag in x.in_contact)
        v = jnp.where(turns, 0.0, x.v)
        return x._replace(v=v, contact_state=contact, driven=y, in_contact=in_contact), jnp.where(
            turns, reversed_mode, mode
        )

    def on_segment_start(self, segment: Segment, x: State, mode) -> tuple[State, Any]:
        """State and mode in which a new segment begins: the end-effector goes on as it was."""
        driven_platform = self.actuator.driven_platform
        if driven_platform.state_jumps:
            y = driven_platform.on_segment_start(segment, x.driven)
            before, after = driven_platform.platform(x.driven), driven_platform.platform(y)
            jump = after[0] - before[0]
            lag = x.sensor_lag  # of a force that does not jump, where there is a stop
            if self.actuator.stop is None:
                lag = self.sensor.after_jump(lag, jump * self.on_platform)
            x = x._replace(d=x.d + jump, v=x.v + (after[1] - before[1]), driven=y, sensor_lag=lag)
            mode = jnp.where(after[1] == before[1], mode, jnp.sign(x.v))
        elif self.actuator.amplifier is not None:
            x = x._replace(driven=driven_platform.on_segment_start(segment, x.driven))
        standing = (jnp.abs(mode) != 1.0) | (x.v == 0.0)
        begun = self._mode_at_rest(segment, 0.0, x, came=0.0)
        contact = chosen(
            standing & (jnp.abs(begun) == 1.0),
            self.actuator.friction.on_reversal(x.contact_state, begun),
            x.contact_state,
        )
        return x._replace(contact_state=contact), jnp.where(standing, begun, mode)

    def is_settled(self, segment: Segment, t_local, x: State, mode, tolerance):
        """Nothing but the steady creep of the platform is left, to within `tolerance` [m].

        A sliding contact has settled once every deviation from the steady solution is
        below the tolerance; a stuck one already when the ringing that is left in the
        platform can no longer free it.
        """
        if segment.wave is not None or not self.actuator.piezo.has_steady_state:
            return jnp.zeros((), bool)
        rate = self._slowest()
        ringing = self.actuator.driven_platform.ringing(segment, t_local, x.driven, self._settled_friction())
        contact, _ = self._equilibrium_state(x)
        lengths = self.actuator.friction.error_scale()
        away = [jnp.abs(a - b) * c for a, b, c in zip(x.contact_state, contact, lengths, strict=True)]
        away += [jnp.abs(a - b) for a, b in zip(x.sensor_lag, self._steady_lag(segment, t_local, x), strict=True)]
        still = 2.0 * jnp.abs(x.v) / rate < tolerance
        for distance in away:
            still &= distance < tolerance
        still &= ringing < tolerance
        upper, lower = self._margins(segment, t_local, x)
        shake = 4.0 * self.actuator.effector.mass * self.actuator.piezo.frequency_scale() ** 2 * ringing
        safe = jnp.minimum(upper, lower) > shake
        if x.sensor_lag or not self._exact():
            safe &= ringing < tolerance
        for lag in away[len(x.contact_state) :]:
            safe &= lag < tolerance
        # While in contact with a platform that creeps on, the stop's force keeps rising: never settled.
        for in_contact in x.in_contact:
            still, safe = still & (in_contact == 0.0), safe & (in_contact == 0.0)
        return jnp.where(jnp.abs(mode) == 1.0, still, (mode == STUCK) & safe)

    def project_to_steady(self, segment: Segment, t_local, x: State, mode) -> State:
        """The state with the last of the deviations gone, elastic recovery included."""
        slid = jnp.abs(mode) == 1.0
        contact, displacement = self._equilibrium_state(x)
        driven = (
            x.driven
            if self._exact()
            else self.actuator.driven_platform.steady(segment, t_local, x.driven, self._settled_friction())
        )
        return x._replace(
            d=jnp.where(slid, x.d + displacement, x.d),
            v=jnp.zeros_like(x.v),
            driven=driven,
            contact_state=chosen(slid, contact, x.contact_state),
            sensor_lag=self._steady_lag(segment, t_local, x),
        )

    def same_state(self, x: State, earlier: State, tolerance):
        """Both begin the same motion, to within `tolerance` [m], but for where the end-effector is.

        With a stop that matters, too.
        """
        away = jax.tree.map(lambda a, b, unit: jnp.abs(a - b) * unit, x, earlier, self.state_scale())
        away = away if x.in_contact else away._replace(d=jnp.zeros_like(x.d))
        return jnp.stack(jax.tree.leaves(away)).max() < tolerance

    def extra_error_terms(self, x: State, mode) -> tuple:
        """What a step has to resolve besides the state, as displacements [m]."""
        return self.actuator.friction.extra_error_terms(x.contact_state, x.v, mode)

    def closed_components(self) -> tuple[int, ...]:
        """The components, counted as the leaves of `State`, that `exact` knows: a platform that feels nothing."""
        return tuple(range(2, 2 + len(self.actuator.piezo.initial()))) if self._exact() else ()

    def is_spurious_event(self, slope, mode, which):
        """Whether a reversal is nothing but the rounding of a contact that is at rest.

        Its time means nothing then, and the field does not change there.
        """
        reverses = (jnp.abs(mode) == 1.0) & (which < 2)
        return reverses & (jnp.abs(slope) < _SPURIOUS_AMPLITUDE * self.actuator.piezo.frequency_scale() ** 2)

    def exact(self, segment: Segment, t_local, begin: State, elapsed, end: State) -> State:
        """`end` with what is known in closed form put right: the platform without feedback."""
        if not self._exact():
            return end
        return end._replace(driven=self.actuator.driven_platform.motion(segment, t_local, begin.driven, elapsed))

    def force(self, segment: Segment, t_local, x: State, mode):
        """Friction force [N] in any mode; at rest and stuck it is the force that holds."""
        free = self.actuator.driven_platform.acceleration(segment, t_local, x.driven)
        sliding = self.actuator.friction.force(x.contact_state, x.v, mode)
        return jnp.where(jnp.abs(mode) == 1.0, sliding, self._sticking_force(free, x))

    def shown_displacement(self, x: State):
        """Displacement [m] of platform or end-effector that the sensor shows."""
        y, _ = self.actuator.driven_platform.platform(x.driven)
        return self.sensor.shown_displacement(self._motion_lag(x), y - x.d * (1.0 - self.on_platform))

    def shown_velocity(self, x: State):
        """Velocity [m/s] of platform or end-effector that a sensor of velocity shows."""
        return self.sensor.shown_velocity(self._motion_lag(x), self._seen_speed(x))

    def shown_force(self, x: State):
        """Force [N] that the sensor in the way, the stop, shows."""
        return x.sensor_lag[0] if x.sensor_lag else self._push(x)

    def _slowest(self):
        """The slowest of the platform's and the contact's frequencies [rad/s]: velocity times 1/it is displacement."""
        law, mass = self.actuator.friction, self.actuator.effector.mass
        state, still = law.initial(), jnp.zeros(())
        frequency = jnp.asarray(self.actuator.piezo.frequency_scale(), float)
        for sign in jnp.array([ADVANCING, RETREATING]):
            stretched = lambda v, sign=sign: tuple(jnp.asarray(rate, float) for rate in law.rate(state, v, sign))
            _, rates = jax.jvp(stretched, (still,), (jnp.ones(()),))
            elastic = lambda memory, sign=sign: jnp.asarray(law.force(memory, still, sign), float)
            stiffness = jnp.abs(jax.jvp(elastic, (state,), (rates,))[1]) if state else still
            own = jnp.sqrt(stiffness / mass)
            frequency = jnp.where(own > 0.0, jnp.minimum(frequency, own), frequency)
        return frequency

    def _exact(self):
        return self.actuator.driven_platform.closed and not self.actuator.feedback

    def _sensor_rate(self, x, active):
        if self.actuator.stop is not None:
            # The force does not drift: the state is what the sensor shows of it.
            return tuple((self._push(x) - shown) * self.sensor.pole() for shown in x.sensor_lag)
        return tuple(rate * active for rate in self.sensor.rate(x.sensor_lag, self._seen_speed(x)))

    def _motion_lag(self, x):
        if self.actuator.stop is not None and x.sensor_lag:
            raise ValueError("Expected a sensor without a filter beside a stop, whose force it filters, but got one.")
        return x.sensor_lag

    def _seen_speed(self, x):
        _, w = self.actuator.driven_platform.platform(x.driven)
        return w - x.v * (1.0 - self.on_platform)

    def _steady_lag(self, segment, t_local, x):
        if not x.sensor_lag or self.actuator.stop is not None:
            return x.sensor_lag
        steady = self.actuator.driven_platform.steady(segment, t_local, x.driven, self._settled_friction())
        return self.sensor.steady(x.sensor_lag, self.actuator.driven_platform.platform(steady)[1])

    def _push(self, x):
        """Force [N] on the stop."""
        stop: Any = self.actuator.stop
        y, w = self.actuator.driven_platform.platform(x.driven)
        return x.in_contact[0] * stop.push(y - x.d, w - x.v)

    def _stop_guards(self, x):
        if not x.in_contact:
            return ()
        stop: Any = self.actuator.stop
        y, _ = self.actuator.driven_platform.platform(x.driven)
        return (stop.depth(y - x.d) * (x.in_contact[0] * 2.0 - 1.0),)

    def _external_force(self, x):
        """Every force on the end-effector but friction [N]."""
        pull = self.actuator.effector.pull()
        return pull if not x.in_contact else self._push(x) * (-1.0) + pull

    def _settled_friction(self):
        """The friction force [N] on the platform once all is settled, with feedback."""
        return self.actuator.effector.pull() if self.actuator.feedback else 0.0

    def _platform(self, free, force):
        return free - force * (1.0 / self.actuator.piezo.mass) if self.actuator.feedback else free

    def _sticking_force(self, free, x):
        """F*: the friction force that keeps v = 0."""
        effector = self.actuator.effector
        inertial = free * effector.mass - self._external_force(x)
        if not self.actuator.feedback:
            return inertial
        mass = self.actuator.piezo.mass
        return inertial * (mass / (mass + effector.mass))

    def _margins(self, segment, t_local, x):
        sticking_force = self._sticking_force(self.actuator.driven_platform.acceleration(segment, t_local, x.driven), x)
        contact = tuple(constant(m) for m in x.contact_state)  # as it is while v = 0
        upper = self.actuator.friction.breakaway_force(contact, ADVANCING) - sticking_force  # pyright: ignore[reportArgumentType]
        return upper, sticking_force - self.actuator.friction.breakaway_force(contact, RETREATING)  # pyright: ignore[reportArgumentType]

    def _mode_at_rest(self, segment, t_local, x, came):
        """Which mode begins at v = 0: Filippov's rule, ties broken by looking ahead."""
        driven_platform = self.actuator.driven_platform

        def margins(elapsed):
            sticking_force = self._sticking_force(driven_platform.acceleration(segment, t_local, x.driven), x)
            reaction = -sticking_force if self.actuator.feedback else 0.0
            rates = driven_platform.rate(segment, t_local, x.driven, reaction, 1.0)
            moved = x._replace(driven=jax.tree.map(lambda a, b: a + elapsed * b, x.driven, rates))
            return jnp.stack(self._margins(segment, t_local + elapsed, moved))

        now, rate = jax.jvp(margins, (jnp.zeros_like(x.v),), (jnp.ones_like(x.v),))
        upper, lower = now + LOOK_AHEAD * rate
        unstable_branch = jnp.where(came == 0.0, ADVANCING, -came)
        freed = jnp.where(upper < 0, ADVANCING, RETREATING)
        sticks = (upper >= 0) & (lower >= 0)
        return jnp.where(sticks, STUCK, jnp.where((upper < 0) & (lower < 0), unstable_branch, freed))

    def _equilibrium_state(self, x):
        return self.actuator.friction.equilibrium_state(
            x.contact_state, -1.0 * jnp.asarray(self.actuator.effector.pull(), float)
        )
