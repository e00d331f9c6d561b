"""The model of a composed stack; `composed` tells its equations."""

import copy
from collections.abc import Mapping
from functools import cache
from typing import Any, ClassVar, Generic, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..core import Scalar, ScalarLike, quantities
from ..drive.base import Segment, Voltage
from ..integration import N, N_co, Term
from ._bouc_wen_path import after_jump
from ._composition import Composition, composition_of, fields_of
from ._dynamics import AbstractDynamics, FirstOrder, Modal, Mode, Static
from ._on_lines import Ceramic, Line, Moment, advanced, begins_of_lines, inside_lines
from ._rod import Rod, modes
from .base import USUAL_SWING, AbstractPiezo, Shown, State, Terms, slew_sign

_ROUNDING = 1e-12
"""Part of its threshold by which an element that slips may seem short of it."""

_PARTS = 60.0
"""Times that the fastest element's time of creep fits into the longest record."""

_SHARE = 0.2
"""Of the displacement that is hysteresis, where a fit begins."""

HOME = "pdssjax.piezo.composed"
"""Where classes say that they come from: there another process finds them by name."""


class Parts(NamedTuple, Generic[N_co]):
    """The state of a composed stack in words."""

    mechanics: tuple[N_co, ...]
    """Of the dynamics."""
    seen: N_co
    """The voltage [V]."""
    slope: N_co | None
    """Its rate [V/s]; None where no velocity hangs on it."""
    stops: tuple[N_co, ...]
    """How far the voltage is ahead of each element [V]; of Bouc and Wen's h."""
    crept: tuple[N_co, ...]
    """What each element of creep has added [m]."""
    flags: tuple[N_co, ...]
    """The sign of the voltage's rate; then which elements slip, or the sign of h."""


class ComposedModel(AbstractPiezo):
    """The mechanics' states, the voltage seen [V], then the elements' and those of creep; then flags."""

    has_steady_state = False
    made: ClassVar[Composition]
    """What it is made of."""
    told: ClassVar[dict[str, str]]
    """What each parameter is."""

    @classmethod
    def variant(cls, text: str) -> "type[ComposedModel]":
        """The stack that `text` describes, such as "static+play-8+creep-3".

        **Raises:** `KeyError` for what is no such text.
        """
        return composed_class(composition_of(text))

    @classmethod
    def first_guess(cls, shown: Shown, known: Mapping[str, float]) -> dict[str, float]:
        made, nominal = cls.made, {name: declared.nominal for name, declared in quantities(cls).items()}
        guess = super().first_guess(shown, known)
        swing = shown.swing or USUAL_SWING
        gain = known.get("gain", guess.get("gain", nominal["gain"]))
        if made.hysteresis in ("play", "bouc-wen"):
            # The records show what follows in the end.
            guess["gain"] = (1.0 - _SHARE) * gain
        if made.has_elements:
            word = "play" if made.hysteresis == "play" else "stop"
            guess |= {f"{word}_range": nominal[f"{word}_range"] * swing / USUAL_SWING}
            guess |= {f"{word}_{j}": _SHARE * gain / made.elements for j in range(1, made.elements + 1)}
        if made.hysteresis == "bouc-wen":
            beta = known.get("beta", nominal["beta"] * USUAL_SWING / swing)
            guess |= {"hysteresis": _SHARE * gain, "beta": beta, "gamma": beta / 3.0}
        guess |= {f"asymmetry_{k}": 0.01 * gain / swing ** (k - 1) for k in range(2, made.asymmetry + 1)}
        guess |= {f"initial_creep_{j}": 0.01 * gain * swing for j in range(1, made.creep + 1)}
        guess |= {f"creep_{j}": 0.01 * gain for j in range(1, made.creep + 1)}
        if made.creep and shown.duration:
            guess["creep_time"] = 10.0 * shown.duration / 10.0**made.creep
        if shown.interval and "time_constant" in nominal:
            guess["time_constant"] = 2.0 * shown.interval
        return guess

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

    def initial(self) -> State:
        rest, zero = self._get("initial_voltage") * jnp.ones(()), jnp.zeros(())
        peak = self._get("initial_peak") if self.made.hysteresis != "none" else zero
        stops = self._driven(self._driven(self._at_zero(), peak), rest - peak)
        left = self._numbered("initial_creep")
        crept = tuple(k * rest + d for k, d in zip(self._numbered("creep"), left, strict=True))
        aim = self._aim(rest, stops, crept)
        marks = 1 if self.made.hysteresis == "bouc-wen" else self.made.elements
        flags = tuple(zero + (1.0 if j == 0 or not self.made.has_elements else 0.0) for j in range(1 + marks))
        slope = zero if self.made.dynamics == "static" else None
        return self._joined(Parts(self.dynamics.initial(aim), rest, slope, stops, crept, flags[: self._flags()]))

    def rate(self, state: Terms, voltage: Voltage[Term], force: Term) -> Terms:
        x = self._parts(state)
        mechanics = self.dynamics.rates(x.mechanics, self._aim(x.seen, x.stops, x.crept), force)
        slope = voltage.slope if x.slope is None else x.slope
        bend = None if x.slope is None else voltage.bend + x.slope * 0.0
        flags = tuple(0 for _ in x.flags)
        return self._joined(Parts(mechanics, slope, bend, self._stop_rates(x, slope), self._creep_rates(x), flags))

    def platform(self, state: tuple[N, ...]) -> tuple[N, N]:
        x = self._parts(state)
        aim = self._aim(x.seen, x.stops, x.crept)
        speed = aim if x.slope is None else self._aim_rate(x, x.slope)
        return self.dynamics.platform(x.mechanics, aim, speed)

    def acceleration(self, state: Terms, voltage: Voltage[Term]) -> Term:
        x = self._parts(state)
        slope = voltage.slope if x.slope is None else x.slope
        aim, speed = self._aim(x.seen, x.stops, x.crept), self._aim_rate(x, slope)
        return self.dynamics.acceleration(x.mechanics, aim, speed, self._aim_bend(x, slope, voltage.bend))

    def steady(self, state: State, segment: Segment, t_local: ScalarLike, force: ScalarLike) -> State:
        return state

    def guards(self, state: Terms, voltage: Voltage[Term]) -> Terms:
        x = self._parts(state)
        if not x.flags:
            return ()
        rises, *marks = x.flags
        turns = x.seen * 0.0 + voltage.slope * rises
        if self.made.hysteresis == "bouc-wen":
            return turns, x.stops[0] * marks[0]
        elements = zip(x.stops, marks, self._thresholds(), strict=True)
        return turns, *((r - s * rises) * (1.0 - slip) + slip for s, slip, r in elements)

    def after_event(self, state: State, voltage: Voltage[Scalar], which: Scalar) -> State:
        x = self._parts(state)
        rises, *marks = x.flags
        turns = which == 0
        if self.made.hysteresis == "bouc-wen":
            changed = [jnp.where(which == 1, -marks[0], marks[0])]
        else:
            changed = [jnp.where(turns, 0.0, jnp.where(which == i, 1.0, m)) for i, m in enumerate(marks, start=1)]
        return self._joined(x._replace(flags=(jnp.where(turns, -rises, rises), *changed)))

    def on_segment_start(self, state: State, segment: Segment) -> State:
        x = self._parts(state)
        voltage = segment.voltage(0.0)
        stops = self._driven(x.stops, voltage.level - x.seen)
        slope = None if x.slope is None else voltage.slope + 0.0 * x.slope
        x = x._replace(seen=voltage.level + 0.0 * x.seen, slope=slope, stops=stops)
        if not x.flags:
            return self._joined(x)
        rises = slew_sign(voltage, x.flags[0])
        if self.made.hysteresis == "bouc-wen":
            h = stops[0]
            marks = [jnp.where(h == 0.0, rises, jnp.where(h > 0.0, 1.0, -1.0))]
        else:
            elements = zip(stops, self._thresholds(), strict=True)
            marks = [jnp.where(rises * s >= r * (1.0 - _ROUNDING), 1.0, 0.0) for s, r in elements]
        return self._joined(x._replace(flags=(rises, *marks)))

    def motion(self, state: State, segment: Segment, t_local: ScalarLike, elapsed: ScalarLike) -> State:
        x = self._parts(state)
        line = Line(segment.voltage(t_local).level, jnp.asarray(segment.slope, float))
        end = advanced(self._ceramic(), self.dynamics, line, self._moment(x), elapsed)
        return self._stated(end, line.start + line.slope * elapsed, line.slope)

    def states_on_lines(
        self, segments: Segment, places: Int[Array, " m"], t_local: Float[Array, " m"]
    ) -> tuple[Float[Array, " m"], ...]:
        ceramic, dynamics, x = self._ceramic(), self.dynamics, self._parts(self.initial())
        lines = Line(segments.start, segments.slope)
        durations = jnp.where(jnp.isfinite(segments.duration), segments.duration, 0.0)
        begins = begins_of_lines(ceramic, dynamics, lines, durations, x.seen, self._moment(x))
        here, line = (jax.tree.map(lambda array: array[places], tree) for tree in (begins, lines))
        moments = inside_lines(ceramic, dynamics, line, here, t_local)
        return jax.vmap(self._stated)(moments, line.start + line.slope * t_local, line.slope)

    def _ceramic(self) -> Ceramic:
        arrays = (self._weights(), self._thresholds(), self._numbered("creep"), self._creep_times())
        return Ceramic(self._memoryless(), *(jnp.asarray(numbers, float) for numbers in arrays))

    def _moment(self, x: Parts[Any]) -> Moment:
        return Moment(*(jnp.asarray(numbers, float) for numbers in (x.mechanics, x.stops, x.crept)))

    def _stated(self, moment: Moment, seen: Scalar, slope: Scalar) -> State:
        """The state at a moment within a line."""
        flags: tuple[Scalar, ...] = ()
        if self.made.has_elements:
            rises = jnp.where(slope < 0.0, -1.0, 1.0)
            slips = rises * moment.stops >= jnp.asarray(self._thresholds()) * (1.0 - _ROUNDING)
            flags = (rises, *jnp.where(slips, 1.0, 0.0))
        rate = slope if self.made.dynamics == "static" else None
        return self._joined(Parts(tuple(moment.mechanics), seen, rate, tuple(moment.stops), tuple(moment.crept), flags))

    def error_scale(self) -> State:
        metre, volt, mechanics = jnp.ones(()), self.static_gain(), self.dynamics.scales()
        slope = volt / self.frequency_scale() if self.made.dynamics == "static" else None
        stops, crept, flags = self._stop_count(), self.made.creep, self._flags()
        return self._joined(Parts(mechanics, volt, slope, (volt,) * stops, (metre,) * crept, (metre,) * flags))

    def static_gain(self) -> Scalar:
        gain, *_ = self._memoryless()
        return jnp.asarray(sum(self._weights(), gain), float)

    def frequency_scale(self) -> Scalar:
        return self.dynamics.frequency_scale()

    def _aim(self, voltage: N, stops: tuple[N, ...], crept: tuple[N, ...]) -> N:
        """The displacement [m] that the ceramic would have at rest."""
        gain, *curves = self._memoryless()
        total: Any = voltage * gain
        for k, curve in enumerate(curves, start=2):
            total = total + _power(voltage, k) * curve
        for stop, weight in zip(stops, self._weights(), strict=True):
            total = total + (voltage - stop) * weight
        return sum(crept, total)

    def _aim_rate(self, x: Parts[Any], slope: Any) -> Any:
        """Its rate [m/s]."""
        gain, *curves = self._memoryless()
        total = slope * gain
        for k, curve in enumerate(curves, start=2):
            total = total + _power(x.seen, k - 1) * slope * (k * curve)
        for rate, weight in zip(self._stop_rates(x, slope), self._weights(), strict=True):
            total = total + (slope - rate) * weight
        return sum(self._creep_rates(x), total)

    def _aim_bend(self, x: Parts[Any], slope: Any, bend: Any) -> Any:
        """The rate of its rate [m/s2]."""
        gain, *curves = self._memoryless()
        total = x.seen * 0.0 + bend * gain
        for k, curve in enumerate(curves, start=2):
            total = total + slope * slope * _power(x.seen, k - 2) * ((k - 1) * k * curve)
            total = total + _power(x.seen, k - 1) * bend * (k * curve)
        for rate, weight in zip(self._stop_bends(x, slope, bend), self._weights(), strict=True):
            total = total + (bend - rate) * weight
        for rate, share, time in zip(self._creep_rates(x), self._numbered("creep"), self._creep_times(), strict=True):
            total = total + (slope * share - rate) * (1.0 / time)
        return total

    def _stop_rates(self, x: Parts[Any], slope: Any) -> tuple[Any, ...]:
        rises, *marks = x.flags or (jnp.zeros(()),)
        if self.made.hysteresis == "bouc-wen":
            return (slope - slope * x.stops[0] * (rises * self._get("beta") + marks[0] * self._get("gamma")),)
        return tuple(slope * (1.0 - slip) for slip in marks)

    def _stop_bends(self, x: Parts[Any], slope: Any, bend: Any) -> tuple[Any, ...]:
        rises, *marks = x.flags or (jnp.zeros(()),)
        if self.made.hysteresis == "bouc-wen":
            fades = rises * self._get("beta") + marks[0] * self._get("gamma")
            (rate,) = self._stop_rates(x, slope)
            return (bend - (x.stops[0] * bend + slope * rate) * fades,)
        return tuple((1.0 - slip) * bend for slip in marks)

    def _creep_rates(self, x: Parts[Any]) -> tuple[Any, ...]:
        elements = zip(x.crept, self._numbered("creep"), self._creep_times(), strict=True)
        return tuple((x.seen * share - c) * (1.0 / time) for c, share, time in elements)

    def _driven(self, stops: tuple[Scalar, ...], change: ScalarLike) -> tuple[Scalar, ...]:
        """The elements after the voltage has run a way of `change` [V]."""
        if self.made.hysteresis == "bouc-wen":
            return (after_jump(stops[0], change, 1.0, self._get("beta"), self._get("gamma")),)
        return tuple(jnp.clip(s + change, -r, r) for s, r in zip(stops, self._thresholds(), strict=True))

    def _at_zero(self) -> tuple[Scalar, ...]:
        return tuple(jnp.zeros(()) for _ in range(self._stop_count()))

    def _stop_count(self) -> int:
        return 1 if self.made.hysteresis == "bouc-wen" else self.made.elements if self.made.has_elements else 0

    def _flags(self) -> int:
        return 1 + self._stop_count() if self._stop_count() else 0

    def _memoryless(self) -> tuple[ScalarLike, ...]:
        """Coefficients of the voltage, its square, ... [m/V], [m/V^2], ..."""
        gain = self._get("gain")
        if self.made.hysteresis == "maxwell-slip":
            gain = gain - sum(self._weights())
        return gain, *(self._get(f"asymmetry_{k}") for k in range(2, self.made.asymmetry + 1))

    def _weights(self) -> tuple[ScalarLike, ...]:
        """Of what the elements follow [m/V]."""
        if self.made.hysteresis == "bouc-wen":
            return (self._get("hysteresis"),)
        return self._numbered("play" if self.made.hysteresis == "play" else "stop") if self.made.has_elements else ()

    def _thresholds(self) -> tuple[ScalarLike, ...]:
        if not self.made.has_elements:
            return ()
        span = self._get("play_range" if self.made.hysteresis == "play" else "stop_range")
        return tuple(span * (j / self.made.elements) for j in range(1, self.made.elements + 1))

    def _creep_times(self) -> tuple[ScalarLike, ...]:
        return tuple(self._get("creep_time") * 10.0**j for j in range(self.made.creep))

    def _numbered(self, word: str) -> tuple[ScalarLike, ...]:
        many = self.made.creep if word in ("creep", "initial_creep") else self.made.elements
        return tuple(self._get(f"{word}_{j}") for j in range(1, many + 1))

    def _get(self, name: str) -> ScalarLike:
        number: ScalarLike = getattr(self, name)
        return number

    def _parts(self, state: tuple[N, ...]) -> Parts[Any]:
        left = list(state)
        many = (len(self.dynamics.scales()), 1, 1 * (self.made.dynamics == "static"), self._stop_count())
        found = []
        for count in (*many, self.made.creep, self._flags()):
            found.append(tuple(left[:count]))
            del left[:count]
        mechanics, seen, slope, stops, crept, flags = found
        return Parts(mechanics, seen[0], slope[0] if slope else None, stops, crept, flags)

    def _joined(self, x: Parts[Any]) -> tuple[Any, ...]:
        slope = () if x.slope is None else (x.slope,)
        return (*x.mechanics, x.seen, *slope, *x.stops, *x.crept, *x.flags)


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
        "is_compliant": compliant,
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


def _power(x: Any, exponent: int) -> Any:
    """x to a whole power from 0 on, a number or a series; also of numbers that are not positive."""
    product: Any = 1.0
    for _ in range(exponent):
        product = x * product
    return product


__all__ = ["ComposedModel", "composed_class"]
