"""The hybrid system of an actuator under a drive: the vector field, its modes, its events.

Relative motion d = y - x_e, v = d'.  With friction force F on the end-effector,

    v' = y'' - (F + pull) / m_e,      y'' = free acceleration [ - F / m_g ],

the bracket with friction feedback (5.25), without it (5.27).  The free acceleration is that of the piezo
(a member of `pdssjax.piezo`) under the voltage of the drive's segment, start + slope t_local, or under what an
amplifier makes of it (`DrivenPlatform`).  A platform known in closed form is not integrated where nothing acts back on
it (`exact`).

The field is smooth while v keeps its sign.  At v = 0 the force may jump from F(-) to F(+): a set-valued law (Coulomb)
and the switching parameters of (5.22) are both of this shape.  There the contact sticks, or v takes a sign
(`_sticking`).  Laws, piezos, amplifiers and the stop add guards of their own.
`_sensed_motion` has the sensor's state, `_settling` what is left where nothing moves but the creeping platform.
"""

import jax
import jax.numpy as jnp
from jax import lax

from ...actuator import IDEAL, Actuator, DrivenPlatformState, Sensor, chosen
from ...core import Scalar, ScalarLike, Truth
from ...drive.base import AbstractDrive, Segment
from ...friction.base import AbstractFriction
from ...integration import SETTLED, AbstractHybridSystem, Term, constant, weighted
from ._sensed_motion import SensedMotion
from ._settling import is_settled, project_to_steady, slowest_frequency
from ._stick_slip_state import ADVANCING, RETREATING, STUCK, State, StickSlipState, kind
from ._sticking import external_force, mode_from_rest, push_on_stop, sticking_force, sticking_margins, stop_guards

_NO_JUMP = 3e-16
"""Displacement [m] that a jump of the velocity brings about in a time constant if it is rounding."""


class StickSlip(AbstractHybridSystem):
    """One actuator under one drive."""

    actuator: Actuator
    drive: AbstractDrive
    sensor: Sensor = IDEAL
    on_platform: ScalarLike = 0.0
    """1 where the sensor looks at the platform, 0 at the end-effector; with a stop it shows the force."""

    def initial(self) -> State:
        zero = jnp.zeros(())
        in_contact = () if self.actuator.stop is None else (zero,)
        driven, contact = self.actuator.driven_platform.initial(), self.actuator.friction.initial()
        if self.actuator.rests_under_load:
            contact = self.actuator.friction.under_load(-1.0 * jnp.asarray(self.actuator.initial_pull, float))
        return StickSlipState(zero, zero, driven, contact, in_contact, self.sensor.initial())

    def segment(self, index: Scalar) -> Segment:
        return self.drive.segment(index)

    def field(self, segment: Segment, t_local: Term, x: StickSlipState[Term], mode: Scalar) -> StickSlipState[Term]:
        """Time derivative of the state in `mode`, `t_local` [s] into a segment."""
        moves, sticks, _ = kind(mode)
        driven_platform = self.actuator.driven_platform
        free = driven_platform.acceleration(segment, t_local, x.driven)
        force = self.actuator.friction.force(x.contact_state, x.v, mode)
        platform = free
        if self.actuator.feedback:
            platform = free + self.actuator.reaction(force) * (1.0 / self.actuator.piezo.mass)
        relative = platform - (force + external_force(self.actuator, x)) * (1.0 / self.actuator.effector.mass)
        reaction: Term = 0.0
        if self.actuator.feedback:
            sticking = self.actuator.reaction(sticking_force(self.actuator, free, x))
            reaction = self.actuator.reaction(force) * moves + sticking * sticks
        rates = self.actuator.friction.rate(x.contact_state, x.v, mode)
        return StickSlipState(
            x.v * moves,
            relative * moves,
            driven_platform.rate(segment, t_local, x.driven, reaction, moves + sticks),
            tuple(weighted(rate, moves) for rate in rates),
            tuple(0 for _ in x.in_contact),
            self._sensed.rate(x, moves + sticks),
        )

    def rates(self, segment: Segment, t_local: Scalar, x: State, mode: Scalar) -> State:
        """The true time derivative in any mode: a contact that has settled sticks, on a platform that may ring on."""
        return super().rates(segment, t_local, x, jnp.where(mode == SETTLED, STUCK, mode))

    def guards(self, segment: Segment, t_local: Term, x: StickSlipState[Term], mode: Scalar) -> tuple[Term, ...]:
        """Positive inside the mode: two of the contact, then those of law, platform and stop."""
        moves, sticks, settled = kind(mode)
        upper, lower = sticking_margins(self.actuator, segment, t_local, x)
        law = self.actuator.friction.guards(x.contact_state, x.v, mode)
        return (
            x.v * (moves * mode) + upper * sticks + settled,
            lower * sticks + (moves + settled),
            *(guard * moves + (sticks + settled) for guard in law),
            *self.actuator.driven_platform.guards(segment, t_local, x.driven),
            *stop_guards(self.actuator, x),
        )

    def after_event(
        self, segment: Segment, t_local: ScalarLike, x: State, mode: Scalar, which: Scalar
    ) -> tuple[State, Scalar]:
        """State and mode after guard `which` has reached zero."""
        friction, driven_platform = self.actuator.friction, self.actuator.driven_platform
        laws = len(friction.guards(x.contact_state, x.v, mode))
        others = len(driven_platform.guards(segment, t_local, x.driven))
        driven = driven_platform.after_event(segment, t_local, x.driven, which - 2 - laws) if others else x.driven
        stopped = x._replace(v=jnp.zeros_like(x.v), driven=driven)
        following = mode_from_rest(self.actuator, segment, t_local, stopped, ended=mode)
        # A contact that stuck tells by its margin which way it goes, however slowly that begins.
        freed = jnp.where(which == 0, ADVANCING, RETREATING)
        following = jnp.where((mode == STUCK) & (which < 2), freed, following)
        # A settled contact knows no guards but those of the platform and of the stop, which end its rest.
        turns = (which < 2) | (mode == SETTLED)
        # The platform's acceleration may jump at an event of its own, and past what holds a contact that stuck.
        is_platform_event = (which >= 2 + laws) & (which < 2 + laws + others)
        is_asked = turns | ((mode == STUCK) & is_platform_event)
        begins = is_asked & (jnp.abs(following) == 1.0)
        contact = chosen(begins, friction.on_reversal(x.contact_state, following), x.contact_state)
        if laws:
            of_law = (which >= 2) & (which < 2 + laws)
            contact = chosen(of_law, friction.after_event(x.contact_state, x.v, mode, which - 2), contact)
        in_contact = tuple(jnp.where(which == 2 + laws + others, 1.0 - flag, flag) for flag in x.in_contact)
        x = x._replace(v=jnp.where(turns, 0.0, x.v), contact_state=contact, in_contact=in_contact)
        following = jnp.where(is_asked, following, mode)
        if others:
            if driven_platform.state_jumps:
                x, following = self._after_velocity_jump(x, following, driven)
            x = x._replace(driven=driven)
        return x, following

    def state_scale(self) -> State:
        """Displacement that one unit of each state stands for [m]."""
        metre, first = jnp.ones(()), self.initial()
        return StickSlipState(
            metre,
            1.0 / slowest_frequency(self.actuator),
            self.actuator.driven_platform.error_scale(),
            self.actuator.friction.error_scale(),
            tuple(metre for _ in first.in_contact),
            tuple(self._sensed.state_scale() for _ in first.sensor_lag),
        )

    def on_segment_start(self, segment: Segment, x: State, mode: Scalar) -> tuple[State, Scalar]:
        """State and mode in which a new segment begins: the end-effector goes on as it was."""
        driven_platform = self.actuator.driven_platform
        if driven_platform.state_jumps:
            driven = driven_platform.on_segment_start(segment, x.driven)
            jump = driven_platform.platform(driven)[0] - driven_platform.platform(x.driven)[0]
            x, mode = self._after_velocity_jump(x, mode, driven)
            sensor_lag = self._sensed.after_platform_jump(x, jump)
            x = x._replace(d=x.d + jump, driven=driven, sensor_lag=sensor_lag)
        elif self.actuator.amplifier is not None:
            x = x._replace(driven=driven_platform.on_segment_start(segment, x.driven))
        # A contact that does not slide has v = 0 to the last bit; a motion that begins in its midst has no mode yet.
        at_rest = x.v == 0.0
        sliding = jnp.where(jnp.abs(mode) == 1.0, mode, jnp.sign(x.v))
        begun = mode_from_rest(self.actuator, segment, 0.0, x, ended=0.0)
        reversed_state = self.actuator.friction.on_reversal(x.contact_state, begun)
        contact = chosen(at_rest & (jnp.abs(begun) == 1.0), reversed_state, x.contact_state)
        return x._replace(contact_state=contact), jnp.where(at_rest, begun, sliding)

    def _after_velocity_jump(self, x: State, mode: Scalar, driven: DrivenPlatformState[Scalar]) -> tuple[State, Scalar]:
        """State and mode where the platform is to move as `driven` says: the end-effector goes on as it was.

        A motion that a jump of the platform's velocity begins or turns round is a reversal to the law, too, and any
        jump may carry the law past an event of its own, such as into fast sliding.
        """
        platform = self.actuator.driven_platform.platform
        jump = platform(driven)[1] - platform(x.driven)[1]
        # Of equal states compiled code may differ by rounding, which must not move a contact at rest.
        is_rounding = jnp.abs(jump) <= _NO_JUMP * self.actuator.piezo.frequency_scale()
        jump = jump - jnp.where(is_rounding, lax.stop_gradient(jump), 0.0)
        v = x.v + jump
        way = jnp.sign(v)
        friction, jumps = self.actuator.friction, jump != 0.0
        turned = jumps & (v != 0.0) & (way != jnp.sign(x.v))
        contact = chosen(turned, friction.on_reversal(x.contact_state, way), x.contact_state)
        contact = chosen(jumps, friction.on_velocity_jump(contact, v, way), contact)
        x = x._replace(v=v, contact_state=contact)
        return x, jnp.where(jump == 0.0, mode, way)

    @property
    def resets_at_corners(self) -> bool:
        """Whether the platform jumps, the law knows reversals, or the piezo learns that its input turned."""
        driven_platform = self.actuator.driven_platform
        knows_reversals = type(self.actuator.friction).on_reversal is not AbstractFriction.on_reversal
        return driven_platform.state_jumps or knows_reversals or self.actuator.amplifier is not None

    def period(self) -> tuple[int, int] | None:
        return self.drive.period()

    def is_settled(self, segment: Segment, t_local: ScalarLike, x: State, mode: Scalar, tolerance: ScalarLike) -> Truth:
        return is_settled(self._sensed, segment, t_local, x, mode, tolerance)

    def project_to_steady(self, segment: Segment, t_local: ScalarLike, x: State, mode: Scalar) -> State:
        return project_to_steady(self._sensed, segment, t_local, x, mode)

    def shifting_components(self) -> tuple[int, ...]:
        """The component of the end-effector's place, on which nothing else depends; none with a stop."""
        return () if self.initial().in_contact else (0,)

    def extra_error_terms(self, x: StickSlipState[Term], mode: Scalar) -> tuple[Term, ...]:
        """What a step has to resolve besides the state, as displacements [m]."""
        return self.actuator.friction.extra_error_terms(x.contact_state, x.v, mode)

    def closed_components(self) -> tuple[int, ...]:
        """The components, counted as the leaves of the state, that `exact` knows: a platform that feels nothing."""
        return self._stack_components() if self.actuator.platform_closed else ()

    def exact(self, segment: Segment, t_local: ScalarLike, begin: State, elapsed: ScalarLike, end: State) -> State:
        """`end` with the components known in closed form replaced: the platform without feedback."""
        if not self.actuator.platform_closed:
            return end
        return end._replace(driven=self.actuator.driven_platform.motion(segment, t_local, begin.driven, elapsed))

    def is_carried_back(self, slope: Scalar, mode: Scalar, which: Scalar, amplitude: float) -> Truth:
        """Whether it is a law's own event, or a reversal of a contact or a voltage at rest to within `amplitude` [m].

        A law's own event may drop the phase from its derivatives: the next reversal restores it.
        """
        slides = jnp.abs(mode) == 1.0
        first, law = self.initial(), self.actuator.friction
        laws = len(law.guards(first.contact_state, first.v, ADVANCING))
        is_small_platform_event = self.actuator.driven_platform.is_small_event(slope, which - 2 - laws, amplitude)
        slow = jnp.abs(slope) < amplitude * self.actuator.piezo.frequency_scale() ** 2
        of_contact = slides & (((which < 2) & slow) | ((which >= 2) & (which < 2 + laws)))
        return of_contact | is_small_platform_event

    def force(self, segment: Segment, t_local: Scalar, x: State, mode: Scalar) -> Scalar:
        """Friction force [N] in any mode; settled and stuck it is F*, the force that keeps v = 0."""
        free = self.actuator.driven_platform.acceleration(segment, t_local, x.driven)
        sliding = self.actuator.friction.force(x.contact_state, x.v, mode)
        sticking = sticking_force(self.actuator, free, x)
        return jnp.where(jnp.abs(mode) == 1.0, constant(sliding), constant(sticking))

    def shown_displacement(self, x: State) -> Scalar:
        """Displacement [m] of platform or end-effector that the sensor shows."""
        y, _ = self.actuator.driven_platform.platform(x.driven)
        return self.sensor.shown_displacement(self._motion_lag(x), y - x.d * (1.0 - self.on_platform))

    def shown_velocity(self, x: State) -> Scalar:
        """Velocity [m/s] of platform or end-effector that a sensor of velocity shows."""
        return self.sensor.shown_velocity(self._motion_lag(x), self._sensed.speed(x))

    def shown_force(self, x: State) -> ScalarLike:
        """Force [N] that the sensor in the way, the stop, shows."""
        return x.sensor_lag[0] if x.sensor_lag else constant(push_on_stop(self.actuator, x))

    def _motion_lag(self, x: State) -> tuple[Scalar, ...]:
        if self.actuator.stop is not None and x.sensor_lag:
            raise ValueError("Expected a sensor without a filter beside a stop, whose force it filters, but got one.")
        return x.sensor_lag

    def output_components(self) -> tuple[int, ...]:
        """The components, counted as the leaves of the state, of which the measured motion is made."""
        count = len(jax.tree.leaves(self.initial()))
        if self.actuator.stop is not None:
            return tuple(range(count))
        integrated = () if self.actuator.platform_closed else self._stack_components()
        return (0, *integrated, count - 1) if self.initial().sensor_lag else (0, *integrated)

    def velocity_components(self) -> tuple[int, ...]:
        """The components of which the velocity shown is made."""
        if self.initial().sensor_lag:
            return (len(jax.tree.leaves(self.initial())) - 1,)
        return (1,) if self.actuator.platform_closed else (1, *self._stack_components())

    def _stack_components(self) -> tuple[int, ...]:
        return tuple(range(2, 2 + len(self.actuator.piezo.initial())))

    @property
    def _sensed(self) -> SensedMotion:
        return SensedMotion(self.actuator, self.sensor, self.on_platform)
