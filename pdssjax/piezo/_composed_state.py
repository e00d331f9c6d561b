"""The state of a composed stack: its parts by name, and all of them joined in the tuple that is integrated."""

from typing import Any, Generic, NamedTuple, TypeAlias

from ..integration import N, N_co

Entry: TypeAlias = Any
"""An entry of a state, or its rate: a number or a series.  Both go through the same functions, mixed, the flags of a
series being numbers, and a result is of the kind of what it is made of, which no type variable says."""


class Parts(NamedTuple, Generic[N_co]):
    """The state of a composed stack in words."""

    mechanics: tuple[N_co, ...]
    """Of the dynamics."""
    seen: N_co
    """The voltage [V]."""
    slope: N_co | None
    """Its rate [V/s]; None where no velocity hangs on it."""
    stops: tuple[N_co, ...]
    """Of hysteresis: how far the voltage is ahead of each element [V]; of Bouc and Wen's h."""
    crept: tuple[N_co, ...]
    """What each element of creep has added [m]."""
    flags: tuple[N_co, ...]
    """The sign of the voltage's rate; then one a stop, what its law of hysteresis knows of it."""

    @property
    def rises(self) -> Entry:
        """1 where the voltage rises, -1 where it falls; 0 where there is no hysteresis to know it."""
        return self.flags[0] if self.flags else 0.0

    @property
    def marks(self) -> tuple[Entry, ...]:
        """The flags of the stops."""
        return self.flags[1:]


class Layout(NamedTuple):
    """How many numbers each part of the state has."""

    mechanics: int
    slope: int
    stops: int
    crept: int

    @property
    def flags(self) -> int:
        """None without hysteresis."""
        return 1 + self.stops if self.stops else 0

    def split(self, state: tuple[N, ...]) -> Parts[Entry]:
        """The parts of a state."""
        left = list(state)
        found = []
        for count in (self.mechanics, 1, self.slope, self.stops, self.crept, self.flags):
            found.append(tuple(left[:count]))
            del left[:count]
        mechanics, seen, slope, stops, crept, flags = found
        return Parts(mechanics, seen[0], slope[0] if slope else None, stops, crept, flags)


def joined(x: Parts[Entry]) -> tuple[Entry, ...]:
    """The state that has these parts."""
    slope = () if x.slope is None else (x.slope,)
    return (*x.mechanics, x.seen, *slope, *x.stops, *x.crept, *x.flags)
