"""A planned study with one short record of any measurement, made of what the measurement says of itself."""

import itertools

from record_tables import record_table

from pdssjax import AbstractMeasurement
from pdssjax.core import choices, member, members

FAMILY = "study.measurement"
PARAMETERS = {
    "piezo.gain": '"0.1 um/V"',
    "piezo.natural_frequency": '"6700 rad/s"',
    "piezo.damping_ratio": "0.18",
    "friction.sigma0": '"1 N/um"',
    "friction.sigma1": '"45 N s/m"',
    "friction.f_ss": '"0.65 N"',
    "effector.mass": '"86 g"',
    "stop.stiffness": '"0.03 N/um"',
    "stop.dissipation": '"10 s/m"',
}
"""Of every part that may move, as a study writes their numbers."""
STICKS = {"friction.f_c": '"0.65 N"'}
"""Of a contact that sticks, Coulomb's, in place of those of the friction."""
NOISE = {"m": "0.01 um", "m/s": "5 um/s", "N": "2 mN", "m/s^2": "0.5 m/s^2"}
"""By the unit of a measurement; others have none."""
PLAN = {"m": "3 um", "Hz": "100 Hz", "s": "1 ms", "V": "10 V"}
"""Numbers of a planned record, by their unit."""
STEP = 'drive = { waveform = "step", voltage = "60 V" }'
WALK = 'drive = { waveform = "sawtooth", direction = "forward", voltage = "60 V", frequency = "100 Hz" }'
SLOW_FALL = WALK.replace("100 Hz", "50 Hz").replace(" }", ', fall_time = "0.8 ms" }')
"""A contact that sticks holds on while the platform rings."""


def variants() -> list[AbstractMeasurement]:
    """Every measurement, with every combination of its record's own keys."""
    kinds = [member(FAMILY, name) for name in members(FAMILY)]
    return [kind(**words) for kind in kinds for words in _combinations(choices(kind))]


def _combinations(named: dict[str, dict[str, float]]) -> list[dict[str, str]]:
    return [dict(zip(named, words, strict=True)) for words in itertools.product(*named.values())]


def told(measurement: AbstractMeasurement) -> dict[str, str]:
    """The record's own keys, in the words of a study."""
    named = choices(type(measurement)).items()
    return {key: next(w for w, n in words.items() if n == getattr(measurement, key)) for key, words in named}


def label(measurement: AbstractMeasurement) -> str:
    """Its name, with what its keys say."""
    return "-".join([measurement.name, *told(measurement).values()])


def record(measurement: AbstractMeasurement, drive: str = "", end: str = "25 ms") -> str:
    """The [[record]] of a measurement."""
    unit = measurement.unit
    planned = "".join(f', {key} = "{PLAN[si]}"' for key, si in measurement.plan.items())
    lines = [
        *(f'{key} = "{word}"' for key, word in told(measurement).items()),
        *([f'noise = "{NOISE[unit]}"'] if unit in NOISE else []),
        f'sampling = {{ end = "{end}", interval = "0.1 ms"{planned} }}',
        *([drive or (WALK if measurement.effector_moves else STEP)] if measurement.driven else []),
    ]
    columns = {quantity: f"{quantity}_{si}" for quantity, si in measurement.columns.items()}
    return record_table(label(measurement), measurement.name, *lines, columns=columns)


def study(
    records: str,
    feedback: bool = False,
    more: str = "",
    starts: bool = True,
    sticks: bool = False,
    mass: str = "0.5 kg",
) -> str:
    """The text of a study with these records; every parameter has a start, or none has but the mass."""
    numbers = {path: n for path, n in PARAMETERS.items() if not (sticks and path.startswith("friction."))}
    numbers |= STICKS if sticks else {}
    free = {path: f"{{ start = {number} }}" if starts else "{}" for path, number in numbers.items()}
    free["effector.mass"] = f"{{ value = {PARAMETERS['effector.mass']} }}"
    free |= {"piezo.mass": f'{{ value = "{mass}" }}'} if feedback else {}
    listed = "\n".join(f'"{path}" = {text}' for path, text in free.items())
    return f"""format = "pdssjax-study/1"
title = "Any measurement"
[actuator]
piezo = "second-order"
friction = "{"coulomb" if sticks else "simplified-lugre"}"
feedback = {str(feedback).lower()}
[parameters]
{listed}
{more}
{records}"""
