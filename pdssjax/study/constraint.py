"""Constraints between two parameters of a study: greater >= factor * lesser, such as a static and a Coulomb force.

A fixed partner makes a constraint a bound of the other (`bounded_by_constraints`).  Two that are free are fitted by one
of them and by the distance between them on the fit's scale, which has a bound at 0 (`chained`).  So a constraint is a
bound like any other.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..core import InputError
from .parameter import Parameter


@dataclasses.dataclass(frozen=True)
class Constraint:
    """greater >= factor * lesser."""

    name: str
    """Its key in [constraints]."""
    greater: str
    """Path of a parameter."""
    lesser: str
    """Path of a parameter of the same unit."""
    factor: float = 1.0
    """Positive."""

    @property
    def text(self) -> str:
        """The inequality as a study writes it."""
        return f"{self.greater} >= {f'{self.factor:g} * ' if self.factor != 1.0 else ''}{self.lesser}"

    def holds(self, greater: float, lesser: float) -> bool:
        """Whether two numbers [SI] keep it."""
        return greater >= self.factor * lesser

    def between(self, paths: Mapping[str, object]) -> bool:
        """Whether both parameters are among the `paths`."""
        return self.greater in paths and self.lesser in paths


class Link(NamedTuple):
    """How a fit takes one of two free parameters that a constraint links."""

    child: str
    """Path of the parameter whose number in the fit is the distance from the other."""
    parent: str
    constraint: Constraint

    @property
    def is_upper(self) -> bool:
        """The constraint bounds the child from above."""
        return self.child == self.constraint.lesser

    @property
    def factor(self) -> float:
        """Child over parent where the constraint is an equality."""
        return 1.0 / self.constraint.factor if self.is_upper else self.constraint.factor


def bounded_by_constraints(
    parameters: Mapping[str, Parameter], constraints: Sequence[Constraint], where: str
) -> dict[str, Parameter]:
    """The `parameters`, free ones bounded by what constraints with fixed ones make of them.

    **Raises:** `InputError` that names the file (`where`) and the key of a constraint that two fixed parameters break,
    or that leaves a free one no room between its bounds.
    """
    found = dict(parameters)
    for constraint in constraints:
        greater, lesser = found[constraint.greater], found[constraint.lesser]
        at = f'{where}: constraints: key "{constraint.name}": found {constraint.text}, but'
        if greater.value is not None and lesser.value is not None:
            if not constraint.holds(greater.value, lesser.value):
                numbers = (
                    f"{greater.path} fixed at {greater.value:g} and {lesser.path} at {lesser.value:g} {lesser.unit}"
                )
                raise InputError(f"{at} {numbers.rstrip()}, expected numbers that keep it.")
            continue
        if greater.value is not None:
            most = greater.value / constraint.factor
            bounded = dataclasses.replace(lesser, high=min(most, np.inf if lesser.high is None else lesser.high))
        elif lesser.value is not None:
            least = lesser.value * constraint.factor
            bounded = dataclasses.replace(greater, low=max(least, -np.inf if greater.low is None else greater.low))
        else:
            continue
        low, high = bounded.bounds()
        if not low < high:
            raise InputError(f"{at} that leaves {bounded.path} no room between {low:g} and {high:g} {bounded.unit}.")
        found[bounded.path] = bounded
    return found


def chained(parameters: Mapping[str, Parameter], constraints: Sequence[Constraint], where: str) -> tuple[Link, ...]:
    """The constraints between free parameters as links, each parent before its children.

    A child has no bounds of its own beyond those that follow from its parent's.

    **Arguments:** `parameters` as `bounded_by_constraints` leaves them.

    **Raises:** `InputError` that names the file (`where`) and the key of a constraint that closes a loop, that links a
    positive parameter to one that need not be, or where several parameters that are linked have bounds of their own.
    """
    left = [c for c in constraints if parameters[c.greater].free and parameters[c.lesser].free]
    links: list[Link] = []
    for c in left:
        if parameters[c.greater].quantity.positive != parameters[c.lesser].quantity.positive:
            raise InputError(
                f'{where}: constraints: key "{c.name}": found {c.text}, of which one may be negative or zero, expected '
                "two that are positive, or two that need not be; fix one, or give the other a min or max."
            )
    while left:
        together = _linked(left[0], left)
        left = [constraint for constraint in left if constraint not in together]
        paths = dict.fromkeys(path for c in together for path in (c.lesser, c.greater))
        if len(paths) <= len(together):
            named = ", ".join(c.text for c in together)
            raise InputError(
                f'{where}: constraints: key "{together[-1].name}": found a loop ({named}), expected each parameter to '
                "be led to from another by one way only; leave out what follows from the others."
            )
        # A stack that is fitted first is not moved by what is fitted after it.
        roots = sorted(paths, key=lambda path: not path.startswith("piezo."))
        trees = [_tree(root, together) for root in roots]
        tree = next((tree for tree in trees if all(_bounds_follow(link, parameters) for link in tree)), None)
        if tree is None:
            raise InputError(
                f'{where}: constraints: key "{together[0].name}": found bounds of both {together[0].greater} and '
                f"{together[0].lesser}, expected min and max of one of them only: beside a constraint the other has "
                "no bounds of its own."
            )
        links += tree
    return tuple(links)


def _linked(first: Constraint, constraints: Sequence[Constraint]) -> list[Constraint]:
    """The constraints that link parameters to those of the `first` one, with that."""
    paths, count = {first.greater, first.lesser}, 0
    while len(paths) > count:
        count = len(paths)
        for c in constraints:
            if {c.greater, c.lesser} & paths:
                paths |= {c.greater, c.lesser}
    return [c for c in constraints if c.greater in paths]


def _tree(root: str, constraints: Sequence[Constraint]) -> list[Link]:
    """The links from a `root` outwards."""
    links, reached = list[Link](), [root]
    for parent in reached:  # grows on the way
        for c in constraints:
            child = c.lesser if c.greater == parent else c.greater if c.lesser == parent else None
            if child is not None and child not in reached:
                reached.append(child)
                links.append(Link(child, parent, c))
    return links


def _bounds_follow(link: Link, parameters: Mapping[str, Parameter]) -> bool:
    """Whether a child keeps its own bounds wherever its parent keeps its, and the constraint is kept."""
    (low, high), (least, most) = parameters[link.child].bounds(), parameters[link.parent].bounds()
    unbounded = low == -np.inf or (low == 0.0 and parameters[link.child].quantity.positive)
    if link.is_upper:
        return unbounded and high >= link.factor * most
    return high == np.inf and (unbounded or low <= link.factor * least)
