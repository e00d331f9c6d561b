"""A study: the actuator's models, its parameters and the records to explain.

Of its numbers by path `Models` makes the actuator, and the `Predictor` the samples of every record.
"""

import dataclasses
import functools
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import NotRequired, TypedDict

import numpy as np
from jaxtyping import Array, Float

from ..core import (
    Figure,
    InputError,
    Quantity,
    ScalarLike,
    check_kind,
    check_range,
    member,
    member_name,
    members,
    nearest,
    presenter,
    quantities,
    require_float64,
)
from ..friction.base import AbstractFriction
from ..integration import Accuracy, accuracy_with
from ..piezo.base import AbstractPiezo
from .constraint import Constraint, bounded_by_constraints
from .estimate import Estimate
from .models import Models, Values, parts_told_by
from .parameter import Parameter, paths_in, split_path
from .parameter_use import check_numbers, check_read, check_whole_parts
from .prediction import Predictor, predicted
from .record import Record


@dataclasses.dataclass(frozen=True, eq=False)
class Study:
    """A study: the content of a study file, checked; all numbers in SI."""

    title: str
    """Title of the study in reports."""
    path: Path | None
    """The file it comes from."""
    piezo: type[AbstractPiezo]
    """Model of stack and platform, a class of the family `pdssjax.piezo`."""
    friction: type[AbstractFriction]
    """Contact law, a class of the family `pdssjax.friction`."""
    friction_state: str
    """Reading of a direction-dependent law, "deflection" or "force"; other laws ignore it."""
    feedback: bool
    """Whether friction acts back on the platform (5.25)."""
    parameters: dict[str, Parameter]
    """Listed parameters by path, in the order of the file."""
    records: tuple[Record, ...]
    """Records in the order of the file."""
    rests_under_load: bool = False
    """Whether load and tilt acted before t = 0, and motion is counted from rest under them; else they set in then."""
    solver: str = "taylor"
    """Name of the integrator of its simulations, one of `pdssjax.integration.SOLVERS`."""
    constraints: tuple[Constraint, ...] = ()
    """Inequalities between its parameters, which a fit keeps."""

    @property
    def accuracy(self) -> Accuracy:
        """How finely its simulations are integrated, and by which solver, where nothing else is asked for."""
        return accuracy_with(self.solver)

    def __repr__(self) -> str:
        free = sum(parameter.free for parameter in self.parameters.values())
        models = f"{member_name(self.piezo)}, {member_name(self.friction)}"
        parameters = f"{free} free of {len(self.parameters)} parameters"
        return f"Study({self.title!r}, {models}, {parameters}, {len(self.records)} records)"

    def _repr_html_(self) -> str:
        return presenter().as_html(self)

    def plot(self) -> Figure:
        """A figure of matplotlib: what was measured, one record a row, its liveliest moment enlarged."""
        return presenter().as_figure(self)

    def predict(
        self, values: Values | Estimate | None = None, accuracy: Accuracy | None = None
    ) -> list[Float[Array, " samples"]]:
        """What every record measures at its sample times, in SI, without offsets.

        **Arguments:** `values` maps parameter paths to numbers in SI, or is an estimate, whose
        parameters are taken; what is left out keeps the study's value or start.

        **Returns:** one array of shape (samples,) a record, in the order of the records.
        Differentiable in `values` (`jvp`, `jacfwd`, `grad`); works under `jit` and `vmap`.
        A record whose simulation cannot finish is NaN.

        An amplifier, or the sensor's low-pass, that the study has not is added where `values` tell
        its parameters.

        **Raises:** `InputError` for a path that is no parameter of the study's models, or that the
        study does not list and no record depends on; for a number outside its legal range, as far as
        it is known (under `jit`, `vmap` and derivatives it is not); and where listed parameters are
        left with neither value nor start; `initial_guess` finds those.  It is compiled once for all values.
        """
        require_float64("predict")
        accuracy = accuracy or self.accuracy
        check_kind("accuracy", accuracy, Accuracy)
        given = self._numbers({} if values is None else values)
        return predicted(self._predictor_of(self.models_with(given)), self.values(given) | given, accuracy)

    def legal(self) -> dict[str, Quantity]:
        """The declared quantities of every parameter that the study may list, by path."""
        legal = self.models.declared()
        # Also those of waveforms that no record uses: to list them does nothing, and no harm.
        for drive in members("drive"):
            # But the frequency: how many cycles a record holds is known before a fit.
            numbers = quantities(member("drive", drive))
            legal |= {f"drive.{f}": q for f, q in numbers.items() if f != "frequency"}
        return legal | {path: legal[split_path(path)[0]] for path in self.parameters}

    def values(self, but: Collection[str] = ()) -> dict[str, float]:
        """The number [SI] of every listed parameter `but` those: its value or its start.

        **Raises:** `InputError` that names all that have neither, and says what gives them.
        """
        if missing := [path for path in self.missing() if path not in but]:
            raise InputError(
                f"{self.path or self.title}: parameters: found no number for {', '.join(missing)}; expected "
                "{ value = ... } or { start = ... } in the study, an estimate (--estimate FILE, or predict(estimate)), "
                "or a guess from the records (--guess, or pdssjax.initial_guess(study))."
            )
        known = {path: parameter.number for path, parameter in self.parameters.items() if path not in but}
        return {path: number for path, number in known.items() if number is not None}

    @property
    def bounded_parameters(self) -> dict[str, Parameter]:
        """The parameters, with bounds for free ones that a constraint ties to a fixed one."""
        return bounded_by_constraints(self.parameters, self.constraints, str(self.path or self.title))

    def missing(self) -> list[str]:
        """The listed parameters that have neither a value nor a start."""
        return [path for path, parameter in self.parameters.items() if parameter.number is None]

    def with_values(
        self, values: Mapping[str, float] | Estimate, source: str = "", *, of_estimate: bool = False
    ) -> "Study":
        """The study with the parameters in `values` [SI], numbers by path or an estimate, fixed at them.

        **Arguments:** `source` says in words where they come from, for what is written of them; `of_estimate` that
        the numbers are all those of an estimate.

        **Raises:** `InputError` for a path that is no parameter of the study's models, or that the study does not list
        and no record depends on, unless it comes with an estimate; and for a number outside its legal range.
        """
        source = source or ("estimate" if isinstance(values, Estimate) else "given")
        legal = self.legal()
        parameters = dict(self.parameters)
        for path, number in self._numbers(values, of_estimate).items():
            parameters[path] = Parameter(path, legal[path].unit, legal[path], value=float(number), source=source)
        return dataclasses.replace(self, parameters=parameters)

    def _numbers(
        self, values: Values | Estimate, of_estimate: bool = False
    ) -> dict[str, ScalarLike | Float[np.ndarray, ""]]:
        """`values` as numbers by path, checked; **raises** `InputError` where they are not this study's.

        An estimate tells all of an actuator, and a study takes of it what its records depend on; a path that is named
        otherwise has to have an effect.
        """
        if isinstance(values, Estimate):
            of_estimate = True
            self.models.check_same(values.actuator, "values")
            values = {path: parameter.value for path, parameter in values.parameters.items()}
        check_kind("values", values, Mapping)
        legal = self.legal()
        for path in values:
            if path not in legal:
                raise InputError(f'values: found the unknown parameter "{path}"; {nearest(path, legal)}')
        if not of_estimate:
            check_read([path for path in values if path not in self.parameters], self.models, self.records, "values")
        check_whole_parts(values.keys(), self.parameters, "values")
        check_numbers(values, legal, self.records, "values")
        return dict(values)

    def with_starts(self, starts: Mapping[str, float | None] | Estimate, source: str = "") -> "Study":
        """The study with its free parameters among `starts` [SI], by path, starting there; None: looked for anew.

        What is fixed, or was measured apart and starts there, stays as it is, and so does what an estimate tells of
        parameters that the study does not list; a start beyond the study's bounds is moved to the bound.

        **Arguments:** `starts` are numbers by path, or an estimate; `source` says in words where they come from.

        **Raises:** `InputError` for a path that the study does not list, for a number outside its legal range, and for
        an estimate of another actuator.
        """
        if isinstance(starts, Estimate):
            numbers = {path: float(n) for path, n in self._numbers(starts).items() if path in self.parameters}
            source, starts = source or "estimate", numbers
        for path in starts:
            if path not in self.parameters:
                raise InputError(
                    f'starts: found "{path}", which the study does not list in [parameters]: nothing would start '
                    f"there; {nearest(path, self.parameters)}"
                )
        parameters = dict(self.parameters)
        for path, start in starts.items():
            if path in parameters and parameters[path].free and parameters[path].standard_error is None:
                if start is not None:
                    check_range(float(start), parameters[path].quantity, f'starts: "{path}"')
                parameters[path] = parameters[path].with_start(start, source)
        return dataclasses.replace(self, parameters=parameters)

    def for_record(self, record: Record) -> "Study":
        """The study with those parameters that hold in a `record`, by paths without a condition, and no others."""
        held = {}
        for base, path in paths_in(self.parameters, record.conditions).items():
            parameter = dataclasses.replace(self.parameters[path], path=base)
            if parameter.number is None and base in self.parameters:
                # Without a start of its own it starts where the usual one does.
                parameter = dataclasses.replace(parameter, start=self.parameters[base].number)
            held[base] = parameter
        return dataclasses.replace(self, parameters=held)

    @functools.cached_property
    def models(self) -> Models:
        """The chosen family members."""
        chosen = self.piezo, self.friction, self.friction_state, self.feedback
        return Models(*chosen, parts_told_by(self.parameters), self.rests_under_load)

    def models_with(self, paths: Collection[str]) -> Models:
        """The models with the parts of a rig that parameters of these `paths` tell: amplifier, low-pass."""
        return dataclasses.replace(self.models, parts=self.models.parts | parts_told_by(paths))

    @functools.cached_property
    def predictor(self) -> Predictor:
        """The prediction of all records, ready to be compiled."""
        return self._predictor_of(self.models)

    def _predictor_of(self, models: Models) -> Predictor:
        """The prediction of all records by `models`, this study's with more parts, perhaps."""
        if models.parts not in self._predictors:
            self._predictors[models.parts] = Predictor(models, self.records)
        return self._predictors[models.parts]

    @functools.cached_property
    def _predictors(self) -> dict[frozenset[str], Predictor]:
        """The predictors made so far, by the parts of the rig."""
        return {}


class UsedNumber(TypedDict):
    """The number of a parameter, as plain data."""

    value: float
    """In SI."""
    unit: str
    source: str
    """Where it comes from, in words."""
    standard_error: NotRequired[float]
    """In SI; where the points of a sweep scatter about the value."""


def numbers_used(study: Study, but: Collection[str] = ()) -> dict[str, UsedNumber]:
    """The number of every listed parameter by its path, `but` for some.

    **Raises:** `InputError` for parameters without a number.
    """
    parameters = study.parameters
    return {
        path: {"value": number, "unit": parameters[path].unit, "source": parameters[path].origin}
        for path, number in study.values(but).items()
    }
