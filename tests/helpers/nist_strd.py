"""The 27 nonlinear regression problems of NIST's Statistical Reference Datasets, as one function of a number.

Data, starts and certified values (public domain, of the U.S. government) are in nist_strd.json, from
https://www.itl.nist.gov/div898/strd/nls/nls_main.shtml.  Problems are padded to the same shapes, so that
one compiled function solves them all.
"""

import json
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax

DATA = json.loads(Path(__file__).with_suffix(".json").read_text(encoding="utf-8"))
_LARGEST = 9, 250
"""Parameters and observations that the largest problems have."""


def _gauss(b, x, _):
    peak = lambda height, at, width: height * jnp.exp(-((x - at) ** 2) / width**2)
    return b[0] * jnp.exp(-b[1] * x) + peak(b[2], b[3], b[4]) + peak(b[5], b[6], b[7])


def _lanczos(b, x, _):
    return sum(b[i] * jnp.exp(-b[i + 1] * x) for i in (0, 2, 4))


def _cubic(b, x, _):
    return (b[0] + x * (b[1] + x * (b[2] + x * b[3]))) / (1.0 + x * (b[4] + x * (b[5] + x * b[6])))


def _chwirut(b, x, _):
    return jnp.exp(-b[0] * x) / (b[1] + b[2] * x)


def _rise(b, x, _):
    return b[0] * (1.0 - jnp.exp(-b[1] * x))


def _enso(b, x, _):
    wave = lambda cosine, sine, period: (
        cosine * jnp.cos(2.0 * jnp.pi * x / period) + sine * jnp.sin(2.0 * jnp.pi * x / period)
    )
    return b[0] + wave(b[1], b[2], 12.0) + wave(b[4], b[5], b[3]) + wave(b[7], b[8], b[6])


MODELS = {
    "Bennett5": lambda b, x, _: b[0] * (b[1] + x) ** (-1.0 / b[2]),
    "BoxBOD": _rise,
    "Chwirut1": _chwirut,
    "Chwirut2": _chwirut,
    "DanWood": lambda b, x, _: b[0] * x ** b[1],
    "ENSO": _enso,
    "Eckerle4": lambda b, x, _: b[0] / b[1] * jnp.exp(-0.5 * ((x - b[2]) / b[1]) ** 2),
    "Gauss1": _gauss,
    "Gauss2": _gauss,
    "Gauss3": _gauss,
    "Hahn1": _cubic,
    "Kirby2": lambda b, x, _: (b[0] + x * (b[1] + x * b[2])) / (1.0 + x * (b[3] + x * b[4])),
    "Lanczos1": _lanczos,
    "Lanczos2": _lanczos,
    "Lanczos3": _lanczos,
    "MGH09": lambda b, x, _: b[0] * (x**2 + x * b[1]) / (x**2 + x * b[2] + b[3]),
    "MGH10": lambda b, x, _: b[0] * jnp.exp(b[1] / (x + b[2])),
    "MGH17": lambda b, x, _: b[0] + b[1] * jnp.exp(-x * b[3]) + b[2] * jnp.exp(-x * b[4]),
    "Misra1a": _rise,
    "Misra1b": lambda b, x, _: b[0] * (1.0 - (1.0 + b[1] * x / 2.0) ** -2.0),
    "Misra1c": lambda b, x, _: b[0] * (1.0 - (1.0 + 2.0 * b[1] * x) ** -0.5),
    "Misra1d": lambda b, x, _: b[0] * b[1] * x / (1.0 + b[1] * x),
    "Nelson": lambda b, x, other: b[0] - b[1] * x * jnp.exp(-b[2] * other),
    "Rat42": lambda b, x, _: b[0] / (1.0 + jnp.exp(b[1] - b[2] * x)),
    "Rat43": lambda b, x, _: b[0] / (1.0 + jnp.exp(b[1] - b[2] * x)) ** (1.0 / b[3]),
    "Roszman1": lambda b, x, _: b[0] - b[1] * x - jnp.arctan(b[2] / (x - b[3])) / jnp.pi,
    "Thurber": _cubic,
}


class Regression(NamedTuple):
    """One problem, padded: parameters and observations beyond its own are 1, and count nothing."""

    which: np.ndarray
    x: np.ndarray
    other: np.ndarray
    measured: np.ndarray
    used: np.ndarray
    """1 for the problem's own observations, else 0."""


def regression(name: str) -> Regression:
    """The problem called `name`."""
    data = DATA[name]
    measured = np.log(data["y"]) if name == "Nelson" else np.array(data["y"])
    padded = [_padded(values, _LARGEST[1]) for values in (data["x"][0], data["x"][-1], measured, measured)]
    padded[3] = np.arange(_LARGEST[1]) < len(measured)
    return Regression(np.array(list(MODELS).index(name)), *(np.asarray(a, float) for a in padded))


def starts(name: str) -> list[np.ndarray]:
    """Both, padded."""
    return [_padded(start, _LARGEST[0]) for start in DATA[name]["starts"]]


def _padded(values, size: int) -> np.ndarray:
    return np.concatenate([values, np.ones(size - len(values))])


def residual(b, problem: Regression):
    """Model less measured, shape (250,)."""
    found = lax.switch(problem.which, list(MODELS.values()), b, problem.x, problem.other)
    return jnp.where(problem.used > 0, found - problem.measured, 0.0)
