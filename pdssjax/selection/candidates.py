"""Candidate models of a study's records: its own, and those that differ by a member or a reading.

Models are ordered by the number of their free parameters.  Each begins where its neighbour ended: the simpler model
that shares the most parameters with it.  What two laws share by name and meaning is the same quantity in both, and
what they only call by different names is listed in `_MEANS_THE_SAME`.
"""

import dataclasses
import itertools
from collections.abc import Iterable, Mapping, Sequence

from ..core import InputError, member, member_name, members, nearest
from ..study import MARK, Constraint, Models, Parameter, Study, split_path

ALL = "all"
"""In place of names: every member of the family that has a name of its own."""

_MEANS_THE_SAME = {
    "friction.f_ss": ("friction.f_c",),
    "friction.f_c": ("friction.f_ss",),
    "friction.f_s": ("friction.f_ss", "friction.f_c"),
}
"""By path, the paths under which another law has the force at which the contact slides, or begins to.  Where a law
tells the force of steady sliding from the static one, the latter begins at the same number."""

_STATIC = Constraint("static_force", "friction.f_s", "friction.f_c")
"""A fit that no one looks after may end at friction that grows with the velocity, where nothing can be predicted."""

_STATES = "deflection", "force"
"""Readings of a direction-dependent law, as a study names them."""

_DIRECTIONS = "_a", "_b"
"""How the paths of a law end that has a parameter for each direction; a law without directions has it once."""


@dataclasses.dataclass(frozen=True)
class Candidate:
    """A model that may explain the records."""

    name: str
    """The members and readings in which the candidates differ, such as "lugre" or "static, lugre"."""
    study: Study
    """The study under this model; parameters that only this model has are free and have no start."""
    refused: str = ""
    """Why the study cannot be posed under this model; "" where it can."""
    is_own: bool = False
    """Whether it is the model of the study itself."""

    @property
    def free(self) -> tuple[str, ...]:
        """The paths of the free parameters."""
        return tuple(path for path, parameter in self.study.parameters.items() if parameter.free)

    @property
    def folder(self) -> str:
        """The name of the folder of its results."""
        return self.name.replace(", ", "_").replace(":", "-")


def candidates_of(
    study: Study,
    friction: Iterable[str] | None = None,
    piezo: Iterable[str] | None = None,
    feedback: Iterable[bool] | None = None,
) -> tuple[Candidate, ...]:
    """The study's own model and every other one that the choices make, the fewest free parameters first.

    **Arguments:**

    - `friction`: names of laws; "all" for every one, which is what None means if nothing else is asked for.
      "anisotropic-lugre:force" is a law with that reading of its state.
    - `piezo`: names of models of stack and platform; None: the study's own.
    - `feedback`: whether friction acts back on the platform; None: as in the study.

    **Raises:** `InputError` for a name that is none, or where there is nothing to compare.
    """
    if friction is None and piezo is None and feedback is None:
        friction = [ALL]
    law, others = member_name(study.friction), _readings(study.friction)[1:]
    law += f":{study.friction_state}" if study.friction_state in others else ""
    own = (member_name(study.piezo), law, study.feedback)
    laws = _checked_names(friction, "friction", own[1])
    stacks = _checked_names(piezo, "piezo", own[0])
    readings = [own[2], *(bool(reading) for reading in feedback or ())]
    chosen = dict.fromkeys(itertools.product(stacks, laws, readings))
    if len(chosen) < 2:
        raise InputError(
            f"{study.path or study.title}: found one model to compare ({_label(own, (True, True, True))}), expected "
            "another friction law, piezo or reading of the feedback beside the study's own."
        )
    differs = tuple(len({choice[part] for choice in chosen}) > 1 for part in range(3))
    found = [_candidate(study, *choice, _label(choice, differs)) for choice in chosen]
    return tuple(sorted(found, key=lambda candidate: (len(candidate.free), candidate.name)))


def _readings(law: type) -> tuple[str, ...]:
    """The readings of a law, as `friction_state` of a study names them; none where it has one reading only."""
    return _STATES if hasattr(law, "state") else ()


def _checked_names(given: Iterable[str] | None, family: str, own: str) -> list[str]:
    """The names that are `given`, checked, the study's `own` first."""
    if isinstance(given, str):
        raise InputError(f'{family}: found the text "{given}", expected a list of names such as ["{own}"].')
    names = [own]
    for name in given or ():
        if name == ALL:
            names += [n for n in members(family) if n != "composed"]
            continue
        _check_name(family, name)
        names.append(name)
    return list(dict.fromkeys(names))


def _check_name(family: str, name: object) -> None:
    """**Raises** `InputError` where a `name` is no member of its `family`, or no reading or variant of one."""
    base, mark, variant = str(name).partition(":")
    if not isinstance(name, str) or base not in members(family):
        raise InputError(f'{family}: found the unknown name "{name}"; {nearest(base, members(family))}')
    if not mark:
        return
    if family == "friction":
        if variant not in (readings := _readings(member(family, base))):
            expected = nearest(variant, readings) if readings else f"{base} has one reading, without a colon."
            raise InputError(f'{family}: found the reading "{variant}" of {base}; {expected}')
    elif not hasattr(member(family, base), "variant"):
        raise InputError(f'{family}: found "{name}", expected "{base}" without a colon: it has no variants.')
    else:
        try:
            member(family, name)
        except (KeyError, ValueError, TypeError) as error:
            raise InputError(
                f'{family}: found "{name}", expected a variant such as "composed:static+play-8".'
            ) from error


def _label(choice: tuple[str, str, bool], parts: Sequence[bool]) -> str:
    stack, law, feedback = choice
    words = stack, law, "feedback" if feedback else "no feedback"
    return ", ".join(word for word, part in zip(words, parts, strict=True) if part) or law


def _candidate(study: Study, stack: str, law: str, feedback: bool, name: str) -> Candidate:
    """The study under another model; where it cannot be posed so, with the reason."""
    base, _, state = law.partition(":")
    own_law, own_stack = member_name(study.friction), member_name(study.piezo)
    friction = study.friction if base == own_law else member("friction", base)
    piezo = study.piezo if stack == own_stack else member("piezo", stack)
    readings = _readings(friction)
    if not state:
        state = study.friction_state if base == own_law or not readings else readings[0]
    changed = dataclasses.replace(study, piezo=piezo, friction=friction, friction_state=state, feedback=feedback)
    if piezo is study.piezo and friction is study.friction and feedback == study.feedback:
        return Candidate(name, changed, is_own=True)
    parameters, lost = _parameters(study, changed.models)
    refused = ""
    if lost:
        refused = (
            f"found {', '.join(lost)} under a condition, which this model has no counterpart of; expected a model "
            "with that parameter, or records of one condition"
        )
    elif feedback and not piezo.is_compliant:
        refused = f"found the feedback of friction on {stack}, which no force moves; expected it without feedback"
    constraints = tuple(constraint for constraint in study.constraints if constraint.between(parameters))
    if friction is not study.friction and _STATIC.between(parameters):
        stated = any(c.between({_STATIC.greater: 0, _STATIC.lesser: 0}) for c in constraints)
        constraints += () if stated else (_STATIC,)
    return Candidate(name, dataclasses.replace(changed, parameters=parameters, constraints=constraints), refused)


def _parameters(study: Study, models: Models) -> tuple[dict[str, Parameter], list[str]]:
    """The parameters of the study under other `models`, and those with a condition that these have not.

    What both models declare stays as the study has it; what only the new one needs, since the study lists others of the
    same part, is free and without a start.
    """
    declared, own = models.declared(), study.models.declared()
    kept = {
        path: parameter
        for path, parameter in study.parameters.items()
        if split_path(path)[0] in declared or split_path(path)[0] not in own
    }
    lost = [path for path in study.parameters if MARK in path and path not in kept]
    families = {path.partition(".")[0] for path in study.parameters} & {"piezo", "friction"}
    added = {
        path: Parameter(path, quantity.unit, quantity)
        for path, quantity in declared.items()
        if path not in kept
        and (models.feedback if path == "piezo.mass" else path.partition(".")[0] in families and not quantity.optional)
    }
    return kept | added, lost


def neighbours(candidates: Sequence[Candidate]) -> dict[str, str | None]:
    """For each candidate the name of the simpler one from whose optimum it begins; None for those without.

    It is the one that shares the most free parameters, by name or by meaning; among equals the simplest.
    """
    out: dict[str, str | None] = {}
    possible = [candidate for candidate in candidates if not candidate.refused]
    for place, candidate in enumerate(possible):
        shared = {other.name: _count_shared(candidate, other) for other in possible[:place]}
        most = max(shared.values(), default=0)
        out[candidate.name] = next(name for name, count in shared.items() if count == most) if most else None
    return out


def _count_shared(candidate: Candidate, other: Candidate) -> int:
    """How many of a candidate's free parameters begin where those of the `other` end; a shared model counts, too."""
    mine, theirs = candidate.study, other.study
    same = sum((mine.piezo is theirs.piezo, mine.friction is theirs.friction, mine.feedback == theirs.feedback))
    known = dict.fromkeys(other.free, 1.0)
    found = sum(_number_of(path, known) is not None for path in candidate.free)
    return 10 * found + same if found else 0


def starting_near(candidate: Candidate, values: Mapping[str, float]) -> Study:
    """The candidate's study, its free parameters starting at the neighbour's `values` [SI] where these have them.

    A start beyond a bound is moved to it; what was measured apart stays.
    """
    starts = {}
    for path in candidate.free:
        number, quantity = _number_of(path, values), candidate.study.parameters[path].quantity
        if number is not None and quantity.low <= number < quantity.high and (number > 0.0 or not quantity.positive):
            starts[path] = number
    return candidate.study.with_starts(starts, "optimum of a simpler model")


def _number_of(path: str, values: Mapping[str, float]) -> float | None:
    """The number among `values` that a parameter begins at: its own, or that of the same meaning; None: there is none.

    A parameter of one direction takes that of a law without directions, and this the geometric mean of both.
    """
    base, condition = split_path(path)
    plain = next((base.removesuffix(end) for end in _DIRECTIONS if base.endswith(end)), base)
    # Its own path first, then those under which other laws have this parameter.
    for name in dict.fromkeys([base, plain, *_MEANS_THE_SAME.get(plain, ())]):
        for wanted in dict.fromkeys((f"{name}{MARK}{condition}" if condition else name, name)):
            if wanted in values:
                return float(values[wanted])
            both = [float(values.get(f"{wanted}{end}", 0.0)) for end in _DIRECTIONS]
            if min(both) > 0.0:
                return (both[0] * both[1]) ** 0.5
    return None
