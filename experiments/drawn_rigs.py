"""Rigs drawn at random, each with one of five friction laws, as study folders: nothing of the package is used.

Walks are integrated by SciPy's LSODA from the equations of the laws; that of the direction-dependent law, whose force
jumps at v = 0, by the simulator of the tests that locates events.

A rig has two steps of the platform, a slow walk forward and a fast one backward to fit, and a fast walk forward with
role "validate".  Parameters lie around the thesis's, up to a factor of 2 either way.  Walks are sampled every 0.1 ms;
the noise of 5 nm is white, or has a correlation time of 1 ms.

The study of a folder is posed under the simplified law, whatever the truth; `truth.json` tells law, parameters and
noise, `clean.npz` the samples without noise.
"""

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import odeint

from tests.reference.independent import Rig, corners, simulate

LAWS = "dahl", "simplified-lugre", "lugre", "elastoplastic", "anisotropic-lugre"
NOISE = 5e-9
"""Standard deviation [m]."""
CORRELATION_TIME = 1e-3
"""Of the noise of every other five rigs [s]."""
FACTOR = 2.0
"""Largest factor either way between a parameter and the thesis's."""
STATIC = 1.05, 1.5
"""Static force over Coulomb's."""
ELASTIC = 0.3, 0.9
"""Breakaway deflection over that of steady sliding."""
TOLERANCE, LONGEST = 1e-10, 2e-5
"""Relative, and the longest step [s]: what is left is below 1e-10 m, as `test_compared_rigs` has it."""


class Walk(NamedTuple):
    """A record of the end-effector under a sawtooth."""

    name: str
    frequency: float
    cycles: int
    forward: bool
    role: str

    @property
    def times(self) -> np.ndarray:
        """Of the samples [s], none at a corner of the drive."""
        return (np.arange(round(self.cycles / self.frequency / WALK_INTERVAL)) + 0.5) * WALK_INTERVAL


WALKS = (
    Walk("slow, forward", 10.0, 3, True, "fit"),
    Walk("fast, backward", 25.0, 4, False, "fit"),
    Walk("fast, forward", 25.0, 4, True, "validate"),
)
WALK_INTERVAL = 1e-4
STEPS = {"low step": 48.2, "high step": 75.4}
"""Voltages of the thesis [V]."""
STEP_TIMES = np.arange(600) * 5e-5


@dataclasses.dataclass(frozen=True)
class DrawnRig:
    """The truth of one rig; SI."""

    number: int
    law: str
    contact: dict[str, float]
    """Parameters of the law."""
    gain: float
    frequency: float
    damping: float
    mass: float
    fall: float
    voltage: float
    """Of the walks [V]."""
    correlation_time: float
    """Of the noise [s]; 0: white."""


def draw(number: int) -> DrawnRig:
    """Rig `number`: of ten in a row two have each law, one with white noise and one with coloured."""
    random = np.random.default_rng([51, number])
    near = lambda value: float(value * FACTOR ** random.uniform(-1.0, 1.0))
    law = LAWS[number % len(LAWS)]
    if law == "anisotropic-lugre":
        thesis = {
            "sigma0_a": 1.1484e6,
            "sigma0_b": 0.953789e6,
            "sigma1_a": 54.4,
            "sigma1_b": 38.9,
            "f_ss_a": 0.7964,
            "f_ss_b": 0.5458,
        }
        contact = {name: near(value) for name, value in thesis.items()}
    else:
        contact = {"sigma0": near(1.05e6)}
        if law != "dahl":
            contact["sigma1"] = near(46.0)
        contact["f_ss" if law == "simplified-lugre" else "f_c"] = near(0.65)
    if law in ("lugre", "elastoplastic"):
        contact |= {"f_s": contact["f_c"] * float(random.uniform(*STATIC)), "v_s": near(1e-3)}
    if law == "elastoplastic":
        contact["elastic_part"] = float(random.uniform(*ELASTIC))
    return DrawnRig(
        number=number,
        law=law,
        contact=contact,
        gain=near(1.007e-7),
        frequency=near(6736.0),
        damping=near(0.1772),
        mass=near(0.086),
        fall=near(0.5e-3),
        voltage=near(64.2),
        correlation_time=CORRELATION_TIME if number // len(LAWS) % 2 else 0.0,
    )


def step_response(rig: DrawnRig, voltage: float, times: np.ndarray) -> np.ndarray:
    """The platform [m] after a step of the voltage at t = 0: (4.2) in closed form."""
    ringing = rig.frequency * math.sqrt(1.0 - rig.damping**2)
    away = np.cos(ringing * times) + rig.damping * rig.frequency / ringing * np.sin(ringing * times)
    return rig.gain * voltage * (1.0 - np.exp(-rig.damping * rig.frequency * times) * away)


def bristle(rig: DrawnRig) -> Callable[[float, float], tuple[float, float]]:
    """Rate of the deflection z [m] and force on the end-effector [N], as a function of z and the relative velocity.

    The laws of the design brief and of the literature: z' = v (1 - alpha sign(v) z / z_ss(v)), F = s0 z + s1 z', with
    s1 = 0 and a constant z_ss of Dahl's law, s1 of the simplified one, Stribeck's curve of LuGre, and the stage without
    yielding, alpha = 0, of the elastoplastic law.
    """
    c = rig.contact
    s0, s1 = c["sigma0"], c.get("sigma1", 0.0)
    low = c.get("f_c", c.get("f_ss", 0.0))
    excess, v_s = c.get("f_s", low) - low, c.get("v_s", 1.0)
    if rig.law != "elastoplastic":

        def rates(z: float, v: float) -> tuple[float, float]:
            level = low + excess * math.exp(-((v / v_s) ** 2)) if excess else low
            rate = v - s0 * abs(v) * z / level
            return rate, s0 * z + s1 * rate

        return rates
    breakaway = c["elastic_part"] * min(low, c["f_s"]) / s0

    def elastoplastic(z: float, v: float) -> tuple[float, float]:
        end, along = (low + excess * math.exp(-((v / v_s) ** 2))) / s0, math.copysign(z, z * v)
        alpha = 0.0
        if along >= end:
            alpha = 1.0
        elif along > breakaway:
            alpha = 0.5 + 0.5 * math.sin(math.pi * (along - 0.5 * (end + breakaway)) / (end - breakaway))
        rate = v * (1.0 - alpha * along / end)
        return rate, s0 * z + s1 * rate

    return elastoplastic


def walked(rig: DrawnRig, walk: Walk, times: np.ndarray) -> np.ndarray:
    """The end-effector [m] at ascending `times` > 0."""
    numbers: dict[str, Any] = dict(
        gain=rig.gain,
        frequency=rig.frequency,
        damping=rig.damping,
        mass=rig.mass,
        fall=rig.fall,
        voltage=rig.voltage,
        cycle=1.0 / walk.frequency,
        forward=walk.forward,
    )
    if rig.law == "anisotropic-lugre":
        pair = lambda name: (rig.contact[f"{name}_a"], rig.contact[f"{name}_b"])
        two_sided = Rig(**numbers, s0=pair("sigma0"), s1=pair("sigma1"), f_ss=pair("f_ss"))
        return simulate(two_sided, times, TOLERANCE)[:, 1]
    contact = bristle(rig)
    state, out = np.zeros(5), np.empty(times.size)
    for begin, end, voltage, slope in corners(Rig(**numbers), times[-1] + 1e-6):
        rate, stiff, damped = rig.gain * slope, rig.frequency**2, 2.0 * rig.damping * rig.frequency
        rest = rig.gain * voltage

        def field(t: float, x: list[float]) -> tuple[float, ...]:
            # Platform, end-effector and deflection: (4.2), (5.23), (5.27).
            flow, force = contact(x[4], x[1] - x[3])
            pushed = stiff * (rest + rate * (t - begin) - x[0]) - damped * x[1]  # noqa: B023
            return x[1], pushed, x[3], force / rig.mass, flow

        inside = (times > begin) & (times <= end)
        asked = np.concatenate([[begin], times[inside], [end]])
        found = odeint(
            field,
            state,
            asked,
            rtol=TOLERANCE,
            atol=[1e-17, 1e-13, 1e-17, 1e-13, 1e-17],
            hmax=LONGEST,
            mxstep=10**6,
            tfirst=True,
        )
        out[inside], state = found[1 : 1 + inside.sum(), 2], found[-1]
    return out


def noise_of(count: int, interval: float, correlation_time: float, random: np.random.Generator) -> np.ndarray:
    """White noise, or an Ornstein-Uhlenbeck process [m]."""
    kicks = NOISE * random.standard_normal(count)
    if correlation_time == 0.0:
        return kicks
    kept = math.exp(-interval / correlation_time)
    out = np.empty(count)
    out[0] = kicks[0]
    for k in range(1, count):
        out[k] = kept * out[k - 1] + math.sqrt(1.0 - kept**2) * kicks[k]
    return out


HEAD = """format = "pdssjax-study/1"
title = "Rig {number}"

[actuator]
piezo = "second-order"
friction = "simplified-lugre"

[parameters]
"effector.mass" = {{ value = {mass} }}
"piezo.gain" = {{}}
"piezo.natural_frequency" = {{}}
"piezo.damping_ratio" = {{}}
"friction.sigma0" = {{}}
"friction.sigma1" = {{}}
"friction.f_ss" = {{}}
"drive.fall_time" = {{ value = {fall} }}
"""

RECORD = """
[[record]]
name = "{name}"
file = "{file}"
columns = {{ time = "time_s", displacement = "displacement_m" }}
measures = "{measures}"
role = "{role}"
drive = {{ {drive} }}
"""


def write_rig(rig: DrawnRig, folder: Path) -> Path:
    """Put study, records and truth of a rig into a `folder`; the study's path."""
    random = np.random.default_rng([52, rig.number])
    folder.mkdir(parents=True, exist_ok=True)
    text, clean = HEAD.format(**dataclasses.asdict(rig)), {}

    def add(name: str, measures: str, role: str, drive: str, times: np.ndarray, motion: np.ndarray) -> None:
        nonlocal text
        file, clean[name] = f"{name.replace(', ', '_').replace(' ', '_')}.csv", motion
        noise = noise_of(times.size, float(times[1] - times[0]), rig.correlation_time, random)
        table = np.column_stack([times, motion + noise])
        np.savetxt(folder / file, table, "%.9g", ",", header="time_s,displacement_m", comments="")
        text += RECORD.format(name=name, file=file, measures=measures, role=role, drive=drive)

    for name, voltage in STEPS.items():
        drive = f'waveform = "step", voltage = {voltage}'
        add(name, "platform", "fit", drive, STEP_TIMES, step_response(rig, voltage, STEP_TIMES))
    for walk in WALKS:
        times = walk.times
        direction = "forward" if walk.forward else "backward"
        drive = (
            f'waveform = "sawtooth", direction = "{direction}", voltage = {rig.voltage}, frequency = {walk.frequency}'
        )
        add(walk.name, "effector", walk.role, drive, times, walked(rig, walk, times))
    np.savez(folder / "clean.npz", **clean)
    (folder / "truth.json").write_text(json.dumps(dataclasses.asdict(rig), indent=2), encoding="utf-8")
    (folder / "study.toml").write_text(text, encoding="utf-8")
    return folder / "study.toml"
