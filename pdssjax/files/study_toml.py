"""A study: the actuator's models, its parameters and the records to explain, from a TOML file."""

import dataclasses
import functools
import tomllib
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from .amplifier import Amplifier
from .effector import Effector, Stop
from .errors import InputError, nearest
from .estimate import Estimate
from .family import member, members
from .hold import Held, waveform
from .integration import Accuracy
from .parameters import Parameter, read_parameter
from .prediction import Models, Predictor, predicted
from .quantity import Quantity, quantities
from .records import Record, read_record
from .sensor import Sensor
from .simulation import need_double_precision
from .tables import Table, check_range

FORMAT = "pdssjax-study/1"
_STATES = ["deflection", "force"]


@dataclasses.dataclass(frozen=True, eq=False)
class Study:
    """What a study file says, checked; all numbers in SI."""

    title: str
    """As reports call it."""
    path: Path | None
    """The file it comes from."""
    piezo: type
    """Model of stack and platform, a class of the family `pdssjax.piezo`."""
    friction: type
    """Contact law, a class of the family `pdssjax.friction`."""
    friction_state: str
    """Reading of a direction-dependent law, "deflection" or "force"; other laws ignore it."""
    feedback: bool
    """Whether friction acts back on the platform (5.25)."""
    parameters: dict[str, Parameter]
    """Listed parameters by path, in the order of the file."""
    records: tuple[Record, ...]
    """Records in the order of the file."""

    def predict(
        self, values: Mapping[str, Any] | Estimate | None = None, accuracy: Accuracy | None = None
    ) -> list[Float[Array, " samples"]]:
        """What every record measures at its sample times, displacement [m] or force [N], without offsets.

        **Arguments:** `values` maps parameter paths to numbers in SI, or is an estimate, whose
        parameters are taken; what is left out keeps the study's value or start.

        **Returns:** one array of shape (samples,) a record, in the order of the records.
        Differentiable in `values` (`jvp`, `jacfwd`, `grad`); works under `jit` and `vmap`.
        A record whose simulation cannot finish is NaN.

        **Raises:** `InputError` for a path that is no parameter of the study's models, and where
        listed parameters are left with neither value nor start; `initial_guess` finds those.
        """
        return predicted(*self._asked(values, accuracy))

    def lowered(self, values: Mapping[str, Any]) -> Any:
        """`predict`, traced; its `compile` may go on in another thread."""
        return predicted.lower(*self._asked(values, None))  # pyright: ignore[reportFunctionMemberAccess]

    def _asked(self, values: Mapping[str, Any] | Estimate | None, accuracy: Accuracy | None) -> tuple[Any, ...]:
        need_double_precision()
        given = _numbers({} if values is None else values, _legal(self))
        full = {path: jnp.asarray(number, float) for path, number in (self.values(given) | given).items()}
        return self.predictor, full, accuracy or Accuracy()

    def legal(self) -> dict[str, Quantity]:
        """What is declared of every parameter that the study may list, by path."""
        return _legal(self)

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

    def missing(self) -> list[str]:
        """The listed parameters that have neither a value nor a start."""
        return [path for path, parameter in self.parameters.items() if parameter.number is None]

    def with_values(self, values: Mapping[str, float] | Estimate, source: str = "") -> "Study":
        """The study with the parameters in `values` [SI], numbers by path or an estimate, fixed at them.

        **Arguments:** `source` says in words where they come from, for what is written of them.

        **Raises:** `InputError` for a path that is no parameter of the study's models, and for a
        number outside its legal range.
        """
        source = source or ("estimate" if isinstance(values, Estimate) else "given")
        legal = _legal(self)
        parameters = dict(self.parameters)
        for path, number in _numbers(values, legal).items():
            check_range(float(number), legal[path], f'values: "{path}"')
            parameters[path] = Parameter(path, legal[path].unit, legal[path], value=float(number), source=source)
        return dataclasses.replace(self, parameters=parameters)

    @functools.cached_property
    def models(self) -> Models:
        """The chosen family members."""
        parts = {"amplifier"} if any(path.startswith("amplifier.") for path in self.parameters) else set()
        parts |= {"low-pass"} if "sensor.bandwidth" in self.parameters else set()
        return Models(self.piezo, self.friction, self.friction_state, self.feedback, frozenset(parts))

    @functools.cached_property
    def predictor(self) -> Predictor:
        """The prediction of all records, ready to be compiled."""
        return Predictor(self.models, self.records)


def load_study(path: str | Path, virtual: bool = False) -> Study:
    """Reads and checks a study file and the records it names.

    With `virtual` the records are still to be made: those that say their `sampling` need no file.

    **Raises:** `InputError` that names file and key, or file, line and column, if anything
    is missing, unknown or illegal.  Warns with `InputWarning` where the input is legal but
    looks like a mistake.
    """
    path = Path(path)
    top = Table(_read_toml(path), str(path))
    _check_format(top)
    top.only(["format", "title", "actuator", "parameters", "record"])
    actuator = top.table("actuator", 'a table with "piezo" and "friction"')
    actuator.only(["piezo", "friction", "friction_state", "feedback"])
    study = Study(
        title=top.text("title", "a text", path.stem),
        path=path,
        piezo=member("piezo", actuator.option("piezo", members("piezo"))),
        friction=member("friction", actuator.option("friction", members("friction"))),
        friction_state=actuator.option("friction_state", _STATES, _STATES[0]),
        feedback=actuator.get("feedback", bool, "true or false", False),
        parameters={},
        records=_read_records(top, path.parent, virtual),
    )
    study = dataclasses.replace(study, parameters=_read_parameters(top, study))
    _check_durations(top, study)
    _check_jumps(top, study)
    _check_samples(top, study)
    return study


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such file, expected a study file.") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}), expected a study file.") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: found {error.reason} at byte {error.start}, expected UTF-8 text.") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: found no valid TOML: {error}.") from None


def _check_format(top: Table) -> None:
    found = top.text("format", f'"{FORMAT}"')
    if found != FORMAT:
        raise InputError(f'{top.at("format")}: found "{found}", expected "{FORMAT}".')


def _read_records(top: Table, folder: Path, virtual: bool) -> tuple[Record, ...]:
    expected = "one [[record]] table for each record"
    records: list[Record] = []
    for number, entries in enumerate(top.get("record", list, expected, []), start=1):
        if not isinstance(entries, dict):
            raise InputError(f"{top.at('record')}: found {entries}, expected {expected}.")
        name = entries.get("name")
        label = f'record "{name}"' if isinstance(name, str) else f"record {number}"
        record = read_record(Table(entries, f"{top.where}: {label}"), folder, virtual)
        if record.name in [other.name for other in records]:
            raise InputError(f'{top.where}: found two records named "{record.name}", expected different names.')
        records.append(record)
    return tuple(records)


def _numbers(values: Mapping[str, Any] | Estimate, legal: Mapping[str, Quantity]) -> dict[str, Any]:
    """`values` as numbers by path; **raises** `InputError` for a path that is not `legal`."""
    if isinstance(values, Estimate):
        values = {path: parameter.value for path, parameter in values.parameters.items()}
    for path in values:
        if path not in legal:
            raise InputError(f'values: found the unknown parameter "{path}"; {nearest(path, legal)}')
    return dict(values)


def _legal(study: Study) -> dict[str, Quantity]:
    """All parameters that the study may list, by path."""
    models = {
        "piezo": study.piezo,
        "friction": study.friction,
        "effector": Effector,
        "stop": Stop,
        "amplifier": Amplifier,
        "sensor": Sensor,
    }
    legal = {f"{name}.{f}": q for name, model in models.items() for f, q in quantities(model).items()}
    # Also those of waveforms that no record uses: to list them does nothing, and no harm.
    for drive in members("drive"):
        optional = {f: q for f, q in quantities(member("drive", drive)).items() if q.optional}
        legal |= {f"drive.{f}": q for f, q in optional.items()}
    return legal


def _required(study: Study, legal: dict[str, Quantity], listed: Iterable[str]) -> list[str]:
    """The parameters that the study must list."""
    kinds = {record.measures for record in study.records}
    needed = set()
    if study.feedback or not kinds or kinds - {"platform"}:
        needed |= {"friction"}
    if not kinds or kinds - {"friction"}:
        needed |= {"piezo"}
    if study.feedback or not kinds or kinds & {"effector", "force"}:
        needed |= {"effector"}
    if "force" in kinds:
        needed |= {"stop"}
    paths = [path for path, declared in legal.items() if not declared.optional and path.split(".")[0] in needed]
    slews = "amplifier.slew" in listed
    carries = study.feedback and "piezo.mass" in legal
    return paths + ["piezo.mass"] * carries + ["amplifier.bandwidth"] * slews


def _read_parameters(top: Table, study: Study) -> dict[str, Parameter]:
    table = top.table("parameters", "a table of parameters")
    legal = _legal(study)
    for path in table.entries:
        if any(known.startswith(f"{path}.") for known in legal):
            raise InputError(f'{table.where}: found {path} without quotes, expected the whole path as in "{path}....".')
        if path not in legal:
            raise InputError(f'{table.where}: found the unknown parameter "{path}"; {nearest(path, legal)}')
    for path in _required(study, legal, table.entries):
        if path not in table.entries:
            raise InputError(
                f'{table.where}: the parameter "{path}" is missing, '
                f"expected it fixed as in {{ value = ... }} or free as in {{}}."
            )
    expected = "a table such as { start = ... }, { value = ... } or {}"
    return {
        path: read_parameter(path, dataclasses.replace(table.table(path, expected), where=table.at(path)), legal[path])
        for path in table.entries
    }


def _check_durations(top: Table, study: Study) -> None:
    """A duration shared by the drives must fit into the period of each that follows it."""
    for path, parameter in study.parameters.items():
        family, _, field = path.partition(".")
        given = parameter.start if parameter.free else parameter.value
        if family != "drive" or parameter.unit != "s" or given is None:
            continue
        for record in study.records:
            frequency = getattr(waveform(record.drive), "frequency", None)
            follows = hasattr(waveform(record.drive), field) and field not in record.own
            if frequency and follows and given >= 1.0 / frequency:
                raise InputError(
                    f'{top.where}: parameters: key "{path}": found {given:g} s, '
                    f'expected less than the period {1.0 / frequency:g} s of record "{record.name}".'
                )


def _check_jumps(top: Table, study: Study) -> None:
    """A platform that follows the voltage at once can carry no end-effector through a jump, nor feel it."""
    if study.piezo.yields:
        return
    if study.feedback:
        raise InputError(
            f'{top.where}: actuator: key "feedback": found true, expected false: no force moves the platform of '
            "this piezo."
        )
    if any(path.startswith("amplifier.") for path in study.parameters):
        return
    for record in study.records:
        if record.measures in ("effector", "force") and _jumps(record, study.parameters):
            raise InputError(
                f'{top.where}: record "{record.name}": drive: found a voltage that jumps, expected a fall or rise time '
                "above 0 or an amplifier: the platform of this piezo would jump, too, and what the end-effector then "
                "does is not told."
            )


def _jumps(record: Record, parameters: Mapping[str, Parameter]) -> bool:
    """Whether the voltage of a record has jumps."""
    drive = record.drive
    if isinstance(drive, Held):
        return True
    for field in ("fall_time", "rise_time"):
        if hasattr(drive, field):
            shared = parameters.get(f"drive.{field}")
            if shared is None or field in record.own:
                return float(getattr(drive, field)) == 0.0 and getattr(drive, "duty", 1.0) == 1.0
            return not shared.free and shared.value == 0.0
    sets_in = abs(float(drive.at(jnp.zeros(())))) > 0.0
    return sets_in or float(getattr(drive, "interpolation", 1.0)) == 0.0


def _check_samples(top: Table, study: Study) -> None:
    fitted = [record for record in study.records if record.role == "fit"]
    samples = sum(record.time.size for record in fitted)
    parameters = sum(parameter.free for parameter in study.parameters.values())
    offsets = sum(record.offset is None for record in fitted)
    if fitted and samples < parameters + offsets:
        raise InputError(
            f"{top.where}: found {samples} samples to fit, "
            f"expected at least as many as there are unknowns: {parameters} free parameters and {offsets} offsets."
        )
