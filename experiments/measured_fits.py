"""The fits behind `measured_laws`: one study a law, what is fitted of the record, starts, and how good it is.

The record is that of experiments/liu2015 (PROVENANCE.md).  Its time begins at 3 s; to save time the model starts
two cycles before the record instead of fifteen.  Bounds keep every parameter to what a contact can be, see
`_bounds`.
"""

import concurrent.futures
import dataclasses
import json
import math
import multiprocessing
import os
import tempfile
import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

import pdssjax
from experiments.fits import Curves, Found
from pdssjax import Accuracy, Study, Taylor, prepare_jax
from pdssjax.core import member, quantities
from pdssjax.inference import guess_starts
from pdssjax.metrics import error_index

FOLDER = Path(__file__).parent / "liu2015"
STARTS = FOLDER / "starts.json"
LAWS = {
    "generalized-maxwell-slip": ("generalized-maxwell-slip", "deflection"),
    "elastoplastic": ("elastoplastic", "deflection"),
    "anisotropic-lugre, deflection": ("anisotropic-lugre", "deflection"),
    "anisotropic-lugre, force": ("anisotropic-lugre", "force"),
    "lugre": ("lugre", "deflection"),
    "dahl": ("dahl", "deflection"),
    "simplified-lugre": ("simplified-lugre", "deflection"),
    "stribeck": ("stribeck", "deflection"),
    "coulomb": ("coulomb", "deflection"),
}
"""Law and reading by name; the slowest to compile first."""
ACCURACY = Accuracy(method=Taylor(6), tolerance=1e-9, settle_tolerance=1e-9)
"""A hundredth of the reading error of 0.1 um."""
PERIOD = 0.2
EARLIER = 13 * PERIOD
"""The record's clock is set back by this."""
HALF = 4.0
"""The first five cycles end here."""
GRAVITY = 9.81


def study(law: str, reading: str) -> Study:
    """The measured record with one law, every sample of it."""
    names = quantities(member("friction", law))
    text = "\n".join(
        [
            'format = "pdssjax-study/1"',
            f'[actuator]\npiezo = "second-order"\nfriction = "{law}"\nfriction_state = "{reading}"',
            "[parameters]",
            '"effector.mass" = { value = "0.1 kg" }',
            '"piezo.gain" = { start = "0.0917 um/V" }',
            '"piezo.natural_frequency" = { start = "6685.5 rad/s", min = 500, max = 2e4 }',
            '"piezo.damping_ratio" = { start = 0.2488, min = 0.02 }',
            '"drive.fall_time" = { start = "1 ms", min = "0.05 ms", max = "8 ms" }',
            '"sensor.bandwidth" = { start = "100 Hz", min = "10 Hz", max = "20 kHz" }',
            '"sensor.delay" = { start = "0.5 ms", max = "4 ms" }',
            *(f'"friction.{name}" = {_bounds(name)}' for name in names if not (law == "dahl" and name == "exponent")),
        ]
    )
    for file in ("endeffector_3to5s_500Hz.csv", "fig22_slip_event_1kHz.csv"):
        text += (
            f'\n[[record]]\nfile = "{(FOLDER / file).as_posix()}"\nmeasures = "effector"\n'
            'columns = { time = "time_s", displacement = "end_effector_displacement_um" }\n'
            'drive = { waveform = "sawtooth", direction = "forward", voltage = "30 V", frequency = "5 Hz" }\n'
        )
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", pdssjax.InputWarning)  # the second record is shorter than a period
        path = Path(folder) / "study.toml"
        path.write_text(text, encoding="utf-8")
        loaded = pdssjax.load_study(path)
    records = tuple(dataclasses.replace(record, time=record.time - EARLIER) for record in loaded.records)
    return dataclasses.replace(loaded, records=records)


def _bounds(name: str) -> str:
    """What a contact can be, for a mass of 0.1 kg: forces up to a friction coefficient of 1, stiffness to 2 kHz, ..."""
    for beginning, bounds in {
        "f_": "{ max = 0.98 }",
        "strength": "{ max = 0.25 }",
        "sigma0": "{ min = 1e4, max = 1.6e7 }",
        "stiffness": "{ min = 1e3, max = 1.6e7 }",
        "sigma1": "{ min = 0.1, max = 500.0 }",
        "sigma2": "{ max = 100.0 }",
        "v_s": "{ min = 1e-5, max = 0.1 }",
        "weakened": "{ min = 0.2, max = 2.0 }",
        "elastic_part": "{ min = 0.01, max = 0.99 }",
    }.items():
        if name.startswith(beginning):
            return bounds
    return "{}"


def masks(study: Study, until: float = math.inf, after: float = -math.inf) -> list[Bool[np.ndarray, " n"]]:
    """The samples of each record that could be read well, within a part of the record [s, the paper's clock]."""
    out = []
    for record in study.records:
        times = record.time + EARLIER
        part = (times < until) & (times >= after)
        out.append(part & well_read(times) if record.time.size > 100 else part)
    return out


def well_read(times: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Of the record of 2 s: neither the first three samples nor those from 1 ms before a slip to 5 ms after."""
    phase = (times + 1e-3) % PERIOD
    return (times > 3.007) & (phase > 6e-3)


def free_of(study: Study) -> list[str]:
    """What is fitted: all but the mass and the piezo's dynamics, which are the paper's."""
    held = {"effector.mass", "piezo.natural_frequency", "piezo.damping_ratio"}
    return [path for path in study.parameters if path not in held]


@dataclasses.dataclass(frozen=True)
class Fitted:
    """One law's results; lengths in um."""

    law: str
    whole: Found
    """Fitted to all samples that were read well."""
    first: Found
    """Fitted to the first five cycles only."""
    well: float
    """Error index over the well-read samples of the record of 2 s."""
    all: float
    """The same with the slips."""
    held_out: float
    """Error index over the last five cycles, predicted from the first five, slips left out."""
    judged: dict[str, float]
    """Numbers by which to judge whether it is possible, see `judge`."""


def fit(law: str, starts: dict[str, float]) -> Fitted:
    """Everything about one law, in a process of its own."""
    prepare_jax(dedicated=True)
    return _fitted(law, Curves(study(*LAWS[law]), ACCURACY, starts), starts)


def _fitted(law: str, curves: Curves, starts: dict[str, float]) -> Fitted:
    posed = curves.study
    free = free_of(posed)
    whole = curves.fit(starts, free, masks(posed), limit=12)
    first = curves.fit(whole.values, free, masks(posed, until=HALF), limit=12)
    record, times = posed.records[0], posed.records[0].time + EARLIER
    index = lambda found, mask: 1e6 * error_index(record.measured[mask], found.predicted[0][mask])
    return Fitted(
        law=law,
        whole=whole,
        first=first,
        well=index(whole, well_read(times)),
        all=index(whole, times > 3.007),
        held_out=index(first, masks(posed, after=HALF)[0]),
        judged=judge(whole.values),
    )


def floor(measured: Float[np.ndarray, " n"], times: Float[np.ndarray, " n"], mask: Bool[np.ndarray, " n"]) -> float:
    """Error index [um] of the record's own mean cycle with a straight drift: what a periodic law could reach at best.

    Corrected for the freedom of the mean, which follows the noise.
    """
    phase = np.round((times % PERIOD) / 2e-3).astype(int) % 100
    columns = np.zeros((times.size, 101))
    columns[np.arange(times.size), phase] = 1.0
    columns[:, 100] = times - times.mean()
    columns, wanted = columns[mask], 1e6 * measured[mask]
    rest = wanted - columns @ np.linalg.lstsq(columns, wanted, rcond=None)[0]
    return math.sqrt(float(rest @ rest) / (wanted.size - np.linalg.matrix_rank(columns)))


def judge(values: Mapping[str, float]) -> dict[str, float]:
    """What does not depend on the mass: friction coefficient, contact's frequency and damping, viscous part.

    The platform falls by gain times voltage within the fall time; with that speed sigma2 gives the viscous part of
    the force of sliding.
    """
    law = {path.split(".")[1]: value for path, value in values.items() if path.startswith("friction.")}
    mass = values["effector.mass"]
    forces = [value for name, value in law.items() if name.startswith("f_")]
    stiffness = [value for name, value in law.items() if name.startswith("sigma0")]
    damping = [value for name, value in law.items() if name.startswith("sigma1")]
    if "strength_1" in law:
        forces = [sum(law[f"strength_{i}"] for i in range(1, 5))]
        stiffness = [sum(law[f"stiffness_{i}"] for i in range(1, 5))]
    speed = 30.0 * values["piezo.gain"] / max(values["drive.fall_time"], 1e-4)
    out = {"coefficient": max(forces) / (mass * GRAVITY)}
    if stiffness:
        out["contact"] = math.sqrt(max(stiffness) / mass) / (2.0 * math.pi)
    if stiffness and damping:
        out["damping"] = max(damping) / (2.0 * math.sqrt(max(stiffness) * mass))
    if "sigma2" in law:
        out["viscous"] = law["sigma2"] * speed / max(forces)
    return out


def verdict(judged: Mapping[str, float]) -> str:
    """Whether the parameters could be a contact's, or why not."""
    against = []
    if not 0.02 <= judged["coefficient"] <= 1.01:
        against.append(f"friction coefficient {judged['coefficient']:.2g}")
    if not 100.0 <= judged.get("contact", 500.0) <= 2010.0:
        against.append(f"contact at {judged['contact']:.3g} Hz")
    if judged.get("damping", 0.0) > 1.0:
        against.append(f"contact's damping ratio {judged['damping']:.2g}")
    if judged.get("viscous", 0.0) > 1.0:
        against.append(f"viscous force {judged['viscous']:.2g} of Coulomb's")
    return "not possible: " + ", ".join(against) if against else "possible"


def fit_all() -> list[Fitted]:
    """Every law, two processes at a time, the best first."""
    starts = json.loads(STARTS.read_text(encoding="utf-8"))["starts"]
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(min(2, os.cpu_count() or 1), mp_context=context) as pool:
        results = pool.map(fit, LAWS, [starts[law] for law in LAWS])
        return sorted(results, key=lambda fitted: fitted.whole.squares)


def search_all() -> None:
    """Find every law's starts and keep them."""
    found: dict[str, dict[str, float]] = {}
    for law in ("lugre", *(name for name in LAWS if name != "lugre")):
        found[law] = search(law, found)
    remark = "Starts [SI] for experiments/measured_laws.py, found by its option --search; mass 0.1 kg, see there."
    STARTS.write_text(json.dumps({"remark": remark, "starts": found}, indent=1) + "\n", encoding="utf-8")


def search(law: str, others: Mapping[str, dict[str, float]], points: int = 60, best: int = 4) -> dict[str, float]:
    """The best of fits from random points, and from what LuGre's parameters amount to in a law that is its kin."""
    posed = study(*LAWS[law])
    middle, _ = guess_starts(posed.models, posed.parameters, posed.records)
    curves = Curves(posed, ACCURACY, middle)
    random = np.random.default_rng(0)
    used, free = masks(posed), free_of(posed)
    trials = []
    for number in range(points):
        point = {path: value * (_spread(path, random) if number else 1.0) for path, value in middle.items()}
        point = {path: value if path in free else middle[path] for path, value in point.items()}
        found = curves.fit(point, free, used, limit=0)
        trials.append((found.squares if math.isfinite(found.squares) else math.inf, number, point))
    starts = [point for _, _, point in sorted(trials)[:best]]
    if "lugre" in others and LAWS[law][0] in ("simplified-lugre", "anisotropic-lugre", "dahl"):
        starts.append(kin(others["lugre"], middle))
    results = [curves.fit(point, free, used, limit=30) for point in starts]
    print(law, [f"{found.squares:.4g}" for found in results], flush=True)
    return min(results, key=lambda found: found.squares).values


def kin(lugre: Mapping[str, float], middle: Mapping[str, float]) -> dict[str, float]:
    """LuGre's values under the names of a simpler law, the same in both directions."""
    renamed = {path: path.removesuffix("_a").removesuffix("_b").replace("f_ss", "f_c") for path in middle}
    return {path: float(lugre.get(renamed[path], value)) for path, value in middle.items()}


def _spread(path: str, random: np.random.Generator) -> float:
    """A random factor: a law's parameter may be far from the middle of its plausible range, the gain may not."""
    reach = {"friction": 8.0, "sensor": 3.0, "drive": 3.0}.get(path.split(".")[0], 1.0)
    return float(reach ** random.uniform(-1.0, 1.0))
