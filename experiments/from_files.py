"""Do two commands lead from an instrument's files to parameters, whatever the sampling, the flanks and the noise?

Rigs are drawn at random: all nine parameters, voltage, sampling interval, how long the step and the sawteeth take for
their fast flanks, when they begin between two samples, and the noise of the voltage's monitor.  Each writes what an
instrument would store, with a clock of its own, as CSV, MATLAB, TDMS or HDF5; `pdssjax new` and `pdssjax identify` do
the rest, in processes of their own.

    python -m experiments.from_files        # resumes where it was left
    python -m experiments.from_files 100    # so many
"""

import json
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from scipy import stats

from experiments.common import BLUE, OUT, Row, print_table, save, styled
from experiments.coverage_figure import draw_coverage
from experiments.draws import numbered_results
from pdssjax import load_study, prepare_jax
from pdssjax.files import read_covariance
from pdssjax.study import make_recordings

NAME = "from_files"
RIGS = 20
NOISE = 5e-9
"""Of the motion [m]."""
LIMIT = 1800.0
"""Seconds after which an identification is given up."""
GIVEN_UP = 124
"""The exit status of one that was."""

TRUTH = {
    "piezo.gain": 0.152e-6,
    "piezo.natural_frequency": 2 * np.pi * 1450.0,
    "piezo.damping_ratio": 0.05,
    "friction.sigma0_a": 0.90e6,
    "friction.sigma0_b": 0.60e6,
    "friction.sigma1_a": 40.0,
    "friction.sigma1_b": 28.0,
    "friction.f_ss_a": 0.42,
    "friction.f_ss_b": 0.31,
}
"""Around which rigs are drawn [SI]."""

SCATTER = {"piezo.gain": 1.2, "piezo.natural_frequency": 1.2, "friction.f_ss_a": 1.2, "friction.f_ss_b": 1.2}
"""Largest factor either way."""
OTHERS = 1.5
"""The same of all that is not named."""

PLAN = """\
format = "pdssjax-study/1"
actuator = { piezo = "second-order", friction = "anisotropic-lugre" }
[parameters]
"effector.mass" = { value = "45 g" }
"""

RECORD = """
[[record]]
name = "{name}"
file = "{name}.csv"
columns = {{ time = "time_s", displacement = "displacement_um" }}
measures = "{measures}"
noise = {noise}
drive = {{ {drive} }}
sampling = {{ start = {start}, end = {end}, interval = {interval} }}
"""

FREQUENCY = 10.0
"""Of the sawteeth [Hz]."""

LENGTHS = {"step": 0.1, "forward": 0.5, "backward": 0.5}
"""Of the records, after the clock's 0 [s]."""

Result = dict[str, Any]
"""Of one rig, as JSON holds it."""


class Rig(NamedTuple):
    """A rig and its instrument."""

    rise: float
    """Of the step [s]."""
    fall: float
    """Of the sawteeth [s]."""
    volts_noise: float
    """Of the voltage's monitor [V]."""
    truth: dict[str, float] = TRUTH
    interval: float = 50e-6
    """Between samples [s]."""
    voltage: float = 60.0
    """[V]"""
    begins: tuple[float, float, float] = (61e-6, 33e-6, 3.7e-6)
    """When the drive of each record starts, by its clock [s]."""
    seed: int = 6
    ending: str = ".csv"
    """Of its files: one of `STORED`."""
    bias: float = 0.0
    """At which the voltage rests, and from which it goes up [V]."""
    waveform: str = "sawtooth"
    """Of the walks."""


def drawn_rig(number: int) -> Rig:
    """A rig at random."""
    random = np.random.default_rng([41, number])
    between = lambda low, high: float(low * (high / low) ** random.uniform())
    truth = {path: v * SCATTER.get(path, OTHERS) ** random.uniform(-1.0, 1.0) for path, v in TRUTH.items()}
    interval = between(20e-6, 100e-6)
    return Rig(
        rise=float(random.uniform(0.0, 200e-6)),
        fall=between(20e-6, 400e-6),
        volts_noise=between(2e-3, 60e-3),
        truth=truth,
        interval=interval,
        voltage=between(20.0, 80.0),
        begins=tuple(float(share) * interval for share in random.uniform(0.0, 2.0, 3)),  # pyright: ignore
        seed=number,
        ending=list(STORED)[number % len(STORED)],
    )


CHANNELS = {"Time": "s", "Monitor": "V", "Position": "um"}
"""What an instrument stores, and the units."""

Table = Float[np.ndarray, "samples 3"]


def _csv(file: Path, table: Table) -> None:
    head = ",".join(f"{name} ({unit})" for name, unit in CHANNELS.items())
    np.savetxt(file, table, ("%.11g", "%.7g", "%.9g"), ",", header=head, comments="")


def _mat(file: Path, table: Table) -> None:
    from scipy.io import savemat

    savemat(file, dict(zip(CHANNELS, table.T, strict=True)))


def _tdms(file: Path, table: Table) -> None:
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(file) as made:
        made.write_segment(
            [
                ChannelObject("Scope", name, column.copy(), {"unit_string": unit})
                for (name, unit), column in zip(CHANNELS.items(), table.T, strict=True)
            ]
        )


def _hdf5(file: Path, table: Table) -> None:
    from h5py import File

    with File(file, "w") as made:
        for (name, unit), column in zip(CHANNELS.items(), table.T, strict=True):
            made.create_dataset(f"scope/{name}", data=column).attrs["units"] = unit


STORED = {".csv": _csv, ".mat": _mat, ".tdms": _tdms, ".h5": _hdf5}
"""What writes a file, by its ending."""


def write_files(folder: Path, rig: Rig) -> list[Path]:
    """What an instrument would store of the rig: clock, monitor of the voltage and position."""
    saw = f'waveform = "{rig.waveform}", voltage = {rig.voltage}, frequency = {FREQUENCY}, fall_time = {rig.fall}'
    runs = {
        "step": ("platform", f'waveform = "step", voltage = {rig.voltage}, rise_time = {rig.rise}'),
        "forward": ("effector", f'{saw}, direction = "forward"'),
        "backward": ("effector", f'{saw}, direction = "backward"'),
    }
    begins = dict(zip(runs, rig.begins, strict=True))
    times = {name: np.arange(-0.005, LENGTHS[name], rig.interval) for name in runs}
    plan = PLAN + "".join(f'"{path}" = {{ value = {float(number)!r} }}\n' for path, number in rig.truth.items())
    for name, (measures, drive) in runs.items():
        start, end = float(times[name][0] - begins[name]), float(times[name][-1] - begins[name] + 1e-9)
        named = {"name": name, "measures": measures, "noise": NOISE, "drive": drive}
        plan += RECORD.format(start=start, end=end, interval=rig.interval, **named)
    (folder / "plan.toml").write_text(plan)
    random, files = np.random.default_rng(rig.seed), []
    for made in make_recordings(load_study(folder / "plan.toml", virtual=True), rig.seed):
        name = made.record.name
        assert made.record.drive is not None
        volts = np.asarray(made.record.drive.at(jnp.asarray(times[name] - begins[name])))
        volts = rig.bias + volts + random.normal(0.0, rig.volts_noise, volts.size)
        motion = made.true + random.normal(0.0, NOISE, volts.size)
        table = np.stack([times[name] + 1.0, volts, 1e6 * motion], axis=1)
        files.append(folder / f"{name}{rig.ending}")
        STORED[rig.ending](files[-1], table)
    return files


def units(rig: Rig) -> list[str]:
    """The options that `pdssjax new` asks for where a file has no units: MATLAB's arrays."""
    told = ("time=s", "voltage=V", "displacement=um") if rig.ending == ".mat" else ()
    return [word for unit in told for word in ("--unit", unit)]


def true_flanks(rig: Rig, study: Path) -> dict[str, float]:
    """What there is to be found of the flanks and voltages that `study` leaves open, by path [s, V]."""
    found: dict[str, float] = {}
    for record, begins in zip(tomllib.loads(study.read_text(encoding="utf-8"))["record"], rig.begins, strict=True):
        name, start = record["name"], float(record.get("start", "0 s").split()[0])
        found[f"sensor.delay@{name}"] = 1.0 + begins - start
        flank, lasts = ("drive.rise_time", rig.rise) if name == "step" else ("drive.fall_time", rig.fall)
        found[f"{flank}@{name}"] = lasts
        whole = rig.voltage / (1.0 - FREQUENCY * rig.fall)
        found[f"drive.voltage@{name}"] = whole if record.get("drive", {}).get("told_by") == "slope" else rig.voltage
    return found


def identified(number: int) -> Result:
    """A rig, by its files alone."""
    prepare_jax(dedicated=True)  # in another process, too
    rig = drawn_rig(number)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        files = write_files(folder, rig)
        made, words, _ = _command("new", folder / "rig", "--files", *files, "--mass", "45 g", *units(rig))
        result: Result = {"rig": rig._asdict(), "new": made, "words": words}
        if made:
            return result
        study = folder / "rig" / "study.toml"
        status, words, seconds = _command("identify", study, "--out", folder / "out")
        result |= {"study": study.read_text(encoding="utf-8"), "words": words, "status": status, "seconds": seconds}
        if not (folder / "out" / "estimate.json").exists():
            return result
        return result | told(folder / "out" / "estimate.json", rig.truth | true_flanks(rig, study))


def told(file: Path, truth: Mapping[str, float]) -> Result:
    """What an estimate.json says of every parameter that was fitted, beside the truth."""
    found = json.loads(file.read_text(encoding="utf-8"))
    fitted = {path: p for path, p in found["parameters"].items() if p["free"] and path in truth}
    names, covariance, _ = read_covariance(file)
    rows = [row for row, name in enumerate(names) if name in TRUTH]
    off = np.array([fitted[names[row]]["value"] - truth[names[row]] for row in rows])
    size = np.sqrt(np.diag(covariance)[rows])
    distance = (off / size) @ np.linalg.solve(covariance[np.ix_(rows, rows)] / np.outer(size, size), off / size)
    return {
        "message": found["message"],
        "reduced_chi2": found["statistics"]["reduced_chi2"],
        "evaluations": found["statistics"]["evaluations"],
        "notes": found["notes"],
        "distance": float(distance),
        "parameters": {
            path: [truth[path], p["value"], p["standard_error"], p["interval"]] for path, p in fitted.items()
        },
    }


def _command(*words: str | Path) -> tuple[int, str, float]:
    """A command of pdssjax in a process of its own: exit status, the end of what it said, seconds."""
    begun = time.monotonic()
    command = [sys.executable, "-m", "pdssjax", *map(str, words)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT, check=False)
    except subprocess.TimeoutExpired as late:
        return GIVEN_UP, (late.stderr or b"").decode(errors="replace")[-2000:], time.monotonic() - begun
    return done.returncode, done.stderr[-2000:], time.monotonic() - begun


def holds(parameter: Sequence[Any]) -> bool:
    """Whether the 95 % interval holds the truth."""
    truth, _, _, (low, high) = parameter
    return bool(low is not None and low <= truth <= high)


def ended(results: Sequence[Result]) -> list[Result]:
    """Those with an estimate of all parameters."""
    known = lambda result: all(p[2] is not None for path, p in result["parameters"].items() if path in TRUTH)
    return [result for result in results if "parameters" in result and known(result)]


def coverage(results: Sequence[Result]) -> dict[str, float]:
    """By parameter, how many intervals hold the truth [%]; flanks of all records together."""
    inside: dict[str, list[bool]] = {}
    for result in ended(results):
        for path, parameter in result["parameters"].items():
            inside.setdefault(path.partition("@")[0], []).append(holds(parameter))
    return {path: 100.0 * float(np.mean(each)) for path, each in inside.items()}


def table(results: Sequence[Result]) -> list[Row]:
    """What the two commands came to."""
    good = ended(results)
    distances = np.array([result["distance"] for result in good])
    likely = stats.kstest(distances, stats.chi2(len(TRUTH)).cdf).pvalue
    count = lambda wanted: f"{sum(map(wanted, results))} of {len(results)}"
    return [
        Row("a question of new", None, count(lambda r: r["new"] != 0)),
        Row("exit status 0", None, count(lambda r: r.get("status") == 0)),
        Row("exit status 3", None, count(lambda r: r.get("status") == 3)),
        Row("given up", None, count(lambda r: r.get("status") == GIVEN_UP)),
        Row("seconds, median", None, float(np.median([r["seconds"] for r in results if "seconds" in r]))),
        Row("distance of the truth, mean", None, float(np.mean(distances)), "", f"{len(TRUTH)} expected"),
        Row("chance of such a distribution of it", None, float(likely), "", "Kolmogorov and Smirnov"),
        *(Row(f"95 % intervals hold {path}", None, f"{share:.0f}", "%") for path, share in coverage(results).items()),
    ]


def draw(results: Sequence[Result]) -> Figure:
    """Coverage of every parameter with its uncertainty."""
    shares = coverage(results)
    return draw_coverage(
        {"two commands": np.array(list(shares.values()))},
        (BLUE,),
        list(shares),
        len(ended(results)),
        f"{len(ended(results))} random rigs, from their files",
        "95 % intervals that hold the truth (%)",
    )


def main(rigs: int = RIGS) -> None:
    """Print the table and draw the figure."""
    # One at a time, for each is a process of its own that takes all cores.
    results = numbered_results(rigs, identified, OUT / NAME, workers=1)
    print_table(f"{len(results)} random rigs, from their files", table(results), NAME)
    with styled():
        save(draw(results), NAME)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
