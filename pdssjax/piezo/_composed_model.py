"""The model of a composed stack, and its class, made of the text that names it: its parameters become its fields.

`composed` tells the equations.
"""

import copy
from collections.abc import Mapping
from functools import cache
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..core import Scalar, ScalarLike, quantities
from ..drive.base import Segment, Voltage
from ..integration import N, Term
from ._ceramic import AbstractHysteresis, BoucWen, Ceramic, Elements, Layout, Parts, joined
from ._composition import (
    Composition,
    composed_guess,
    composition_of,
    creep_range,
    fields_of,
    hysteretic_names,
    loop_columns,
    loop_numbers,
    mechanical_names,
)
from ._dynamics import AbstractDynamics, FirstOrder, Modal, Mode, Static
from ._on_lines import (
    CeramicArrays,
    Line,
    Moment,
    advanced,
    begins_of_lines,
    inside_lines,
    lines_a_segment,
    place_among_lines,
    straightened,
)
from ._rod import Rod, modes
from .base import AbstractPiezo, DeterminableRange, Shown, State, Terms, slew_sign


class ComposedModel(AbstractPiezo):
    """The mechanics' states, the voltage seen [V], then the elements' and those of creep; then flags."""

    has_steady_state = False
    made: ClassVar[Composition]
    """Parts of the stack."""
    told: ClassVar[dict[str, str]]
    """Meaning of each parameter."""

    @classmethod
    def first_guess(cls, shown: Shown, known: Mapping[str, float]) -> dict[str, float]:
        nominal = {name: declared.nominal for name, declared in quantities(cls).items()}
        return composed_guess(cls.made, nominal, shown, known, super().first_guess(shown, known))

    @classmethod
    def loop_columns(
        cls, time: Float[np.ndarray, " n"], volts: Float[np.ndarray, " n"], numbers: Mapping[str, float]
    ) -> dict[str, Float[np.ndarray, " n"]]:
        return loop_columns(cls.made, time, volts, numbers)

    @classmethod
    def determinable_ranges(cls, shown: Shown) -> dict[str, DeterminableRange]:
        return creep_range(cls.made, shown)

    def broken_conditions(self) -> tuple[str, ...]:
        if self.made.hysteresis == "maxwell-slip":
            held, gain = sum(map(float, self._numbered("stop"))), float(self._get("gain"))
            if held > gain:
                return (f"piezo.stop_1 to piezo.stop_{self.made.elements} together are {held:.4g} m/V, above the gain",)
        if self.made.hysteresis == "bouc-wen":
            beta, gamma = float(self._get("beta")), float(self._get("gamma"))
            if abs(gamma) > beta:
                return (f"piezo.gamma is {gamma:.4g} 1/V, beyond piezo.beta, {beta:.4g} 1/V",)
        return ()

    @property
    def dynamics(self) -> AbstractDynamics:
        """The mechanics, with their numbers."""
        if self.made.dynamics == "static":
            return Static()
        if self.made.dynamics == "first-order":
            return FirstOrder(self._get("time_constant"))
        if self.made.dynamics == "second-order":
            numbers = (self._get(name) for name in ("natural_frequency", "damping_ratio", "mass"))
            return Modal((Mode(1.0, *numbers),))
        names = ("modulus", "viscosity", "density", "area", "platform_mass")
        length = self._get("stack_length")
        kept = modes(
            Rod(**{n: self._get(n) for n in names}, length=length, strain=1.0 / length),  # pyright: ignore[reportArgumentType]
            self.made.modes,
        )
        columns = (kept.gain, kept.natural_frequency, kept.damping_ratio, kept.mass)
        return Modal(tuple(Mode(*(column[j] for column in columns)) for j in range(self.made.modes)))

    @property
    def ceramic(self) -> Ceramic:
        """Polynomial, hysteresis and creep, with their numbers."""
        gain, law = self._get("gain"), self._law()
        if self.made.hysteresis == "maxwell-slip":
            gain = gain - sum(law.weights)
        curves = (self._get(f"asymmetry_{k}") for k in range(2, self.made.asymmetry + 1))
        times = tuple(self._get("creep_time") * 10.0**j for j in range(self.made.creep))
        return Ceramic((gain, *curves), law, self._numbered("creep"), times)

    def _law(self) -> AbstractHysteresis:
        """The law of hysteresis, with its numbers."""
        if self.made.hysteresis == "bouc-wen":
            return BoucWen((self._get("hysteresis"),), self._get("beta"), self._get("gamma"))
        if not self.made.has_elements:
            return Elements()
        word = "play" if self.made.hysteresis == "play" else "stop"
        span, many = self._get(f"{word}_range"), self.made.elements
        return Elements(self._numbered(word), tuple(span * (j / many) for j in range(1, many + 1)))

    def initial(self) -> State:
        rest, zero = self._get("initial_voltage") * jnp.ones(()), jnp.zeros(())
        ceramic, law = self.ceramic, self._law()
        peak = self._get("initial_peak") if self.made.hysteresis != "none" else zero
        stops = law.driven(law.driven((zero,) * law.count, peak), rest - peak)
        left = self._numbered("initial_creep")
        crept = tuple(k * rest + d for k, d in zip(ceramic.shares, left, strict=True))
        aim = ceramic.aim(rest, stops, crept)
        flags = tuple(zero + flag for flag in (1.0, *law.first_marks)) if law.count else ()
        slope = zero if self.made.dynamics == "static" else None
        return joined(Parts(self.dynamics.initial(aim), rest, slope, stops, crept, flags))

    def rate(self, state: Terms, voltage: Voltage[Term], force: Term) -> Terms:
        ceramic, x = self.ceramic, self._parts(state)
        mechanics = self.dynamics.rates(x.mechanics, ceramic.aim(x.seen, x.stops, x.crept), force)
        slope = voltage.slope if x.slope is None else x.slope
        bend = None if x.slope is None else voltage.bend + x.slope * 0.0
        flags = tuple(0 for _ in x.flags)
        return joined(Parts(mechanics, slope, bend, ceramic.stop_rates(x, slope), ceramic.creep_rates(x), flags))

    def platform(self, state: tuple[N, ...]) -> tuple[N, N]:
        ceramic, x = self.ceramic, self._parts(state)
        aim = ceramic.aim(x.seen, x.stops, x.crept)
        speed = aim if x.slope is None else ceramic.aim_rate(x, x.slope)
        return self.dynamics.platform(x.mechanics, aim, speed)

    def acceleration(self, state: Terms, voltage: Voltage[Term]) -> Term:
        ceramic, x = self.ceramic, self._parts(state)
        slope = voltage.slope if x.slope is None else x.slope
        aim, speed = ceramic.aim(x.seen, x.stops, x.crept), ceramic.aim_rate(x, slope)
        return self.dynamics.acceleration(x.mechanics, aim, speed, ceramic.aim_bend(x, slope, voltage.bend))

    def steady(self, state: State, segment: Segment, t_local: ScalarLike, force: ScalarLike) -> State:
        return state

    def guards(self, state: Terms, voltage: Voltage[Term]) -> Terms:
        x = self._parts(state)
        if not x.flags:
            return ()
        turns = x.seen * 0.0 + voltage.slope * x.rises
        return turns, *self._law().guards(x.stops, x.rises, x.marks)

    def after_event(self, state: State, voltage: Voltage[Scalar], which: Scalar) -> State:
        x = self._parts(state)
        turned = jnp.where(which == 0, -x.rises, x.rises)
        return joined(x._replace(flags=(turned, *self._law().marks_after(x.marks, which))))

    def on_segment_start(self, state: State, segment: Segment) -> State:
        x, law = self._parts(state), self._law()
        voltage = segment.voltage(0.0)
        stops = law.driven(x.stops, voltage.level - x.seen)
        slope = None if x.slope is None else voltage.slope + 0.0 * x.slope
        x = x._replace(seen=voltage.level + 0.0 * x.seen, slope=slope, stops=stops)
        if not x.flags:
            return joined(x)
        rises = slew_sign(voltage, x.rises)
        return joined(x._replace(flags=(rises, *law.marks_at(stops, rises))))

    def motion(self, state: State, segment: Segment, t_local: ScalarLike, elapsed: ScalarLike) -> State:
        x = self._parts(state)
        line = Line(segment.voltage(t_local).level, jnp.asarray(segment.slope, float))
        end = advanced(self._arrays(), self.dynamics, line, self._moment(x), elapsed)
        return self._state_at(end, line.start + line.slope * elapsed, line.slope)

    def states_on_lines(
        self, segments: Segment, places: Int[Array, " m"], t_local: Float[Array, " m"]
    ) -> tuple[Float[Array, " m"], ...]:
        ceramic, dynamics, x = self._arrays(), self.dynamics, self._parts(self.initial())
        now = jax.vmap(Segment.voltage)(jax.tree.map(lambda array: array[places], segments), t_local)
        if segments.wave is not None:
            many = lines_a_segment(segments.start.size)
            places, t_local = place_among_lines(segments, places, t_local, many)
            segments = straightened(segments, many)
        lines = Line(segments.start, segments.slope)
        durations = jnp.where(jnp.isfinite(segments.duration), segments.duration, 0.0)
        begins = begins_of_lines(ceramic, dynamics, lines, durations, x.seen, self._moment(x))
        here, line = (jax.tree.map(lambda array: array[places], tree) for tree in (begins, lines))
        moments = inside_lines(ceramic, dynamics, line, here, t_local)
        return jax.vmap(self._state_at)(moments, now.level, now.slope)

    def error_scale(self) -> State:
        metre, volt, mechanics = jnp.ones(()), self.static_gain(), self.dynamics.scales()
        slope = volt / self.frequency_scale() if self.made.dynamics == "static" else None
        has = self._layout()
        return joined(Parts(mechanics, volt, slope, (volt,) * has.stops, (metre,) * has.crept, (metre,) * has.flags))

    def static_gain(self) -> Scalar:
        ceramic = self.ceramic
        return jnp.asarray(sum(ceramic.hysteresis.weights, ceramic.memoryless[0]), float)

    def frequency_scale(self) -> Scalar:
        return self.dynamics.frequency_scale()

    def _arrays(self) -> CeramicArrays:
        ceramic, law = self.ceramic, self._law()
        thresholds = law.thresholds if isinstance(law, Elements) else ()
        arrays = (law.weights, thresholds, ceramic.shares, ceramic.times)
        return CeramicArrays(ceramic.memoryless, *(jnp.asarray(numbers, float) for numbers in arrays))

    def _moment(self, x: Parts[Any]) -> Moment:
        return Moment(*(jnp.asarray(numbers, float) for numbers in (x.mechanics, x.stops, x.crept)))

    def _state_at(self, moment: Moment, seen: Scalar, slope: Scalar) -> State:
        """The state at a moment within a line."""
        flags: tuple[Scalar, ...] = ()
        stops = tuple(moment.stops)
        if self.made.has_elements:
            rises = jnp.where(slope < 0.0, -1.0, 1.0)
            flags = (rises, *self._law().marks_at(stops, rises))
        rate = slope if self.made.dynamics == "static" else None
        return joined(Parts(tuple(moment.mechanics), seen, rate, stops, tuple(moment.crept), flags))

    def _numbered(self, word: str) -> tuple[ScalarLike, ...]:
        many = self.made.creep if word in ("creep", "initial_creep") else self.made.elements
        return tuple(self._get(f"{word}_{j}") for j in range(1, many + 1))

    def _get(self, name: str) -> ScalarLike:
        number: ScalarLike = getattr(self, name)
        return number

    def _layout(self) -> Layout:
        static = 1 if self.made.dynamics == "static" else 0
        return Layout(len(self.dynamics.scales()), static, self._law().count, self.made.creep)

    def _parts(self, state: tuple[N, ...]) -> Parts[Any]:
        return self._layout().split(state)


HOME = "pdssjax.piezo.composed"
"""Where classes say that they come from: there another process finds them by name."""


@cache
def composed_class(made: Composition) -> type[ComposedModel]:
    """The class of a stack that is `made` so: always the same one."""
    fields = fields_of(made)
    compliant = made.dynamics in ("second-order", "rod")
    name = "Composed" if made == Composition() else f"Composed:{made.text}"
    contents: dict[str, Any] = {
        "__module__": HOME,
        "__qualname__": name,
        "__doc__": ComposedModel.__doc__,
        "__annotations__": {field.name: float for field in fields},
        "made": made,
        "told": {field.name: field.text for field in fields},
        "variant_name": "" if made == Composition() else made.text,
        "variant": staticmethod(composed_variant),
        "is_compliant": compliant,
        "loop_numbers": loop_numbers(made),
        "mechanical": mechanical_names(made),
        "hysteretic": hysteretic_names(made),
        "closed_on_lines": made.closed_on_lines,
        # Copies: a declaration belongs to the one field that it is given to.
        **{field.name: copy.copy(field.declared) for field in fields},
    }
    if "mass" not in contents:
        contents["mass"] = property(_mass)
    metaclass: Any = type(ComposedModel)
    return metaclass(name, (ComposedModel,), contents)


def _mass(stack: ComposedModel) -> Scalar:
    """Moving mass [kg] that a force accelerates at first; infinite where none moves the platform."""
    return stack.dynamics.mass()


def composed_variant(text: str) -> type[ComposedModel]:
    """The stack that `text` describes, such as "static+play-8+creep-3".

    **Raises:** `KeyError` for what is no such text.
    """
    return composed_class(composition_of(text))
