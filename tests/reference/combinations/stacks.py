"""Stacks: what their ceramic aims at (hysteresis, creep), and how the platform follows (static, first, second order).

y = e + C sum c_j;   or   tau y' = that - y;   or   y'' = w^2 (that - y) - 2 xi w y'  [ - F / m_g (5.25) ]
T_j c_j' = share_j u - c_j
"""

import copy
import dataclasses
import math

from scipy.optimize import brentq

from tests.reference.combinations.hysteresis import BoucWen, Elements, Piece
from tests.reference.combinations.voltage import Stretch, monotone

STACK_MASS = 0.56
"""Moving mass m_g [kg] where none is given: it counts with friction feedback only."""


@dataclasses.dataclass(frozen=True)
class Dynamics:
    """How the platform follows what the ceramic aims at."""

    order: int
    time: float = 0.0
    """tau [s] of the first order."""
    frequency: float = 0.0
    """w [rad/s] of the second."""
    damping: float = 0.0
    """xi"""
    mass: float = math.inf
    """m_g [kg]"""


STATIC = Dynamics(0)


def oscillator(numbers: dict[str, float]) -> Dynamics:
    """The usual second order."""
    mass = numbers.get("mass", STACK_MASS)
    return Dynamics(2, frequency=numbers["natural_frequency"], damping=numbers["damping_ratio"], mass=mass)


def rod(numbers: dict[str, float], strain: float) -> tuple[float, Dynamics]:
    """Gain [m/V] and first mode of a rod that carries the platform at its end (4.3-4.12); strain in [1/V]."""
    length, modulus, density = numbers["stack_length"], numbers["modulus"], numbers["density"]
    mass = density * numbers["area"] * length
    r = numbers["platform_mass"] / mass
    characteristic = lambda x: r * x * math.sin(x) - math.cos(x)
    x = brentq(characteristic, 1e-12, math.pi / 2, xtol=1e-16, rtol=8.9e-16)
    w = x * math.sqrt(modulus / density) / length
    gain = 2 * strain * length / (x * x * (1 + r + r * r * x * x))
    damping = numbers["viscosity"] * w / (2 * modulus)
    return gain, Dynamics(2, frequency=w, damping=damping, mass=mass * (1 + r + r * r * x * x) / 2)


@dataclasses.dataclass
class Stack:
    """A stack with the platform that it carries."""

    dynamics: Dynamics
    hysteresis: Elements | BoucWen
    """As it is before anything has moved."""
    creep: list[tuple[float, float]] = dataclasses.field(default_factory=list)
    """(share, time [s]) of each element."""
    creep_scale: float = 1.0
    """What a unit of their states adds: C [m/V] where those are voltages; of a rod's displacements the mode's share."""

    @property
    def states(self) -> int:
        """How many: y and y' as far as the dynamics have them, and creep."""
        return self.dynamics.order + len(self.creep)

    def pieces(self, path: list[Stretch]) -> list[Piece]:
        """The voltage cut into pieces on each of which hysteresis has one expression; jumps are passed over."""
        hysteresis, pieces, seen = copy.deepcopy(self.hysteresis), [], 0.0
        for stretch in monotone(path):
            u = stretch.at(stretch.begin)[0]
            if u != seen:
                hysteresis.pass_over(u - seen)
            pieces += hysteresis.split(stretch)
            seen = stretch.at(stretch.end)[0]
        return pieces


def numbered(numbers: dict[str, float], name: str, count: int) -> list[float]:
    """name_1, name_2, ..."""
    return [numbers[f"{name}_{i}"] for i in range(1, count + 1)]


def composed(text: str, n: dict[str, float]) -> Stack:
    """A stack put together, such as static+play-8+creep-3."""
    first, *words = text.split("+")
    counts = {name: int(count or 1) for name, _, count in (word.rpartition("-") for word in map(with_count, words))}
    dynamics, scale = STATIC, 1.0
    if first == "first-order":
        dynamics = Dynamics(1, time=n["time_constant"])
    elif first.startswith("rod"):
        scale, dynamics = rod(n, 1.0 / n["stack_length"])
    elif first != "static":
        dynamics = oscillator(n)
    gain, curve = n["gain"], tuple(scale * n[f"asymmetry_{j}"] for j in range(2, counts.get("asymmetry", 1) + 1))
    if "play" in counts or "maxwell-slip" in counts:
        word, count = ("play", counts["play"]) if "play" in counts else ("stop", counts["maxwell-slip"])
        weights = numbered(n, word, count)
        thresholds = [n[f"{word}_range"] * j / count for j in range(1, count + 1)]
        gain = gain + sum(weights) if word == "play" else gain
        hysteresis = Elements([scale * b for b in weights], thresholds, scale * gain, curve)
    elif "bouc-wen" in counts:
        c = n["hysteresis"]
        hysteresis = BoucWen(scale * (gain + c), curve, scale * c, 1.0, n["beta"], n["gamma"])
    else:
        hysteresis = Elements([], [], scale * gain, curve)
    creep = [(n[f"creep_{j}"], n["creep_time"] * 10.0 ** (j - 1)) for j in range(1, counts.get("creep", 0) + 1)]
    return Stack(dynamics, hysteresis, creep, scale)


def with_count(word: str) -> str:
    """A part's name with its count, which bouc-wen has not."""
    return word if word[-1].isdigit() else f"{word}-1"


def stack_of(kind: str, n: dict[str, float]) -> Stack:
    """A stack by the name of its kind and its numbers."""
    if kind == "static":
        return Stack(STATIC, Elements([], [], n["gain"]))
    if kind == "second-order":
        return Stack(oscillator(n), Elements([], [], n["gain"]))
    if kind == "creep":
        # One element a decade (4.2).
        creep = [(n["creep"], n["creep_time"] * decade) for decade in (1.0, 10.0, 100.0)]
        return Stack(oscillator(n), Elements([], [], n["gain"]), creep, n["gain"])
    if kind == "maxwell-slip":
        weights = [n["gain"] * share for share in numbered(n, "share", 4)]
        return Stack(oscillator(n), Elements(weights, numbered(n, "threshold", 4), n["gain"]))
    if kind == "bouc-wen":
        loop = BoucWen(n["gain"], (), 1.0, n["alpha"] * n["gain"], n["beta"], n["gamma"])
        return Stack(oscillator(n), loop)
    if kind == "distributed-rod":
        gain, mode = rod(n, n["strain"])
        return Stack(mode, Elements([], [], gain))
    assert kind.partition(":")[0] == "composed", kind
    return composed(kind.partition(":")[2] or "second-order+play-3+asymmetry-3+creep-2", n)
