"""The interface of every measurement.

Columns, what of the rig moves, how it is predicted, what it tells before any fit, and how it is
shown.  A record's `measures` names a member, which is found by its file.
"""

import abc
from collections.abc import Mapping
from typing import ClassVar, NamedTuple, Protocol

import numpy as np
from jaxtyping import Float

from ...core import LENGTH, VELOCITY, AbstractModel, Display, choices
from ..models import Models
from ..setups import AbstractSetup


class Samples(NamedTuple):
    """A record as a first guess looks at it; arrays of shape (samples,)."""

    time: Float[np.ndarray, " samples"]
    """[s]; the drive starts at 0."""
    measured: Float[np.ndarray, " samples"]
    """In the unit of the measurement."""
    voltage: Float[np.ndarray, " samples"]
    """Voltage on the piezo [V]; 0 without a drive."""
    offset: float | None
    """Zero of the sensor, in the unit of the measurement; None where unknown."""


class MeasuredRecord(Protocol):
    """What a measurement looks at in a record."""

    @property
    def has_clock(self) -> bool:
        """Whether the samples have times of their own."""
        ...

    @property
    def motion(self) -> Float[np.ndarray, " samples"] | None:
        """What is prescribed [m], or [m/s] of a velocity."""
        ...


class AbstractMeasurement(AbstractModel):
    """A kind of measurement; its fields are the further keys of a record of it.

    A field is declared with `choice`: then the study's words become numbers, and records that
    differ in it alone may share one compiled function.
    """

    columns: ClassVar[Mapping[str, str]]
    """By quantity, the SI unit of each column: "time" first, what is explained last.

    In between may be what is prescribed: "motion", the relative displacement, or "velocity", a relative one.
    """
    display: ClassVar[Display]
    """How reports and plots show what is explained."""
    needs_clock: ClassVar[bool] = True
    """False: samples without times are read, too, and stand for one a second; `refused` then says where that is wrong.
    """
    plan: ClassVar[Mapping[str, str]] = {}
    """Numbers that a planned record's `sampling` has besides start, end and interval, with their SI units."""

    @abc.abstractmethod
    def parts(self) -> frozenset[str]:
        """The parts of the study that move in a record, whatever the feedback: of `MOVING`."""

    @abc.abstractmethod
    def setup(self, models: Models) -> AbstractSetup:
        """How a record of it is predicted; records with like setups share one compiled function."""

    @property
    def name(self) -> str:
        """Name of the measurement in a study: that of the member's file."""
        return type(self).__module__.rpartition(".")[2].replace("_", "-")

    @property
    def words(self) -> dict[str, str]:
        """What its fields are set to, in the study's words, such as "platform" for `of`."""
        options = choices(type(self))
        return {field: next(w for w in words if words[w] == getattr(self, field)) for field, words in options.items()}

    @property
    def quantity(self) -> str:
        """The column that is explained."""
        return list(self.columns)[-1]

    @property
    def prescribed(self) -> str | None:
        """The column of the relative motion that is prescribed; None where a voltage drives the platform."""
        return next(iter(list(self.columns)[1:-1]), None)

    @property
    def prescribed_display(self) -> Display:
        """How reports and plots show what is prescribed."""
        return VELOCITY if self.prescribed == "velocity" else LENGTH._replace(quantity="motion")

    @property
    def unit(self) -> str:
        """SI unit of what is explained."""
        return self.columns[self.quantity]

    @property
    def driven(self) -> bool:
        """A voltage drives the platform; else a motion is prescribed."""
        return "piezo" in self.parts()

    @property
    def platform_alone(self) -> bool:
        """Only what drives the platform matters, but for friction that acts back on it."""
        return self.driven and not self.effector_moves

    @property
    def effector_moves(self) -> bool:
        """The motion of the end-effector matters."""
        return "effector" in self.parts()

    @property
    def blocked(self) -> bool:
        """The end-effector runs against a stop."""
        return "stop" in self.parts()

    @property
    def effector_free(self) -> bool:
        """The end-effector moves, and freely."""
        return self.effector_moves and not self.blocked

    def at_a_jump(self) -> str:
        """What is wrong where the platform jumps, as a clause such as "it has no velocity there"; "" for nothing."""
        return "what the end-effector then does is not told" if self.effector_moves else ""

    def at_a_corner(self) -> str:
        """What is wrong where the velocity of the platform jumps, as a clause; "", the default, for nothing."""
        return ""

    def refused(self, models: Models, fixed: Mapping[str, float], record: MeasuredRecord) -> str:
        """What is wrong with a `record` under these `models`: "found ..., expected ..."; "", the default, for nothing.

        **Arguments:** `fixed` are the numbers of the parameters that are not fitted, by path [SI].
        """
        return ""

    def planned(
        self, time: Float[np.ndarray, " samples"], numbers: Mapping[str, float]
    ) -> dict[str, Float[np.ndarray, " samples"]]:
        """The columns between the first and the last of a record still to be made, at `time` [s] from its first sample.

        **Arguments:** `numbers` are those of `plan` [SI].
        """
        return {}

    def displacement(self, samples: Samples) -> Float[np.ndarray, " samples"] | None:
        """The displacement [m] of what is seen, up to a constant, as far as it can be told before any fit."""
        return None

    def force(self, samples: Samples) -> Float[np.ndarray, " samples"] | None:
        """The force [N] on the stop or of the contact, up to a constant, as far as it can be told before any fit."""
        return None


class AbstractContactMeasurement(AbstractMeasurement):
    """The friction force of the contact alone under a prescribed motion, as a tribometer measures it."""

    display: ClassVar = Display("force", "forces", "N", 1.0)
    needs_clock: ClassVar = False
    plan: ClassVar = {"amplitude": "m", "frequency": "Hz"}

    def parts(self) -> frozenset[str]:
        return frozenset({"friction"})

    def force(self, samples: Samples) -> Float[np.ndarray, " samples"] | None:
        return samples.measured


MOVING = frozenset({"piezo", "friction", "effector", "stop"})
"""The parts of a study that may move in a record."""
