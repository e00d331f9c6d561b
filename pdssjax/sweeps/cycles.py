"""The cycle of a motion that a sweep measures: that of a given number, counted from rest, or the steady one.

For the steady cycle, points side by side are integrated until their motion repeats; the few that take longer are found
one by one, by Newton's method on the cycle map (`pdssjax.integration.steady_motion`), or, near one with a reversal that
grazes, by integrating many cycles.  Further metrics and derivatives need a `Course`: the measured motion with all its
steps.
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
"""Steps of points side by side, where all that an order adds is computed: finer series would gain nothing."""

FINE = Accuracy(tolerance=1e-17, settle_tolerance=1e-15)
"""Accuracy for derivatives: a net step is a small difference of long motions, which coarser steps lose."""

_LINE = 6
"""Samples by which the line of a flank is found."""

_INSIDE = 1e-6
"""How far inside the fitted part they stay, in parts of a flank: rounding must not put one outside."""

_PARTS = np.linspace(FLANK[0] + _INSIDE, FLANK[1] - _INSIDE, _LINE)
"""Fractions of the voltage's way along the flank, where the samples are."""


class Metric(NamedTuple):
    """A quantity that is measured at each point."""

    unit: str
    """In SI."""
    says: str
    """In words."""
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


OF_FLANKS = "efficiency", "stroke", "back_slip"
"""Metrics of a cycle that is a slow and a fast flank."""


class Opening(NamedTuple):
    """Where a course begins."""

    x: Float[Array, " components"]
    """The state; at rest, or just before the corner that opens a cycle that repeats."""
    repeats: Count
    """After how many cycles the motion is there again; 0 where that is not asked, or where it is not."""
    multiplier: Scalar
    """Modulus of the largest Floquet multiplier; NaN: there is no orbit, or it grazes."""
    grazing: Scalar
    """How near a reversal of the orbit that Newton's method found is to grazing; where it grazes, this is the opening
    of integrated cycles instead.  NaN: there is none that attracts."""
    failure: Count
    """Index into `pdssjax.integration.FAILURES`."""


class Course(NamedTuple):
    """One cycle, or all those after which a motion repeats, integrated with room for what tells the last slip."""

    system: StickSlip
    moving: AbstractHybridSystem
    """What was integrated: the system, or the system from the opening of a cycle on."""
    run: SteppedRun
    begin: Scalar
    """When the first of the cycles opens, on the clock of `moving` [s]."""
    span: Count
    """How many there are."""
    most: int
    """How many there may be."""
    failure: Count
    """Index into `pdssjax.integration.FAILURES`."""


class AbstractCycle(eqx.Module):
    """A cycle of a motion, which is to be measured."""

    @property
    def metrics(self) -> dict[str, Metric]:
        """The metrics of the cycle, by name."""
        return METRICS

    @property
    @abc.abstractmethod
    def described(self) -> int | str:
        """The cycle as `sweep(cycles=...)` takes it."""

    @property
    @abc.abstractmethod
    def accuracy(self) -> Accuracy:
        """How finely to integrate where nothing else is said."""

    @abc.abstractmethod
    def measure(self, system: StickSlip, accuracy: Accuracy) -> tuple[Float[Array, " metrics"], Count]:
        """The `metrics`, and an index into `pdssjax.integration.FAILURES`; points are side by side."""

    @abc.abstractmethod
    def opening(self, system: StickSlip) -> Opening:
        """Where the measured motion begins, found finely; not differentiable."""

    @abc.abstractmethod
    def course(self, system: StickSlip, opening: Opening) -> Course:
        """The measured motion with all its steps, finely integrated: for further metrics and for derivatives.

        Differentiable in every floating-point leaf of `system`, and in the state of an `opening` that repeats.
        """

    def moved_opening(
        self,
        system: StickSlip,
        opening: Opening,
        monodromy: Float[Array, "components components"],
        driven: Float[Array, "components by"],
    ) -> Float[Array, "components by"]:
        """Derivatives of the opening's state, given those of the state that ends the course; at rest there are none."""
        return jnp.zeros_like(driven)

    def unfinished(self, found: Float[np.ndarray, "points metrics"]) -> Bool[np.ndarray, " points"]:
        """Which points are worth a `patient` look; none by default."""
        return np.zeros(len(found), bool)

    def patient(self, system: StickSlip, accuracy: Accuracy) -> tuple[Float[Array, " metrics"], Count]:
        """Measure the few points that are `unfinished`, one after the other.  Fails with `GRAZING`, too."""
        return self.measure(system, accuracy)


class Timing(NamedTuple):
    """When the cycles of a drive are measured."""

    frequency: Scalar
    """Cycles a second [Hz]."""
    fall: Scalar
    """Duration of the fast flank [s], with which a cycle begins."""
    phases: Float[Array, " line"]
    """Sample times [s] within a cycle, on its slow flank: evenly by the voltage."""
    has_flanks: bool
    """The cycle is a slow and a fast flank."""

    @property
    def period(self) -> Scalar:
        """Period of the drive [s]."""
        return 1.0 / self.frequency


def timing(drive: AbstractDrive) -> Timing:
    """When the cycles of a periodic `drive` are measured."""
    frequency, flanks = jnp.asarray(drive.cycle_frequency(), float), drive.flanks()
    fall = jnp.zeros(()) if flanks is None else jnp.asarray(flanks.fast, float)
    phases = fall + (1.0 / frequency - fall) * drive.slow_flank_times(_PARTS)
    return Timing(frequency, fall, phases, flanks is not None)


def cycles_at(when: Timing, effector: Float[Array, "flanks line"]) -> CycleMetrics:
    """Metrics of each cycle but the last, from the `effector` [m] at the phases of the slow flanks.

    The stroke is what the end-effector moves with the voltage along the flank, times the flank's whole voltage: as if
    the flank were straight, where it is not.  Without a slow and a fast flank there are no stroke, back-slip and
    efficiency: NaN.
    """
    straight = when.fall + (when.period - when.fall) * _PARTS
    times = (jnp.arange(len(effector))[:, None] * when.period + straight).ravel()
    found = cycle_metrics(times, effector.ravel(), when.frequency, 0.0, len(effector) - 1, when.fall)
    if when.has_flanks:
        return found
    return found._replace(**dict.fromkeys(OF_FLANKS, jnp.full_like(found.stroke, jnp.nan)))


def effector_at(system: StickSlip, x: StickSlipState[Float[Array, " m"]]) -> Float[Array, " m"]:
    """Displacement [m] of the end-effector in many states."""
    y, _ = jax.vmap(system.actuator.driven_platform.platform)(x.driven)
    return y - x.d


def sampled_states(course: Course, phases: Float[Array, " phases"], cycles: int) -> SampledStates:
    """The states at `phases` [s] of each of the first `cycles` cycles, one after the other."""
    period = timing(course.system.drive).period
    times = course.begin + (jnp.arange(cycles)[:, None] * period + phases).ravel()
    return states_at(course.moving, course.run, times)


def closing(course: Course) -> Float[Array, " components"]:
    """The state just before the corner that ends the cycles."""
    period = timing(course.system.drive).period
    before = (course.begin + course.span * period * (1.0 - SHORT))[None]
    return jnp.stack([leaf[0] for leaf in jax.tree.leaves(states_at(course.moving, course.run, before).x)])


def mean_over_cycles(course: Course, values: Float[Array, " cycles"]) -> Scalar:
    """The mean of what each of `course.most` cycles has, over those that there are."""
    counts = jnp.arange(course.most) < course.span
    return jnp.sum(jnp.where(counts, values, 0.0)) / course.span


def step_metrics(course: Course) -> dict[str, Scalar]:
    """The metrics that every cycle has (`METRICS`), differentiable in all that the course is."""
    when = timing(course.system.drive)
    effector = effector_at(course.system, sampled_states(course, when.phases, course.most + 1).x)
    effector = effector.reshape(course.most + 1, -1)
    found, places = cycles_at(when, effector), effector[:, 0]
    net = (places[course.span] - places[0]) / course.span
    stroke = mean_over_cycles(course, found.stroke)
    return _metrics_of(net, stroke, when.frequency)


def _metrics_of(net: Scalar, stroke: Scalar, frequency: Scalar) -> dict[str, Scalar]:
    """`METRICS`, by name and in their order, of the net step and the stroke of a cycle."""
    found = {"efficiency": net / stroke, "stroke": stroke, "back_slip": stroke - net}
    found |= {"net_step": net, "speed": net * frequency}
    return {name: found[name] for name in METRICS}


def steps_within(course: Course) -> tuple[Bool[Array, " room"], Count]:
    """Which steps belong to the cycles, and to how many: of a motion that repeats its last period is there once."""
    run, period = course.run, timing(course.system.drive).period
    begins = jax.lax.stop_gradient(run.steps.origin + run.steps.t_local)
    # A step that begins this part of a period before a cycle opens belongs to that cycle.
    opening = jnp.where(run.repeats, run.steps.origin[run.period], course.begin) - 1e-9 * period
    cycles = jnp.where(run.repeats, 1, course.span)
    real = jnp.arange(begins.shape[0]) < run.count
    return real & (begins >= opening) & (begins < opening + cycles * period), cycles


class Numbered(AbstractCycle):
    """Cycle `number`; the flank of the next one tells its slip."""

    number: int = eqx.field(static=True, default=4)

    @property
    def described(self) -> int | str:
        return self.number

    @property
    def accuracy(self) -> Accuracy:
        """Fine enough to agree with single runs to 1e-4 um."""
        return Accuracy(tolerance=3e-11, method=SIDE_BY_SIDE)

    def measure(self, system: StickSlip, accuracy: Accuracy) -> tuple[Float[Array, " metrics"], Count]:
        when = timing(system.drive)
        begin = (self.number - 1) * when.period
        times = jnp.concatenate([begin + when.phases, self.number * when.period + when.phases])
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
"""How far [m] a cycle may be from its limit."""

_CYCLES = 24
"""Integrated side by side; what has not become steady then waits for Newton's method."""


_OWN = {
    "cycles_to_repeat": Metric("1", "cycles until the motion repeats; 0: it does not"),
    "decay": Metric("1", "what is left of a deviation after a cycle"),
}


class Steady(AbstractCycle):
    """The steady cycle; where the motion repeats after 2 or 3 cycles only, the mean of them."""

    @property
    def metrics(self) -> dict[str, Metric]:
        return METRICS | _OWN

    @property
    def described(self) -> int | str:
        return "steady"

    @property
    def accuracy(self) -> Accuracy:
        """Finer than for a numbered cycle: errors of the steps must not look like a transient."""
        return Accuracy(tolerance=1e-12, method=SIDE_BY_SIDE, max_steps=16384)

    def measure(self, system: StickSlip, accuracy: Accuracy) -> tuple[Float[Array, " metrics"], Count]:
        when = timing(system.drive)
        cycles = integrate_cycles(system, when.period, when.phases, accuracy, TOLERANCE, _CYCLES)
        return _mean_metrics(system, cycles, cycles.period, _ratio(cycles)), cycles.failure

    def unfinished(self, found: Float[np.ndarray, "points metrics"]) -> Bool[np.ndarray, " points"]:
        """The points that did not repeat; others that are not finite failed."""
        return np.isfinite(found[:, 0]) & (found[:, list(self.metrics).index("cycles_to_repeat")] == 0)

    def patient(self, system: StickSlip, accuracy: Accuracy) -> tuple[Float[Array, " metrics"], Count]:
        when, opening = timing(system.drive), _orbit(system, accuracy)
        # From the orbit on it repeats at once; where none was found these cycles are the last that were seen.
        cycles = integrate_cycles(restarted(system, opening.x), when.period, when.phases, accuracy, 0.0, PERIODS + 1)
        decay = jnp.where(jnp.isfinite(opening.multiplier), opening.multiplier, _ratio(cycles))
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

    def moved_opening(
        self,
        system: StickSlip,
        opening: Opening,
        monodromy: Float[Array, "components components"],
        driven: Float[Array, "components by"],
    ) -> Float[Array, "components by"]:
        """(I - M)^-1 dP/dp, without what nothing depends on; NaN where Newton's method found no orbit."""
        moved = moved_orbit(system, monodromy, driven)
        return jnp.where(jnp.isfinite(opening.multiplier), moved, jnp.nan)


def _orbit(system: StickSlip, accuracy: Accuracy) -> Opening:
    """The opening of the steady motion; of the last cycle that was integrated where it does not repeat."""
    period = timing(system.drive).period
    found = steady_state(system, period, accuracy, 0.1 * TOLERANCE, partial(grazing, system))
    return Opening(found.x, found.period, found.multipliers[0], found.grazing, found.failure)


def _mean_metrics(system: StickSlip, cycles: Cycles, period: Count, decay: Scalar) -> Float[Array, " metrics"]:
    """The metrics, in the mean over the cycles until the motion repeats, or over the last where it does not."""
    when = timing(system.drive)
    effector = jax.vmap(lambda x: effector_at(system, x))(cycles.x)
    last = effector.shape[0]
    span = jnp.where(period > 0, period, last - 1)
    counts = jnp.arange(last - 1) >= last - 1 - span
    mean = lambda values: jnp.sum(jnp.where(counts, values, 0.0)) / span
    # What a steady cycle shifts is the same at every phase; flanks that still ring would tell it less well.
    net = (effector[-1, 0] - effector[last - 1 - span, 0]) / span
    stroke = mean(cycles_at(when, effector).stroke)
    found = _metrics_of(net, stroke, when.frequency) | {"cycles_to_repeat": period * 1.0, "decay": decay}
    return jnp.stack([found[name] for name in METRICS | _OWN])


def _ratio(cycles: Cycles) -> Scalar:
    """Factor by which a deviation shrinks over a cycle; 0 where two cycles are equal."""
    return jnp.where(jnp.isfinite(cycles.ratio), cycles.ratio, 0.0)


def measured_cycle(cycles: int | str) -> AbstractCycle:
    """The cycle that `sweep(cycles=...)` asks for: a number, or "steady".

    **Raises:** `InputError` for anything else.
    """
    if cycles == "steady":
        return Steady()
    # An integer of NumPy is one, too.
    if isinstance(cycles, bool | str) or not isinstance(cycles, Integral) or not 1 <= int(cycles) <= MOST_DRAWN:
        raise InputError(f'sweep: found cycles = {cycles!r:.80}, expected a number of at least 1, or "steady".')
    return Numbered(int(cycles))
