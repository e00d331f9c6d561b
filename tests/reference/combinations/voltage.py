"""The voltage that reaches the stack, in closed form between corners and the amplifier's slew events.

An amplifier of bandwidth f_a and slew rate S follows its command as

    u' = w (command - u) with w = 2 pi f_a, but never faster than S:

a ramp while it slews, else the command's own harmonic response and a decaying exponential.
"""

import dataclasses
import math

from tests.reference.combinations.drives import Segment
from tests.reference.combinations.roots import first_fall

JUST = 1e-12
"""Time [s] after a begin in which a function that starts on its limit is taken to be inside."""


@dataclasses.dataclass(frozen=True)
class Stretch:
    """u = start + slope s + amplitude cos(rate s + phase) + rest exp(-decay s) [V], s = t - origin, on [begin, end]."""

    begin: float
    end: float
    origin: float
    start: float
    slope: float
    amplitude: float = 0.0
    rate: float = 0.0
    phase: float = 0.0
    rest: float = 0.0
    decay: float = 0.0

    def at(self, t: float) -> tuple[float, float, float]:
        """u [V], u' [V/s] and u'' [V/s^2]."""
        s = t - self.origin
        u, du, ddu = self.start + self.slope * s, self.slope, 0.0
        if self.amplitude:
            angle = self.rate * s + self.phase
            real, imaginary = self.amplitude * math.cos(angle), self.amplitude * math.sin(angle)
            u, du, ddu = u + real, du - self.rate * imaginary, ddu - self.rate * self.rate * real
        if self.rest:
            left = self.rest * math.exp(-self.decay * s)
            u, du, ddu = u + left, du - self.decay * left, ddu + self.decay * self.decay * left
        return u, du, ddu

    def part(self, begin: float, end: float) -> "Stretch":
        """The same voltage from `begin` to `end` [s]."""
        return dataclasses.replace(self, begin=begin, end=end)

    @property
    def straight(self) -> bool:
        """A line, which does not turn."""
        return not self.amplitude and not self.rest


def ideal(segments: list[Segment]) -> list[Stretch]:
    """The command itself."""
    return [Stretch(s.begin, s.end, s.begin, s.start, s.slope, s.amplitude, s.rate, s.phase) for s in segments]


@dataclasses.dataclass(frozen=True)
class Amplifier:
    """A low-pass whose output cannot change faster than its slew rate."""

    bandwidth: float = 5e3
    """[Hz]"""
    slew: float = 1e9
    """The fastest change of its output [V/s]."""

    @property
    def w(self) -> float:
        """The rate of its low-pass [1/s]."""
        return 2 * math.pi * self.bandwidth

    def path(self, segments: list[Segment]) -> list[Stretch]:
        """The output under a command, from 0 V on."""
        stretches, u = [], 0.0
        for command in ideal(segments):
            now, wanted = command.begin, self.w * (command.at(command.begin)[0] - u)
            way = math.copysign(1.0, wanted) if abs(wanted) > self.slew else 0.0
            while now < command.end:
                here, ends, following = self.slewing(command, now, u, way) if way else self.linear(command, now, u)
                end = ends or command.end
                stretches.append(here.part(now, end))
                u, now, way = here.at(end)[0], end, following
        return stretches

    def slewing(self, command: Stretch, now: float, u: float, way: float) -> tuple[Stretch, float | None, float]:
        """A ramp up to where the command asks for no more than the slew rate."""
        ramp = Stretch(now, command.end, now, u, way * self.slew)
        excess = lambda t: way * self.w * (command.at(t)[0] - ramp.at(t)[0]) - self.slew
        return ramp, first_fall(excess, now, command.end), 0.0

    def linear(self, command: Stretch, now: float, u: float) -> tuple[Stretch, float | None, float]:
        """The low-pass's response up to where it would be faster than the slew rate, and in which direction it is."""
        w, rate, shift = self.w, command.rate, now - command.origin
        start, slope = command.start + command.slope * shift - command.slope / w, command.slope
        gain = w / math.hypot(w, rate) if command.amplitude else 1.0
        late = math.atan2(rate, w) if command.amplitude else 0.0
        harmonic = command.amplitude * gain, rate, command.phase + rate * shift - late
        forced = Stretch(now, command.end, now, start, slope, *harmonic)
        here = dataclasses.replace(forced, rest=u - forced.at(now)[0], decay=w)
        room = lambda t: self.slew - abs(here.at(t)[1])
        # Where a ramp has just ended it begins on the limit.
        ends = first_fall(lambda t: room(t) if t > now + JUST else max(room(t), 1e-300), now, command.end)
        return here, ends, math.copysign(1.0, here.at(ends)[1]) if ends else 0.0


def monotone(stretches: list[Stretch]) -> list[Stretch]:
    """The same, cut where the voltage turns."""
    parts = []
    for stretch in stretches:
        now = stretch.begin
        while now < stretch.end:
            turn, inside = None, now + min(1e-9, 0.01 * (stretch.end - now))
            if not stretch.straight and inside < stretch.end:
                way = math.copysign(1.0, stretch.at(inside)[1])
                turn = first_fall(lambda t, way=way, u=stretch: way * u.at(t)[1], inside, stretch.end)
            end = turn if turn and turn < stretch.end - 1e-15 else stretch.end
            parts.append(stretch.part(now, end))
            now = end
    return parts
