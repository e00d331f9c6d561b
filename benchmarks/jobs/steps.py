"""Steps and events of a 5 Hz cycle, and the accuracy that they buy."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from pdssjax import AbstractStepMethod, Accuracy, Taylor, simulate

from ..measure import Effort, Outcome
from ..peers.base import ladder
from ..problem import NAMES, PARAMETERS, UM, EveryCycle, Problem, actuator, effector, reference

TARGET = 1e-3
"""[um]"""
_ORDERS = (8, 12)
_COUNTS = ("steps", "rejected", "events")


def measure(effort: Effort) -> Outcome:
    """Counts at the loosest accuracies that keep `TARGET`, and at the default."""
    usual = Accuracy()
    rows: dict[str, dict[str, float]] = {}
    for order in _ORDERS:
        effort.report(f"steps: order {order}")
        counted = _counter(Taylor(order))
        for tolerance in ladder(1e-8, 1e-11):
            row = counted(tolerance, tolerance)
            if row["error_um"] > TARGET:
                rows.pop(f"order {order}", None)
            else:
                rows.setdefault(f"order {order}", row)
    effort.report("steps: default accuracy")
    rows["default"] = _counter(usual.method)(float(usual.tolerance), float(usual.settle_tolerance))
    rows["default"]["jacobian_error"] = _default_jacobian_error()
    return Outcome([], facts={"steps": rows}, lines=[_sentence(name, row) for name, row in rows.items()])


def _counter(method: AbstractStepMethod) -> Callable[[float, float], dict[str, float]]:
    """Steps, rejections and events of a cycle once it repeats, and the error of the whole record."""
    whole, early = Problem(), Problem(cycles=3)
    drive = EveryCycle(whole.voltage, whole.frequency)

    @jax.jit
    def run(tolerance, rest, times):
        return simulate(actuator(PARAMETERS), drive, times, Accuracy(tolerance, rest, method))

    def at(tolerance: float, rest: float) -> dict[str, float]:
        late, soon = (run(tolerance, rest, problem.times) for problem in (whole, early))
        laps = whole.cycles - early.cycles
        counts = {name: (int(getattr(late, name)) - int(getattr(soon, name))) / laps for name in _COUNTS}
        return (
            {"tolerance_m": tolerance, "rest_m": rest}
            | counts
            | {"error_um": reference(whole).error(UM * np.asarray(late.effector))}
        )

    return at


def _default_jacobian_error() -> float:
    run = lambda q: effector(PARAMETERS * jnp.exp(q), Problem(), Accuracy())
    return reference(Problem()).jacobian_error(jax.jit(jax.jacfwd(run))(jnp.zeros(len(NAMES))))


def _sentence(name: str, row: dict[str, float]) -> str:
    what = "at the default accuracy" if name == "default" else f"with {name}, at the loosest that keeps {TARGET:g} um"
    worst = f", worst Jacobian column {row['jacobian_error']:.1e}" if "jacobian_error" in row else ""
    return (
        f"a 5 Hz cycle {what}: {row['steps']:g} steps, {row['rejected']:g} rejected, {row['events']:g} events "
        f"(tolerance {row['tolerance_m']:.1e} m, rest {row['rest_m']:.1e} m); error {row['error_um']:.1e} um{worst}"
    )
