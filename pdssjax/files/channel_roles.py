"""Which channel of a file is the time, which the voltage, and which the motion: by options, names, units, shapes.

Where a role is not certain, an error lists the channels and names the option that sets it.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ..core import InputError
from ..metrics import detect_waveform
from .channel_samples import Clock, find_channel, name_or_number, open_file, read_samples
from .readers.base import AbstractSource, Channel
from .record_columns import Layout, scaled

SI = {"time": "s", "voltage": "V", "displacement": "m", "velocity": "m/s", "force": "N"}
"""The quantities of a record, with their SI units."""

_NAMES = {
    "time": ("time", "zeit", "t_"),
    "voltage": ("voltage", "volt", "spannung", "u_", "drive", "piezo"),
    "displacement": ("displacement", "position", "weg", "x_", "motion"),
    "velocity": ("velocity", "speed", "geschwindigkeit", "v_"),
    "force": ("friction", "reib", "force", "kraft", "f_", "ff", "tangential"),
}
"""Beginnings of names, which are preferred among channels of the same unit, or of none."""

_SYMBOLS = {"time": ("t",), "voltage": ("u",), "displacement": ("x",), "velocity": ("xdot", "xd"), "force": ("f",)}
"""Names as in equations, which arrays of MATLAB often have."""

_USUAL_UNITS = SI | {"displacement": "um", "velocity": "mm/s"}
"""Units of examples in messages."""


@dataclasses.dataclass(frozen=True)
class Hints:
    """The user's options for all files."""

    columns: Mapping[str, str]
    """By quantity, the name or the number of its channel; "none" for a voltage that was not recorded."""
    units: Mapping[str, str]
    scales: Mapping[str, float | str]
    interval: float | None = None
    """Interval between samples [s], where no clock was stored."""
    decimal: str = ""


@dataclasses.dataclass(frozen=True, eq=False)
class Roles:
    """The channels of a file that make a record."""

    file: Path
    channels: Mapping[str, Channel]
    """By quantity; no "time" where the file or an option has the clock, no "voltage" where none was recorded."""
    by_shape: frozenset[str]
    """Quantities whose channel is a guess: chosen without a unit, by its samples and name."""
    layout: Layout
    """The columns as a study describes them."""

    @property
    def motion(self) -> str:
        """Measured quantity of the motion: "displacement" or "velocity"."""
        return "velocity" if "velocity" in self.channels else "displacement"


def roles_of(file: Path, hints: Hints) -> Roles:
    """Assign the channels of `file` to the quantities of a record.

    **Raises:** `InputError` that lists the channels and names the options where a role or a unit is not certain.
    """
    reader = open_file(file, hints.decimal)
    channels = reader.channels()
    search = _RoleSearch(file, reader, channels, hints)
    shapes: dict[str, Callable[[Channel], bool]] = {
        "time": search.increases,
        "voltage": search.is_a_drive,
        search.motion(): search.may_move,
    }
    if search.is_clocked() and "time" not in hints.columns:
        del shapes["time"]
    if hints.columns.get("voltage") == "none":
        del shapes["voltage"]
    faults: list[str] = []
    for quantity, has_shape in shapes.items():
        try:
            search.choose(quantity, has_shape)
        except InputError as fault:
            # Of the last two channels, the user's choice of one settles the other.
            if not faults or len(channels) - len(search.chosen) > 2:
                faults.append(str(fault))
    try:
        search.check_units()
    except InputError as fault:
        faults.append(str(fault))
    if not faults:
        return search.roles()
    guessed = {quantity: c for quantity, c in search.chosen.items() if quantity not in hints.columns}
    if guessed:
        faults.append("took channel " + ", ".join(f'{c.number} ("{c.name}") for the {q}' for q, c in guessed.items()))
    raise InputError(f"{file}: " + "; ".join(f.removeprefix(f"{file}: ").removesuffix(".") for f in faults) + ".")


def friction_roles(file: Path, hints: Hints) -> Roles | None:
    """The roles in a `file` of a contact alone: a force, a motion, and times where the file has them.

    None where the file has no force, or a voltage that drives a piezo.
    """
    reader = open_file(file, hints.decimal)
    # The normal force is no friction.
    normal = ("normal", "load", "last", "fn", "fz")
    channels = [c for c in reader.channels() if not c.name.lower().startswith(normal)]
    has = lambda quantity: quantity in hints.columns or any(c.measures(SI[quantity]) for c in channels)
    is_named = lambda quantity: any(not c.unit and _called(c, quantity) for c in channels)
    driven = hints.columns.get("voltage", "none") != "none" or any(c.measures("V") for c in channels)
    if not (has("force") or is_named("force")) or (driven and "force" not in hints.columns):
        return None
    search = _RoleSearch(file, reader, channels, hints)
    if not search.is_clocked() and (has("time") or is_named("time")):
        search.choose("time", search.increases)
    search.choose("force", search.may_move)
    if has("displacement") or has("velocity"):
        motion = search.motion()
    else:
        called = lambda quantity: any(_called(channel, quantity) for channel in channels)
        motion = "velocity" if called("velocity") and not called("displacement") else "displacement"
    search.choose(motion, search.may_move)
    search.check_units()
    # Studies of a contact name the motion before the force.
    search.chosen["force"] = search.chosen.pop("force")
    return search.roles(needs_clock=False)


def _called(channel: Channel, quantity: str) -> bool:
    """Whether a channel's name, the last part of its path, means the `quantity`."""
    name = channel.name.rpartition("/")[2].strip().lower()
    return name.startswith(_NAMES[quantity]) or name in _SYMBOLS[quantity]


def _is_trigger(channel: Channel) -> bool:
    return any(word in channel.name.lower() for word in ("trig", "sync", "ttl"))


def _example_of_scale(quantity: str, channel: Channel) -> str:
    """The option that converts a sensor's volts or amperes to a `quantity`; "" for other quantities and units."""
    is_sensor = quantity not in ("time", "voltage") and (channel.measures("V") or channel.measures("A"))
    return f'--scale "{quantity}=0.5 {_USUAL_UNITS[quantity]}/{channel.unit}"' if is_sensor else ""


@dataclasses.dataclass
class _RoleSearch:
    """The search for the roles of the channels of a file."""

    file: Path
    reader: AbstractSource
    channels: Sequence[Channel]
    hints: Hints
    chosen: dict[str, Channel] = dataclasses.field(default_factory=dict)
    """The channel of each quantity chosen so far."""
    guessed: set[str] = dataclasses.field(default_factory=set)
    """Quantities whose channel was chosen without a unit."""

    def roles(self, needs_clock: bool = True) -> Roles:
        """The roles of the channels that were chosen."""
        columns = {quantity: self._name(channel) for quantity, channel in self.chosen.items()}
        hints = self.hints
        layout = Layout(columns, SI, hints.units, hints.scales, hints.interval, 0.0, hints.decimal, needs_clock)
        return Roles(self.file, self.chosen, frozenset(self.guessed), layout)

    def _name(self, channel: Channel) -> str | int:
        """The name of a channel where no other channel has it, else its number."""
        for name in (channel.name, channel.written):
            alike = [other for other in self.channels if name in (other.name, other.written)]
            if name and name != str(channel.number) and alike == [channel]:
                return name
        return channel.number

    def is_clocked(self) -> bool:
        """Whether the file or an option gives a clock, without a channel of times."""
        return self.hints.interval is not None or any(channel.interval for channel in self.channels)

    def motion(self) -> str:
        """The quantity of the motion: "displacement", or "velocity" where the file has no displacement."""
        options = [quantity for quantity in ("displacement", "velocity") if quantity in self.hints.columns]
        if len(options) == 2:
            raise InputError(f"{self.file}: found both --displacement and --velocity, expected one of them.")
        has = lambda unit: any(channel.measures(unit) for channel in self.channels)
        if known := options or [quantity for quantity in ("displacement", "velocity") if has(SI[quantity])]:
            return known[0]
        for unit, kind in (("N", "force"), ("m/s^2", "acceleration")):
            if has(unit):
                raise InputError(
                    f"{self.file}: found no displacement or velocity, but a channel in {unit}, from which no study is "
                    f'made: leave the file out, and add a [[record]] with measures = "{kind}" to the study that is '
                    'made ("What can be measured" in docs/study-file.md), or name a motion by --displacement.'
                )
        return "displacement"

    def choose(self, quantity: str, has_shape: Callable[[Channel], bool]) -> None:
        """Choose the channel of a `quantity`: by option, unit and name, else by the shape of its samples."""
        if option := self.hints.columns.get(quantity):
            self.chosen[quantity] = find_channel(self.reader, self.file, self.channels, name_or_number(option))
            return
        remaining = [channel for channel in self.channels if channel not in self.chosen.values()]
        fitting = [channel for channel in remaining if self._may_be(channel, quantity)]
        named = [channel for channel in fitting if _called(channel, quantity)]
        if quantity == "voltage" and len(fitting) > 1 and sum(map(has_shape, fitting)) > 1:
            # A command and a monitor, both in volts: only the user knows which is at the piezo.
            named = []
        for candidates in (fitting, named):
            if len(candidates) == 1:
                self.chosen[quantity] = candidates[0]
                return
        # Without units, or with several channels of the unit, shapes decide, then names.
        unfit = {channel for channel in remaining if channel.unit and not channel.letter} - set(fitting)
        shapes = [
            channel for channel in named or fitting or [c for c in remaining if c not in unfit] if has_shape(channel)
        ]
        by_name = [channel for channel in shapes if not fitting and _called(channel, quantity)]
        for candidates in (shapes, by_name):
            if len(candidates) == 1:
                self.chosen[quantity] = candidates[0]
                self.guessed.add(quantity)
                return
        self._ask(quantity, shapes, remaining)

    def _ask(self, quantity: str, shapes: Sequence[Channel], remaining: Sequence[Channel]) -> None:
        """**Raises** `InputError` with the channels of the right shape, or else those `left`, and the option."""
        moving = shapes or [channel for channel in remaining if self.may_move(channel)] or remaining
        listed = ", ".join(f'{c.number}: "{c.name}"' + (f" [{c.unit}]" if c.unit else "") for c in moving[:8])
        advice = {
            "time": ', or --interval "50 us" with the interval between samples',
            "voltage": ' (or "none" and the voltage by --peak)',
        }.get(quantity, "")
        if all(channel.unit and not self._may_be(channel, quantity) for channel in moving):
            example = next(filter(None, (_example_of_scale(quantity, channel) for channel in moving)), "")
            advice += f", and --scale with the factor of its numbers, such as {example}" if example else ""
        found = "several channels" if len(shapes or ([] if quantity == "time" else moving)) > 1 else "no channel"
        raise InputError(
            f"{self.file}: found {found} that may be the {quantity} ({listed or 'none is left'}), "
            f"expected --{quantity} with a name or a number{advice}."
        )

    def check_units(self) -> None:
        """**Raises** `InputError` for units that are unknown or of another quantity."""
        missing = [
            quantity
            for quantity, channel in self.chosen.items()
            if not (channel.unit or quantity in self.hints.units or quantity in self.hints.scales)
        ]
        if missing:
            listed = ", ".join(f'the {q} in channel {self.chosen[q].number} ("{self.chosen[q].name}")' for q in missing)
            options = " ".join(f"--unit {q}={_USUAL_UNITS[q]}" for q in missing)
            raise InputError(f"{self.file}: found no unit of {listed}, expected options such as {options}.")
        for quantity, channel in self.chosen.items():
            with_unit = channel._replace(letter=False)
            if channel.unit and quantity not in self.hints.units and not self._may_be(with_unit, quantity):
                example = _example_of_scale(quantity, with_unit)
                scale = f"--scale with the factor of its numbers, such as {example}, or " if example else ""
                raise InputError(
                    f'{self.file}: found the {quantity} in channel {channel.number} ("{channel.name}") in '
                    f'"{channel.unit}", expected {scale}--unit with another unit, or another channel by --{quantity}.'
                )

    def _may_be(self, channel: Channel, quantity: str) -> bool:
        """Whether a channel's unit, times the scale where one is given, is one of the `quantity`."""
        scale = self.hints.scales.get(quantity)
        if scale is None or not channel.unit:
            return channel.measures(SI[quantity])
        try:
            return bool(scaled(scale, channel.unit, SI[quantity], ""))
        except InputError:
            return False

    def _values(self, channel: Channel) -> Float[np.ndarray, " n"]:
        """The numbers among the first four million samples of a channel."""
        read = read_samples(self.reader, self.file, [channel.number], Clock(None, interval=1.0), (0.0, 4e6))
        values = read.values[:, 0]
        return values[np.isfinite(values)]

    def increases(self, channel: Channel) -> bool:
        """Whether a channel may be a clock: it increases in roughly even steps."""
        steps = np.diff(self._values(channel))
        return bool(steps.size > 2 and np.all(steps > 0) and np.ptp(steps) < 0.5 * np.median(steps))

    def may_move(self, channel: Channel) -> bool:
        """Whether a channel may show a motion: it changes, does not count samples, and is not called a trigger."""
        values = self._values(channel)
        changes = values.size > 0 and np.ptp(values) > 0
        return bool(changes and not np.all(np.diff(values) == 1.0) and not _is_trigger(channel))

    def is_a_drive(self, channel: Channel) -> bool:
        """Whether a channel is one of the waveforms of drives, which no motion is."""
        values = self._values(channel)
        if _is_trigger(channel) or values.size < 16 or np.ptp(values) == 0 or self.increases(channel):
            return False
        return detect_waveform(np.arange(values.size, dtype=float), values).name != "sampled"


## files/channel_samples.py
