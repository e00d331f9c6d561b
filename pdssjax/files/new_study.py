"""Makes a study of files: what their samples suggest, as a study file whose guesses are marked, and figures of them."""

import dataclasses
import math
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from ..core import Figure, member, quantities
from ..metrics import RUNNING, RecordGuess
from .channel_roles import Roles
from .guessed_record import (
    NewRecord,
    RigOptions,
    condition_of,
    early_start,
    has_open_flanks,
    has_uncertain_voltage,
    numbers_of,
    open_parameters,
    sampling_interval,
)
from .results_folder import check_empty, staging_folder
from .toml_table import quoted

_RINGING_INTERVAL = 2e-3
"""Interval [s] below which samples show how a platform rings."""


def write_study(records: Sequence[NewRecord], rig: RigOptions, folder: Path, title: str) -> Path:
    """Write `study.toml` and a figure of each record into `folder`, which must be new or empty; the study's path.

    **Raises:** `InputError` if the folder holds something already, or cannot be written to.
    """
    from ..report.figures import guess_figure

    names = distinct_names([record.name for record in records])
    named = [dataclasses.replace(record, name=name) for record, name in zip(records, names, strict=True)]
    figures = (guess_figure(record.name, record.guess) for record in named)
    return put_study(folder, study_text(named, rig, folder, title), names, figures)


def put_study(folder: Path, text: str, names: Sequence[str], figures: Iterable[Figure]) -> Path:
    """Write the `text` of a study into `folder`, with the figure of each record of the `names`; the study's path."""
    from ..report.figures import save_figure

    check_empty(folder)
    # All of it or nothing: what is broken off can be begun again in the same folder.
    with staging_folder(folder, ("check", "study.toml")) as staging:
        (staging / "check").mkdir()
        for name, figure in zip(names, figures, strict=True):
            save_figure(figure, staging / "check" / (re.sub(r"[^\w.-]+", "_", name) + ".png"))
        (staging / "study.toml").write_text(text, encoding="utf-8")
    return folder / "study.toml"


def distinct_names(names: Sequence[str]) -> list[str]:
    """The names of records, numbered where several are alike."""
    made: list[str] = []
    for name in names:
        tried, number = name, 2
        while tried.casefold() in [other.casefold() for other in made]:
            tried, number = f"{name} {number}", number + 1
        made.append(tried)
    return made


def head_lines(title: str) -> list[str]:
    """The first lines of a study that is made of files."""
    return [
        "# Made by pdssjax new: what is marked as a guess was read off the samples; check/ shows it.",
        'format = "pdssjax-study/1"',
        f"title = {quoted(title)}",
        "",
        "[actuator]",
    ]


def record_lines(name: str, roles: Roles, folder: Path, keys: Mapping[str, str]) -> list[str]:
    """The lines of a record that say how its file is read.

    **Arguments:** the `folder` of the study; `keys` of the study by quantity, for the quantities that it has of the
    file; of a voltage the drive says which column it is.
    """
    layout = roles.layout
    columns = {keys[q]: column for q, column in layout.columns.items() if q in keys and q != "voltage"}
    guessed = [quantity for quantity in layout.columns if quantity in keys and quantity in roles.by_shape]
    by_shape = f"  # guess: {', '.join(guessed)} told by the samples and names" if guessed else ""
    lines = [
        "[[record]]",
        f"name = {quoted(name)}",
        f"file = {quoted(Path(os.path.relpath(roles.file, folder)).as_posix())}",
        f"columns = {{ {', '.join(f'{key} = {toml_value(column)}' for key, column in columns.items())} }}{by_shape}",
    ]
    if layout.interval is not None and "time" in keys:
        lines.append(f'time = {{ interval = "{layout.interval:.9g} s" }}')
    units = {keys[q]: unit for q, unit in layout.units.items() if q in keys and q in roles.channels}
    if units:
        lines.append("units = { " + ", ".join(f"{key} = {quoted(unit)}" for key, unit in units.items()) + " }")
    if layout.decimal:
        lines.append(f"decimal = {quoted(layout.decimal)}")
    return lines


def scale_lines(given: float | str | None, turned: bool, why: str) -> list[str]:
    """The line of the scale that was `given`, with the other sign where what was measured is `turned`, and `why`."""
    if not turned:
        return [] if given is None else [f"scale = {toml_value(given)}"]
    scale: float | str = -1
    if isinstance(given, str):
        scale = given.strip()[1:] if given.strip().startswith("-") else f"-{given.strip().lstrip('+')}"
    elif given is not None:
        scale = -given
    return [f"scale = {toml_value(scale)}  # guess: {why}"]


def toml_value(given: float | str) -> str:
    """A number or a text as a study has it."""
    return quoted(given) if isinstance(given, str) else f"{given:g}"


def study_text(records: Sequence[NewRecord], rig: RigOptions, folder: Path, title: str) -> str:
    """The study file of the `records`, as it stands in `folder`; every guess has a comment that says so."""
    piezo, friction = _choose_models(records)
    by_samples = [_needs_samples(record.guess, piezo) for record in records]
    records = [_with_samples(record) if by else record for record, by in zip(records, by_samples, strict=True)]
    has_walks = any(record.guess.measures == "effector" for record in records)
    why = _WHY_FRICTION[friction] if has_walks else "no record shows it, and none of its parameters is needed"
    parts = [
        *head_lines(title),
        f"piezo = {piezo if piezo in _COMPOSED_STACKS else quoted(piezo)}  # guess: {_WHY_PIEZO[piezo]}",
        f'friction = "{friction}"  # guess: {why}',
        "",
        "[parameters]",
        *_parameters(records, rig, piezo, friction, has_walks),
    ]
    for record, by in zip(records, by_samples, strict=True):
        parts += ["", *_record(record, folder, by)]
    return "\n".join(parts) + "\n"


LOOPS = (
    '{ dynamics = "first-order", hysteresis = { law = "play", elements = 4, asymmetry = 3 }, creep = { elements = 2 } }'
)
"""The stack of records that are slow and show hysteresis: the motion is linear in all but three of its parameters."""

RINGING_LOOPS = '{ dynamics = "second-order", hysteresis = { law = "play", elements = 4, asymmetry = 3 } }'
"""The stack of records that show hysteresis, and how the platform rings after a jump of the voltage."""

_COMPOSED_STACKS = {
    LOOPS: ("gain", "time_constant", "play_*", "play_range", "asymmetry_*", "creep_*", "creep_time"),
    RINGING_LOOPS: ("gain", "natural_frequency", "damping_ratio", "play_*", "play_range", "asymmetry_*"),
}
"""The parameters of each composed stack, as a study lists them."""

_WHY_PIEZO = {
    "bouc-wen": "the platform's motion is a loop of the voltage: hysteresis; composed stacks model it otherwise",
    "second-order": "the usual one; pdssjax models lists others",
    "static": "the records are too slow to show how the platform rings",
    LOOPS: "the platform's motion is a loop of the voltage: hysteresis, creep and a lag; see docs/study-file.md",
    RINGING_LOOPS: "a loop of the voltage, which also jumps: hysteresis and ringing; see docs/study-file.md for creep",
}

_WHY_FRICTION = {
    "anisotropic-lugre": "there are records of both directions; pdssjax models lists others",
    "simplified-lugre": "the simplest one that shows a slip; pdssjax models lists others",
}


def _choose_models(records: Sequence[NewRecord]) -> tuple[str, str]:
    guesses = [record.guess for record in records]
    walk_guesses = [guess for guess in guesses if guess.measures == "effector"]
    fast = any(
        (guess.waveform.has_fast_flanks or guess.waveform.name in ("step", "trapezoid") or _jumps(guess))
        and sampling_interval(guess) < _RINGING_INTERVAL
        for guess in guesses
    )
    # A hundredth of the motion, root mean square, that no line of the voltage explains.
    loops = any(guess.hysteresis > 0.01 for guess in guesses if guess.waveform.name in ("sine", "triangle", "sampled"))
    slow = ("bouc-wen" if walk_guesses else LOOPS) if loops else "second-order" if walk_guesses else "static"
    ringing = RINGING_LOOPS if loops and not walk_guesses else "second-order"
    piezo = ringing if fast else slow
    both = {guess.waveform.direction for guess in walk_guesses} >= {"forward", "backward"}
    return piezo, "anisotropic-lugre" if both else "simplified-lugre"


def _jumps(guess: RecordGuess) -> bool:
    """Whether the voltage goes 30 % of its way from one sample to the next: what follows it rings."""
    return guess.volts is not None and bool(np.max(np.abs(np.diff(guess.volts))) > 0.3 * np.ptp(guess.volts))


def _parameters(records: Sequence[NewRecord], rig: RigOptions, piezo: str, friction: str, has_walks: bool) -> list[str]:
    lines: list[str] = []
    if has_walks:
        why = "  # guess: WEIGH IT; stiffness, damping and force are fitted in proportion to it"
        mass, why = ("100 g", why) if rig.mass is None else (f"{1e3 * rig.mass:.6g} g", "")
        lines.append(f'"effector.mass" = {{ value = "{mass}" }}{why}')
    required = lambda family, name: [f for f, q in quantities(member(family, name)).items() if not q.optional]
    entries = dict.fromkeys(_COMPOSED_STACKS.get(piezo) or required("piezo", piezo), "{}")
    if piezo == "bouc-wen":
        why = "  # guess: the records are too slow to show it"
        entries |= {"natural_frequency": f'{{ value = "1 kHz" }}{why}', "damping_ratio": f'{{ value = "20 %" }}{why}'}
    lines += [f'"piezo.{field}" = {entry}' for field, entry in entries.items()]
    if has_walks:
        lines += [f'"friction.{field}" = {{}}' for field in required("friction", friction)]
    # Every sawtooth needs a fall time that leaves its flanks to the fit, of the platform alone, too.
    sawteeth = [record.guess for record in records if record.guess.waveform.has_fast_flanks]
    if has_walks or any(map(has_open_flanks, sawteeth)):
        has_own = lambda guess: has_open_flanks(guess) or "fall_time" in guess.waveform.numbers
        entry = "{ value = 0 }  # guess: shorter than what the samples tell; free it where the amplifier is slow"
        if sawteeth and all(map(has_own, sawteeth)):
            entry = "{ value = 0 }  # of a record without one of its own; below each has one"
        if any(record.guess.volts is None for record in records):
            entry = '{ start = "1 ms", min = 0, max = "10 ms" }  # guess: no voltage was recorded, so it is fitted'
        lines.append(f'"drive.fall_time" = {entry}')
    lines += open_parameters([(record.name, record.guess) for record in records])
    # Where a sampled voltage jumps the ringing tells when it did.
    jumps = (record.guess for record in records if record.guess.waveform.name == "sampled" and _jumps(record.guess))
    finest = min(map(sampling_interval, jumps), default=_RINGING_INTERVAL)
    if finest < _RINGING_INTERVAL and not any(line.startswith('"sensor.delay"') for line in lines):
        ends = f'start = "{0.5e6 * finest:.4g} us", min = 0, max = "{2e6 * finest:.4g} us"'
        lines.append(f'"sensor.delay" = {{ {ends} }}  # guess: the voltage jumps between two of its samples')
    return lines


def _needs_samples(guess: RecordGuess, piezo: str) -> bool:
    """Whether a stack's memory wants the samples of a voltage though a waveform explains them.

    Loops under straight lines are known in closed form, under a sine they are not; and a stack with hysteresis feels
    the level that a voltage is counted from.
    """
    curved = piezo in _COMPOSED_STACKS and guess.waveform.name == "sine"
    felt = piezo in (*_COMPOSED_STACKS, "bouc-wen") and guess.waveform.counted_from != 0
    return guess.volts is not None and (curved or felt)


def _with_samples(record: NewRecord) -> NewRecord:
    """A record whose samples are its drive: they leave nothing open to the fit."""
    closed = dataclasses.replace(record.guess.waveform, timing=None, voltage_error=0.0)
    return dataclasses.replace(record, guess=dataclasses.replace(record.guess, waveform=closed))


def _record(record: NewRecord, folder: Path, by_samples: bool) -> list[str]:
    guess, layout = record.guess, record.roles.layout
    why = "follows the voltage" if guess.measures == "platform" else "walks, or goes another way than the voltage"
    told_by = "" if record.measures_given else f"  # guess: the motion {why}"
    motion = record.roles.motion
    lines = record_lines(record.name, record.roles, folder, {q: q for q in ("time", "voltage", motion)})
    lines += scale_lines(layout.scales.get(motion), guess.turned, "the motion goes against the voltage")
    if guess.velocity is None:
        lines.append(f'measures = "{guess.measures}"{told_by}')
    else:
        lines += ['measures = "velocity"', f'of = "{guess.measures}"{told_by}']
    with_unit = lambda number: f"{guess.display.scale * number:.3g} {guess.display.unit}"
    origin = "the scatter of neighbouring samples"
    if guess.resolution:
        origin += f"; counted in steps of {with_unit(guess.resolution)}"
        if guess.noise <= 1.001 * guess.resolution / math.sqrt(12.0):
            origin = f"that of rounding to steps of {with_unit(guess.resolution)}, beside which no noise is seen"
    lines.append(f'noise = "{with_unit(guess.noise)}"  # guess: {origin}')
    early = "early" if guess.waveform.name == "sampled" and guess.waveform.begins == "seen" else guess.waveform.begins
    start, why = guess.start, _WHY_START[early]
    if has_open_flanks(guess):
        start, why = early_start(guess), f"{why}, or later by sensor.delay"
    if record.gaps:
        pairs = ", ".join(f'["{begin:.12g} s", "{end:.12g} s"]' for begin, end in record.gaps)
        lines.append(f"exclude = [{pairs}]  # guess: the file has no numbers there")
    if has_open_flanks(guess) or has_uncertain_voltage(guess):
        lines.append(f"conditions = [{quoted(condition_of(record.name))}]")
    if by_samples and guess.waveform.begins == "running":
        start, why = float(guess.time[0]), "the first sample; what ran before is in the conditioning"
        period = 1.0 / guess.waveform.numbers["frequency"]
        ran = f"{{ cycles = {RUNNING}, period = {quoted(f'{period:.10g} s')} }}"
        lines.append(f"conditioning = {ran}  # guess: {_WHY_START['running']}")
    held = by_samples and guess.waveform.begins == "seen" and guess.waveform.counted_from != 0
    if held or guess.waveform.begins == "held":
        start, why = float(guess.time[0]), _WHY_START["held"]
        # Long beside what creeps in a record.
        lines.append('conditioning = "60 s"  # guess: so long the first voltage was held before')
    lines += [f'start = "{start:.12g} s"  # guess: {why}'] * (start != 0)
    return [*lines, _samples_of_waveform(record) if by_samples else _drive(record)]


def _samples_of_waveform(record: NewRecord) -> str:
    """The samples of a voltage, as the drive, with what is known of it."""
    wave = record.guess.waveform
    volts, hertz = wave.numbers["voltage"], wave.numbers.get("frequency")
    # Elements of hysteresis follow the peaks of the noise.
    smooth = "" if hertz is None or wave.misfit <= 5e-4 else f', smooth = "{1e3 / (100.0 * hertz):.4g} ms"'
    of = f"{volts:.10g} V" + ("" if hertz is None else f" and {hertz:.10g} Hz") + _from_level(wave.counted_from)
    misfit = f"a {wave.name} of {of} leaves {100 * max(wave.misfit, 1e-4):.2g} % of them"
    why = "hysteresis under them is quicker to compute" if wave.name == "sine" else "hysteresis feels that level"
    return f"{drive_of_samples(record, smooth)}  # guess: {misfit}; {why}"


def _from_level(level: float) -> str:
    """The level that a waveform's voltage is counted from, where that is not 0 V."""
    return f", counted from {level:.5g} V" if level else ""


_WHY_START = {
    "seen": "the voltage leaves its rest there",
    "early": "the voltage rests at 0 V there, and leaves it soon after",
    "held": "the first sample, at a voltage that was held before",
    "clock": "the clock counts from the drive's start",
    "motion": "the motion sets in with the record, so the drive starts there",
    "running": "the drive ran before the record; since when is not known, two cycles are taken",
}


def _drive(record: NewRecord) -> str:
    wave = record.guess.waveform
    if wave.name == "sampled":
        return f"{drive_of_samples(record)}  # guess: no waveform explains it, so its samples are the drive"
    units = {"voltage": "V", "bias": "V", "phase": "rad", "frequency": "Hz", "fall_time": "s", "rise_time": "s"}
    keys = [f'waveform = "{wave.name}"'] + [f'direction = "{wave.direction}"'] * bool(wave.direction)
    keys += ['told_by = "slope"'] * (has_open_flanks(record.guess) and wave.name == "sawtooth")
    for field, number in numbers_of(record.guess).items():
        if field == "voltage" and has_uncertain_voltage(record.guess):
            continue
        keys.append(f'{field} = "{number:.10g} {units[field]}"' if field in units else f"{field} = {number:.6g}")
    recorded = record.guess.volts is not None
    left = f"it leaves {100 * max(wave.misfit, 1e-4):.2g} % of the voltage" if recorded else "by the slips"
    bounds = "".join(f"; {bound}" for bound in wave.uncertain)
    level = _from_level(wave.counted_from)
    linear = f"{level}, which a stack without hysteresis does not feel" if level else ""
    return f"drive = {{ {', '.join(keys)} }}  # guess: {left}{linear}{bounds}"


def drive_of_samples(record: NewRecord, further: str = "") -> str:
    """The line of a study that takes a record's voltage as it was sampled, with `further` keys (", ..." each)."""
    layout = record.roles.layout
    scale = f", scale = {toml_value(layout.scales['voltage'])}" if "voltage" in layout.scales else ""
    return f'drive = {{ waveform = "sampled", column = {toml_value(layout.columns["voltage"])}{scale}{further} }}'
