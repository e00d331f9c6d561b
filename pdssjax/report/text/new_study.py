"""What files suggest for the records of a study, as plain text."""

from collections.abc import Sequence

from ...metrics import RecordGuess
from ._layout import aligned_table, heading

_BEGINS = {
    "seen": "seen",
    "held": "held before",
    "clock": "by the clock",
    "running": "ran before",
    "motion": "by the motion",
}
"""How it is known when a drive starts, in short."""


def format_guesses(guesses: Sequence[tuple[str, RecordGuess]]) -> str:
    """A table of what each named record is taken to be."""
    head = ["", "measures", "drive", "", "V", "Hz", "t = 0 (s)", "", "noise"]
    return heading("Guessed from the files") + aligned_table("<<<<>>><>", [head, *(_row(*pair) for pair in guesses)])


def _row(name: str, guess: RecordGuess) -> list[str]:
    wave = guess.waveform
    frequency = wave.numbers.get("frequency")
    return [
        name,
        guess.measures + (", turned" if guess.turned else ""),
        wave.name,
        wave.direction,
        f"{wave.numbers['voltage']:.5g}" + (f" from {wave.counted_from:.4g}" if wave.counted_from else ""),
        "" if frequency is None else f"{frequency:.6g}",
        f"{round(guess.start, 9) + 0.0:.6g}",
        _BEGINS[wave.begins],
        guess.display.text(guess.noise),
    ]
