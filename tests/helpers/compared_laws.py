"""Candidates without fits: studies of a contact alone, and fits made up for comparisons to judge."""

import dataclasses
from collections.abc import Mapping
from concurrent.futures import Executor, Future
from pathlib import Path

import numpy as np

import pdssjax
from pdssjax import Study
from pdssjax.selection import Candidate, FittedCandidate
from pdssjax.selection.held_out import parts_of

TIME = np.arange(0.0, 1.0, 0.004)
MOTION = {"slow": 3e-6 * np.sin(2.0 * np.pi * 1.0 * TIME), "wide": 6e-6 * np.sin(2.0 * np.pi * 2.0 * TIME)}
NOISE = 0.01
"""Of the force [N]."""


def contact_text(law: str = "dahl", parameters: str = '"friction.sigma0" = {}\n"friction.f_c" = {}') -> str:
    """A study of two records of the friction force along a prescribed motion."""
    records = "".join(
        f'\n[[record]]\nname = "{name}"\nfile = "{name}.csv"\nmeasures = "friction"\nnoise = "{NOISE} N"\noffset = 0\n'
        'columns = { time = "time_s", motion = "x_um", force = "force_N" }\n'
        for name in MOTION
    )
    return (
        'format = "pdssjax-study/1"\ntitle = "Contact"\n\n[actuator]\npiezo = "second-order"\n'
        f'friction = "{law}"\n\n[parameters]\n{parameters}\n{records}'
    )


def write_contact(folder: Path, text: str = "", force: Mapping[str, np.ndarray] | None = None) -> Path:
    """Write the study and its records; without a `force` [N] one that looks like a contact's."""
    for name, motion in MOTION.items():
        rough = 0.6 * np.tanh(motion / 1e-6) + NOISE * np.random.default_rng(1).standard_normal(TIME.size)
        table = np.column_stack([TIME, 1e6 * motion, rough if force is None else force[name]])
        np.savetxt(folder / f"{name}.csv", table, delimiter=",", header="time_s,x_um,force_N", comments="")
    file = folder / "study.toml"
    file.write_text(text or contact_text(), encoding="utf-8")
    return file


def contact_study(folder: Path) -> Study:
    """The study, read."""
    return pdssjax.load_study(write_contact(folder))


def made_up(candidate: Candidate, size: float, seed: int = 0, shape: float = 0.0) -> FittedCandidate:
    """A fit that leaves noise of the right size, the same for all, and a misfit of `size` [N] beside it.

    The misfit is a wave that every record has; `shape` [N] is one that the first record alone has.
    """
    study, random = candidate.study, np.random.default_rng(seed)
    residuals = []
    for place, record in enumerate(study.records):
        noise = NOISE * random.standard_normal(record.time.size)
        wave = np.sin(2.0 * np.pi * 5.0 * record.time)
        residuals.append(noise + size * wave + (shape * np.cos(2.0 * np.pi * 3.0 * record.time) if not place else 0.0))
    parts = parts_of(study)
    return FittedCandidate(
        name=candidate.name,
        model=study.models.chosen,
        free=candidate.free,
        converged=True,
        explained=size == 0.0,
        message="made up",
        values={path: 1.0 if p.value is None else p.value for path, p in study.parameters.items()},
        units={path: p.unit for path, p in study.parameters.items()},
        errors=dict.fromkeys(candidate.free, 0.1),
        deviance=1e4 * size,
        residuals=tuple(residuals),
        held_out=tuple(residuals[part.record][part.rows] for part in parts),
        start="study",
        seconds=1.0,
    )


class Here(Executor):
    """Runs each task at once, in this thread."""

    def submit(self, fn, /, *args, **kwargs):
        future: Future = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


def with_drive(study: Study, **changes: object) -> Study:
    """The study with other fields."""
    return dataclasses.replace(study, **changes)
