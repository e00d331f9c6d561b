"""Of drives whose fast flanks pass between two samples: their durations and starts, as parameters of their records.

Where no sample lies on a flank, the voltage tells neither its duration nor, by as much, when it begins; the motion
does.  Taken for exact they bias all other parameters: the ringing after a step that is 20 us late is not that of any
damping.
"""

from collections.abc import Sequence

from ..metrics import RecordGuess
from .toml_text import quoted

_RINGS = 2.5e-4
"""Interval [s] up to which samples show the ringing after a step, which tells when it was."""

_FLANK = {"step": "drive.rise_time", "sawtooth": "drive.fall_time"}
"""By waveform, the duration of its fast flank."""


def is_open(guess: RecordGuess) -> bool:
    """Whether the motion of a record has to tell what its voltage leaves open."""
    seen = guess.waveform.name == "sawtooth" or sampling_interval(guess) <= _RINGS
    return guess.volts is not None and guess.waveform.unseen_flank > 0 and seen


def condition_of(name: str) -> str:
    """The condition under which a record alone is made, by its name."""
    return name.replace("@", " at ")


def sampling_interval(guess: RecordGuess) -> float:
    """[s]"""
    return float((guess.time[-1] - guess.time[0]) / (guess.time.size - 1))


def early_start(guess: RecordGuess) -> float:
    """When the drive starts at the earliest [s]: a sensor's delay in the fit makes it later."""
    return guess.start - sampling_interval(guess)


def flank_parameters(named: Sequence[tuple[str, RecordGuess]]) -> list[str]:
    """Lines of a study's parameters for those of the named records that leave something open."""
    open_records = [(name, guess) for name, guess in named if is_open(guess)]
    if not open_records:
        return []
    lines = ['"sensor.delay" = { value = 0 }']
    if any(guess.waveform.name == "step" for _, guess in open_records):
        lines.append('"drive.rise_time" = { value = 0 }')
    for name, guess in open_records:
        held = lambda path, name=name: quoted(f"{path}@{condition_of(name)}")
        interval, most = sampling_interval(guess), guess.waveform.unseen_flank
        lines += [
            f"{held(_FLANK[guess.waveform.name])} = {_free(0.3 * interval, most)}  # no sample lies on the flank",
            f"{held('sensor.delay')} = {_free(interval, 2.0 * interval)}  # nor tells when it begins",
        ]
    return lines


def _free(start: float, most: float) -> str:
    return f'{{ start = "{1e6 * start:.4g} us", min = 0, max = "{1e6 * most:.4g} us" }}'
