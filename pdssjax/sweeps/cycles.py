"""The cycle of a motion that a sweep measures: that of a given number, counted from rest, or the steady one.

For the steady cycle, points side by side are integrated until their motion repeats.  The few that take longer are
solved one by one, by Newton's method on the cycle map (`pdssjax.integration.steady_motion`), or by integrating many
cycles where a reversal nearly grazes.  Further metrics and derivatives need a `Course`, the motion with all its steps.
"""

import abc
from functools import partial
from numbers import Integral
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from ..core import MOST_DRAWN, Count, InputError, Scalar
from ..drive.base import AbstractDrive
from ..integration import (
    GRAZES,
    PERIODS,
    SHORT,
    AbstractHybridSystem,
    Accuracy,
    Cycles,
    SampledStates,
    SteppedRun,
    Taylor,
    flat,
    integrate_cycles,
    integrate_steps,
    integrate_to_times,
    moved_orbit,
    restarted,
    states_at,
    steady_state,
)
from ..metrics import FLANK, CycleMetrics, cycle_metrics
from ..simulation import StickSlip, StickSlipState, grazing
from .blocks import GRAZING

SIDE_BY_SIDE = Taylor(16)
"""Method for points side by side, whose steps always compute all terms: a higher order would gain nothing."""

FINE = Accuracy(tolerance=1e-17, settle_tolerance=1e-15)
"""Accuracy for derivatives: a net step is a small difference of long motions, which coarser steps lose."""

_FLANK_FRACTIONS = np.linspace(FLANK[0] + 1e-6, FLANK[1] - 1e-6, 6)
"""Fractions of a flank's voltage at which its line is sampled; 1e-6 inside the fitted part, for rounding."""


class Metric(NamedTuple):
    """A quantity that is measured at each point."""

    unit: str
    """In SI."""
    description: str
    by: str = ""
    """The path by which a derivative is taken; "" for other metrics."""


METRICS = {
    "net_step": Metric("m", "net step of a cycle"),
    "speed": Metric("m/s", "average speed"),
    "efficiency": Metric("1", "step efficiency (3.1)"),
    "stroke": Metric("m", "stroke of the stick phase"),
    "back_slip": Metric("m", "back-slip"),
}
"""Metrics of every cycle, by the names of `pdssjax.metrics.CycleMetrics`."""

FLANK_METRICS = "efficiency", "stroke", "back_slip"
"""Metrics that only a cycle of a slow and a fast flank has."""


class Opening(NamedTuple):
    """Where a course begins."""

    x: Float[Array, " components"]
    """The state; at rest, or just before the corner that opens a cycle that repeats."""
    repeats: Count
    """Number of cycles after which the motion repeats; 0 where it does not, or the cycle is a numbered one."""
    multiplier: Scalar
    """Modulus of the largest Floquet multiplier; NaN: there is no orbit, or it grazes."""
    grazing: Scalar
    """Nearness to grazing of the reversals of the orbit that Newton's method found; where one grazes, the opening is
    that of integrated cycles instead.  NaN: there is no attracting orbit."""
    failure: Count
    """Index into `pdssjax.integration.FAILURES`."""


class Course(NamedTuple):
    """One cycle, or those after which a motion repeats, integrated up to the slow flank that follows them."""

    system: StickSlip
    moving: AbstractHybridSystem
    """What was integrated: the system, or the system from the opening of a cycle on."""
    run: SteppedRun
    begin: Scalar
    """Start of the first of the cycles, on the clock of `moving` [s]."""
    span: Count
    """Number of cycles."""
    most: int
    """Largest number of cycles."""
    failure: Count
    """Index into `pdssjax.integration.FAILURES`."""


class AbstractCycle(eqx.Module):
    """A cycle of a motion, to be measured."""

    @property
    def metrics(self) -> dict[str, Metric]:
        """The metrics of the cycle, by name."""
        return METRICS

    @property
    @abc.abstractmethod
    def label(self) -> int | str:
        """The cycle as `sweep(cycles=...)` takes it."""

    @property
    @abc.abstractmethod
    def accuracy(self) -> Accuracy:
        """Default accuracy of the integration."""

    @abc.abstractmethod
    def measure(self, system: StickSlip, accuracy: Accuracy) -> tuple[Float[Array, " metrics"], Count]:
        """The `metrics`, and an index into `pdssjax.integration.FAILURES`; points are side by side."""

    @abc.abstractmethod
    def opening(self, system: StickSlip) -> Opening:
        """The beginning of the measured motion, at the accuracy `FINE`; not differentiable."""

    @abc.abstractmethod
    def course(self, system: StickSlip, opening: Opening) -> Course:
        """The measured motion with all its steps at the accuracy `FINE`, for further metrics and for derivatives.

        Differentiable in every floating-point leaf of `system`, and in the state of an `opening` that repeats.
        """

    def opening_derivatives(
        self,
        system: StickSlip,
        opening: Opening,
        monodromy: Float[Array, "components components"],
        driven: Float[Array, "components by"],
    ) -> Float[Array, "components by"]:
        """Derivatives of the opening's state, from those of the state that ends the course; zero at rest."""
        return jnp.zeros_like(driven)

    def unfinished(self, found: Float[np.ndarray, "points metrics"]) -> Bool[np.ndarray, " points"]:
        """Whether `measure_patiently` must measure a point again; False by default."""
        return np.zeros(len(found), bool)

    def measure_patiently(self, system: StickSlip, accuracy: Accuracy) -> tuple[Float[Array, " metrics"], Count]:
        """Measure one of the few points that are `unfinished`; the failure may also be `GRAZING`."""
        return self.measure(system, accuracy)


class Timing(NamedTuple):
    """Times at which the cycles of a drive are measured."""

    frequency: Scalar
    """Cycles a second [Hz]."""
    fall: Scalar
    """Duration of the fast flank [s], with which a cycle begins."""
    phases: Float[Array, " line"]
    """Sample times [s] within a cycle, on its slow flank, at even steps of the voltage."""
    has_flanks: bool
    """Whether the cycle is a slow and a fast flank."""

    @property
    def period(self) -> Scalar:
        """Period of the drive [s]."""
        return 1.0 / self.frequency


def timing(drive: AbstractDrive) -> Timing:
    """Times at which the cycles of a periodic `drive` are measured."""
    frequency, flanks = jnp.asarray(drive.cycle_frequency(), float), drive.flanks()
    fall = jnp.zeros(()) if flanks is None else jnp.asarray(flanks.fast, float)
    phases = fall + (1.0 / frequency - fall) * drive.slow_flank_times(_FLANK_FRACTIONS)
    return Timing(frequency, fall, phases, flanks is not None)


def cycles_at(when: Timing, effector: Float[Array, "flanks line"]) -> CycleMetrics:
    """Metrics of each cycle but the last, from the `effector` [m] at the phases of the slow flanks.

    The stroke is the end-effector's displacement per voltage along the flank, times the flank's whole voltage, also
    where the flank is not straight.  Without a slow and a fast flank the `FLANK_METRICS` are NaN.
    """
    straight = when.fall + (when.period - when.fall) * _FLANK_FRACTIONS
    times = (jnp.arange(len(effector))[:, None] * when.period + straight).ravel()
    found = cycle_metrics(times, effector.ravel(), when.frequency, 0.0, len(effector) - 1, when.fall)
    if when.has_flanks:
        return found
    return found._replace(**dict.fromkeys(FLANK_METRICS, jnp.full_like(found.stroke, jnp.nan)))


def effector_at(system: StickSlip, x: StickSlipState[Float[Array, " m"]]) -> Float[Array, " m"]:
    """Displacement [m] of the end-effector in many states."""
    y, _ = jax.vmap(system.actuator.driven_platform.platform)(x.driven)
    return y - x.d


def sampled_states(course: Course, phases: Float[Array, " phases"], cycles: int) -> SampledStates:
    """The states at `phases` [s] of each of the first `cycles` cycles, one after the other."""
    period = timing(course.system.drive).period
    times = course.begin + (jnp.arange(cycles)[:, None] * period + phases).ravel()
    return states_at(course.moving, course.run, times)


def final_state(course: Course) -> Float[Array, " components"]:
    """The state just before the corner that ends the cycles."""
    period = timing(course.system.drive).period
    before = (course.begin + course.span * period * (1.0 - SHORT))[None]
    return jnp.stack([leaf[0] for leaf in jax.tree.leaves(states_at(course.moving, course.run, before).x)])


def mean_over_cycles(course: Course, values: Float[Array, " cycles"]) -> Scalar:
    """The mean of `values`, one for each of `course.most` cycles, over the first `course.span`."""
    return jnp.sum(jnp.where(jnp.arange(course.most) < course.span, values, 0.0)) / course.span


def step_metrics(course: Course) -> dict[str, Scalar]:
    """The `METRICS` of a course, differentiable in all its leaves."""
    when = timing(course.system.drive)
    effector = effector_at(course.system, sampled_states(course, when.phases, course.most + 1).x)
    effector = effector.reshape(course.most + 1, -1)
    net = (effector[course.span, 0] - effector[0, 0]) / course.span
    return _metrics_of(net, mean_over_cycles(course, cycles_at(when, effector).stroke), when.frequency)


def _metrics_of(net: Scalar, stroke: Scalar, frequency: Scalar) -> dict[str, Scalar]:
    """`METRICS`, in their order, from the net step and the stroke of a cycle."""
    speed, efficiency = net * frequency, net / stroke
    values = (net, speed, efficiency, stroke, stroke - net)
    return dict(zip(METRICS, values, strict=True))


def steps_within(course: Course) -> tuple[Bool[Array, " room"], Count]:
    """Which steps belong to the cycles, and their number of cycles; the period of a motion that repeats counts once."""
    run, period = course.run, timing(course.system.drive).period
    begins = jax.lax.stop_gradient(run.steps.origin + run.steps.t_local)
    # By rounding, a step of a cycle may begin a little before it.
    opening = jnp.where(run.repeats, run.steps.origin[run.period], course.begin) - 1e-9 * period
    cycles = jnp.where(run.repeats, 1, course.span)
    real = jnp.arange(begins.shape[0]) < run.count
    return real & (begins >= opening) & (begins < opening + cycles * period), cycles


class Numbered(AbstractCycle):
    """Cycle `number`; its back-slip is measured on the slow flank of the next one."""

    number: int = eqx.field(static=True, default=4)

    @property
    def label(self) -> int | str:
        return self.number

    @property
    def accuracy(self) -> Accuracy:
        """Agrees with single runs to 1e-4 um."""
        return Accuracy(tolerance=3e-11, method=SIDE_BY_SIDE)

    def measure(self, system: StickSlip, accuracy: Accuracy) -> tuple[Float[Array, " metrics"], Count]:
        when = timing(system.drive)
        times = jnp.concatenate([cycle * when.period + when.phases for cycle in (self.number - 1, self.number)])
        state, _, _, failure = integrate_to_times(system, times, accuracy)
        measured = cycles_at(when, effector_at(system, state).reshape(2, -1))
        return jnp.stack([getattr(measured, name)[0] for name in METRICS]), failure

    def opening(self, system: StickSlip) -> Opening:
        none, unknown = jnp.zeros((), int), jnp.full((), jnp.nan)
        return Opening(flat(system.initial()), none, unknown, unknown, none)

    def course(self, system: StickSlip, opening: Opening) -> Course:
        when = timing(system.drive)
        run = integrate_steps(system, self.number * when.period + when.phases[-1], FINE)
        return Course(system, system, run, (self.number - 1) * when.period, jnp.ones((), int), 1, run.failure)


TOLERANCE = 2e-11
"""Largest distance [m] of a steady cycle from its limit."""

_CYCLES = 24
"""Cycles integrated side by side; a motion that is not steady then is left to Newton's method."""

_STEADY_METRICS = {
    "cycles_to_repeat": Metric("1", "cycles until the motion repeats; 0: it does not"),
    "decay": Metric("1", "what is left of a deviation after a cycle"),
}


class Steady(AbstractCycle):
    """The steady cycle; where the motion repeats after 2 or 3 cycles, their mean."""

    @property
    def metrics(self) -> dict[str, Metric]:
        return METRICS | _STEADY_METRICS

    @property
    def label(self) -> int | str:
        return "steady"

    @property
    def accuracy(self) -> Accuracy:
        """Finer than for a numbered cycle: errors of the steps must not look like a transient."""
        return Accuracy(tolerance=1e-12, method=SIDE_BY_SIDE, max_steps=16384)

    def measure(self, system: StickSlip, accuracy: Accuracy) -> tuple[Float[Array, " metrics"], Count]:
        when = timing(system.drive)
        cycles = integrate_cycles(system, when.period, when.phases, accuracy, TOLERANCE, _CYCLES)
        return _mean_metrics(system, cycles, cycles.period, _decay(cycles)), cycles.failure

    def unfinished(self, found: Float[np.ndarray, "points metrics"]) -> Bool[np.ndarray, " points"]:
        """Whether a point's motion does not repeat yet; points that are not finite failed."""
        return np.isfinite(found[:, 0]) & (found[:, list(self.metrics).index("cycles_to_repeat")] == 0)

    def measure_patiently(self, system: StickSlip, accuracy: Accuracy) -> tuple[Float[Array, " metrics"], Count]:
        when, opening = timing(system.drive), _orbit(system, accuracy)
        # From the orbit on the motion repeats at once; without an orbit these cycles follow those integrated so far.
        cycles = integrate_cycles(restarted(system, opening.x), when.period, when.phases, accuracy, 0.0, PERIODS + 1)
        decay = jnp.where(jnp.isfinite(opening.multiplier), opening.multiplier, _decay(cycles))
        measured = _mean_metrics(system, cycles, opening.repeats, decay)
        failure = jnp.where(cycles.failure > 0, cycles.failure, opening.failure)
        return measured, jnp.where((failure == 0) & (opening.grazing < GRAZES), GRAZING, failure)

    def opening(self, system: StickSlip) -> Opening:
        return lax.stop_gradient(_orbit(lax.stop_gradient(system), FINE))

    def course(self, system: StickSlip, opening: Opening) -> Course:
        when, again = timing(system.drive), restarted(system, opening.x)
        span = jnp.where(opening.repeats > 0, opening.repeats, PERIODS)
        run = integrate_steps(again, span * when.period + when.phases[-1], FINE)
        failure = jnp.where(opening.failure > 0, opening.failure, run.failure)
        return Course(system, again, run, jnp.zeros(()), span, PERIODS, failure)

    def opening_derivatives(
        self,
        system: StickSlip,
        opening: Opening,
        monodromy: Float[Array, "components components"],
        driven: Float[Array, "components by"],
    ) -> Float[Array, "components by"]:
        """(I - M)^-1 dP/dp, without components that nothing depends on; NaN where Newton's method found no orbit."""
        return jnp.where(jnp.isfinite(opening.multiplier), moved_orbit(system, monodromy, driven), jnp.nan)


def _orbit(system: StickSlip, accuracy: Accuracy) -> Opening:
    """The opening of the steady motion, or of the last cycle integrated where the motion does not repeat."""
    period = timing(system.drive).period
    found = steady_state(system, period, accuracy, 0.1 * TOLERANCE, partial(grazing, system))
    return Opening(found.x, found.period, found.multipliers[0], found.grazing, found.failure)


def _mean_metrics(system: StickSlip, cycles: Cycles, period: Count, decay: Scalar) -> Float[Array, " metrics"]:
    """The metrics, in the mean over the cycles until the motion repeats, or over all cycles where it does not."""
    when = timing(system.drive)
    effector = jax.vmap(lambda x: effector_at(system, x))(cycles.x)
    last = effector.shape[0]
    span = jnp.where(period > 0, period, last - 1)
    counts = jnp.arange(last - 1) >= last - 1 - span
    mean = lambda values: jnp.sum(jnp.where(counts, values, 0.0)) / span
    # The net step of a steady cycle is the same at every phase; a fit of flanks that still ring is less accurate.
    net = (effector[-1, 0] - effector[last - 1 - span, 0]) / span
    stroke = mean(cycles_at(when, effector).stroke)
    found = _metrics_of(net, stroke, when.frequency) | {"cycles_to_repeat": period * 1.0, "decay": decay}
    return jnp.stack([found[name] for name in METRICS | _STEADY_METRICS])


def _decay(cycles: Cycles) -> Scalar:
    """Factor by which a deviation shrinks over a cycle; 0 where two cycles are equal."""
    return jnp.where(jnp.isfinite(cycles.ratio), cycles.ratio, 0.0)


def measured_cycle(cycles: int | str) -> AbstractCycle:
    """The cycle that `sweep(cycles=...)` asks for: a number, or "steady"; **raises** `InputError` for anything else."""
    if cycles == "steady":
        return Steady()
    # Integers of NumPy are legal, too.
    if isinstance(cycles, bool | str) or not isinstance(cycles, Integral) or not 1 <= int(cycles) <= MOST_DRAWN:
        raise InputError(f'sweep: found cycles = {cycles!r:.80}, expected a number of at least 1, or "steady".')
    return Numbered(int(cycles))
