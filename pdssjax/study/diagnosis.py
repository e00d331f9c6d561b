"""What an identification found out about its data: plain values, for the report and the files."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Combination:
    """A product of powers of parameters that the data determine independently of every other combination."""

    exponents: dict[str, float]
    """By path, the largest 1; those too small to matter are left out."""
    relative_error: float
    """Standard error of the logarithm of the product."""


@dataclass(frozen=True)
class Remedy:
    """What would help most: one parameter known from elsewhere."""

    path: str
    """The parameter that would have to be known."""
    errors: dict[str, tuple[float, float]]
    """Relative standard errors of those parameters that gain from it, as they are and as they would be."""


@dataclass(frozen=True)
class Agreement:
    """What a group of records does to the estimate, to first order."""

    records: tuple[str, ...]
    """Their names."""
    what: str
    """What they have in common: "record", "direction", "kind"."""
    sigmas: float
    """How far they disagree with the other records, as a normal deviate; above 4 it is no chance."""
    shifts: dict[str, float]
    """By path, what leaving them out would change in a parameter of a joint fit, in the standard errors of this one;
    NaN where only these records determine it."""

    def largest(self) -> tuple[str, float]:
        """The parameter that leaving these records out would move most, and its shift; ("", 0.0) where none is."""
        known = {path: shift for path, shift in self.shifts.items() if shift == shift}
        path = max(known, key=lambda name: abs(known[name]), default="")
        return path, known.get(path, 0.0)


@dataclass(frozen=True)
class Diagnosis:
    """What the data determine, and whether they agree."""

    combinations: tuple[Combination, ...]
    """Of the free parameters, the worst determined first."""
    remedy: Remedy | None
    """None where no single parameter would help much."""
    agreement: tuple[Agreement, ...]
    """Of every record fitted, and of records that have their direction or kind in common; empty for a single record."""
