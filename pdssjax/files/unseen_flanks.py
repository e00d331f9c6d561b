"""What the samples of a voltage leave open of a drive, as parameters of its record: fast flanks, the voltage itself.

A sample or two on a flank, with noise, or none, tell how long it lasts and when it begins within bounds only; the
motion tells the rest.  Taken for exact they bias all other parameters: the ringing after a step that is 20 us late is
not that of any damping.  The noise of all samples leaves the voltage open, and with it how far the platform moves with
a volt.
"""

import math
from collections.abc import Sequence

from ..metrics import RecordGuess, Timing, gain_of
from .toml_table import quoted

_RINGS = 2.5e-4
"""Interval [s] up to which samples show the ringing after a flank, which tells when it was; beyond, a drive's start and
a contact that is seen in aliases would be taken for each other."""

_TOLD = 0.1
"""Part of a sample's noise below which what the voltage leaves open moves no sample."""

_FELT = 1.0
"""Part of what a motion's noise leaves open of its extent, from which what the voltage's noise leaves open counts."""

_FLANK = {"step": "drive.rise_time", "sawtooth": "drive.fall_time", "cycloidal": "drive.fall_time"}
"""By waveform, the duration of its fast flank."""


def is_open(guess: RecordGuess) -> bool:
    """Whether the motion of a record tells more of its drive's flanks than its voltage does."""
    wave, gain = guess.waveform, gain_of(guess)
    if wave.timing is None or guess.volts is None:
        return False
    if wave.timing.errors is None and sampling_interval(guess) > _RINGS:
        return False
    shortest, longest, *_ = wave.timing
    moved = gain * abs(wave.numbers["voltage"]) * (longest - shortest) / max(longest, sampling_interval(guess))
    return moved > _TOLD * guess.motion_noise


def is_unsure(guess: RecordGuess) -> bool:
    """Whether the noise of the voltage leaves more open of how far a volt moves than that of the motion lets pass."""
    return gain_of(guess) * guess.waveform.voltage_error > _FELT * guess.motion_noise / math.sqrt(guess.time.size)


def condition_of(name: str) -> str:
    """The condition under which a record alone is made, by its name."""
    return name.replace("@", " at ")


def sampling_interval(guess: RecordGuess) -> float:
    """[s]"""
    return float((guess.time[-1] - guess.time[0]) / (guess.time.size - 1))


def early_start(guess: RecordGuess) -> float:
    """When the drive starts at the earliest [s]: a sensor's delay in the fit makes it later."""
    return guess.start - _timing(guess).within


def numbers_of(guess: RecordGuess) -> dict[str, float]:
    """Of the record's drive; a sawtooth whose fast flank is left to the fit has the voltage that its slope tells."""
    numbers = dict(guess.waveform.numbers)
    if is_open(guess):
        lasts = numbers.pop(_FLANK[guess.waveform.name].partition(".")[2], 0.0)
        if guess.waveform.name == "sawtooth":
            numbers["voltage"] /= 1.0 - lasts * numbers["frequency"]
    return numbers


def _timing(guess: RecordGuess) -> Timing:
    assert guess.waveform.timing is not None
    return guess.waveform.timing


def open_parameters(named: Sequence[tuple[str, RecordGuess]]) -> list[str]:
    """Lines of a study's parameters for those of the named records that leave something open."""
    return [*_flank_parameters(named), *_voltage_parameters(named)]


def _voltage_parameters(named: Sequence[tuple[str, RecordGuess]]) -> list[str]:
    unsure = [(name, guess) for name, guess in named if is_unsure(guess)]
    if not unsure:
        return []
    # A sweep, which belongs to no record, takes that of the first walk.
    first = next((guess for _, guess in unsure if guess.measures == "effector"), unsure[0][1])
    lines = [f'"drive.voltage" = {{ value = "{numbers_of(first)["voltage"]:.10g} V" }}  # of a record without one']
    for name, guess in unsure:
        told = f'"{numbers_of(guess)["voltage"]:.10g} V", standard_error = "{guess.waveform.voltage_error:.3g} V"'
        path = quoted(f"drive.voltage@{condition_of(name)}")
        lines.append(f"{path} = {{ value = {told} }}  # by its samples and their noise")
    return lines


def _flank_parameters(named: Sequence[tuple[str, RecordGuess]]) -> list[str]:
    open_records = [(name, guess) for name, guess in named if is_open(guess)]
    if not open_records:
        return []
    lines = ['"sensor.delay" = { value = 0 }']
    if any(guess.waveform.name == "step" for _, guess in open_records):
        lines.append('"drive.rise_time" = { value = 0 }')
    for name, guess in open_records:
        held = lambda path, name=name: quoted(f"{path}@{condition_of(name)}")
        flank = _FLANK[guess.waveform.name]
        shortest, longest, within, errors = _timing(guess)
        if errors is None:
            told = "# as far as the voltage tells"
            # The standard deviation of a number that may lie anywhere between bounds.
            duration = _about(0.5 * (shortest + longest), (longest - shortest) / math.sqrt(12.0))
            delay = _about(within, within / math.sqrt(3.0))
        else:
            told = "# by the samples on the flanks"
            duration = _about(guess.waveform.numbers[flank.partition(".")[2]], errors[0])
            delay = _about(within, errors[1])
        lines += [f"{held(flank)} = {duration}  {told}", f"{held('sensor.delay')} = {delay}  # of the drive's start"]
    return lines


def _about(number: float, error: float) -> str:
    return f'{{ value = "{1e6 * number:.7g} us", standard_error = "{1e6 * error:.3g} us" }}'
