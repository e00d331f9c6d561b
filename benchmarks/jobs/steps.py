"""Steps and events of a 5 Hz cycle, and the accuracy that they buy."""

import dataclasses

import jax
import jax.numpy as jnp

from pdssjax.expansion import Taylor
from pdssjax.integration import Accuracy
from pdssjax.simulation import simulate

from ..measure import Effort, Outcome
from ..peers.base import ladder
from ..problem import NAMES, PARAMETERS, UM, EveryCycle, Problem, actuator, effector, reference

TARGET = 1e-3
"""[um]"""
_ORDERS = (8, 10, 12, 16)


@dataclasses.dataclass(frozen=True)
class _Counter:
    """Errors and counts of pdssjax at any tolerance, compiled once for an order."""

    order: int

    def __post_init__(self):
        whole, early = Problem(), Problem(cycles=3, samples=601)
        drive = EveryCycle(whole.voltage, whole.frequency)

        def run(tolerance, rest):
            accuracy = Accuracy(tolerance, rest, Taylor(self.order))
            one, two = (simulate(actuator(PARAMETERS), drive, p.times, accuracy) for p in (whole, early))
            laps = whole.cycles - early.cycles
            counts = {name: (getattr(one, name) - getattr(two, name)) / laps for name in ("steps", "rejected", "events")}
            return one.effector * UM, counts

        def slopes(tolerance, rest):
            accuracy = Accuracy(tolerance, rest, Taylor(self.order))
            logarithmic = lambda q: effector(PARAMETERS * jnp.exp(q), whole, accuracy, drive)
            return jax.jacfwd(logarithmic)(jnp.zeros(len(NAMES)))

        object.__setattr__(self, "run", jax.jit(run))
        object.__setattr__(self, "slopes", jax.jit(slopes))

    def at(self, tolerance: float, rest: float) -> dict[str, float]:
        """Counts of a cycle, once it repeats, and errors of the whole record."""
        right = reference(Problem())
        trajectory, counts = self.run(tolerance, rest)  # pyright: ignore[reportAttributeAccessIssue]
        counted = {name: round(float(value), 1) for name, value in counts.items()}
        jacobian = right.jacobian_error(self.slopes(tolerance, rest))  # pyright: ignore[reportAttributeAccessIssue]
        errors = {"error_um": right.error(trajectory), "jacobian_error": jacobian}
        return {"order": self.order, "tolerance_m": tolerance, "rest_m": rest} | counted | errors


def measure(effort: Effort) -> Outcome:
    """Counts at the loosest accuracies that keep `TARGET`, and at the default."""
    rows = {}
    usual = Accuracy()
    for order in _ORDERS:
        effort.report(f"steps: order {order}")
        counter = _Counter(order)
        found = None
        for tolerance in ladder(1e-8, 1e-11):
            row = counter.at(tolerance, tolerance)
            found = None if row["error_um"] > TARGET else found or row
        rows[f"order {order}"] = found
        if order == getattr(usual.method, "order", None):
            rows["default"] = counter.at(usual.tolerance, usual.rest)
    return Outcome([], facts={"steps": rows}, lines=[_sentence(name, row) for name, row in rows.items() if row])


def _sentence(name: str, row: dict[str, float]) -> str:
    what = "the default accuracy" if name == "default" else f"order {row['order']}, the loosest that keeps {TARGET:g} um"
    return (
        f"{what}: {row['steps']:g} steps a cycle, {row['rejected']:g} rejected, {row['events']:g} events "
        f"(tolerance {row['tolerance_m']:.1e} m, rest {row['rest_m']:.1e} m); "
        f"error {row['error_um']:.1e} um, worst Jacobian column {row['jacobian_error']:.1e}"
    )

