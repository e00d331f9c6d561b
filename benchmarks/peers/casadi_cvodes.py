"""CasADi: CVODES of SUNDIALS on each cycle, the switches as `if_else`, with its own forward sensitivities.

The integrator is started anew at each drop, but knows nothing of the switches between.  Where the
velocity passes zero its sensitivities miss what the shift of that time does to the solution.
"""

import dataclasses
import functools
import importlib
from typing import Any

import numpy as np

from ..problem import NAMES, PARAMETERS, Problem
from .base import AbstractPeer, Prepared, ladder, not_installed, warmed
from .scipy_lsoda import RATE

_STATES = 5
_MOST_STEPS = 200_000


@dataclasses.dataclass(frozen=True)
class CasADiCVODES(AbstractPeer):
    """`casadi.integrator("cvodes")`; the Jacobian is that of its forward mode."""

    tolerances: tuple[float, ...] = ladder(1e-5, 1e-8)
    jacobian_tolerances: tuple[float, ...] = ladder(1e-6, 1e-7, 1)

    @property
    def name(self) -> str:
        return "CasADi CVODES"

    def missing(self) -> str | None:
        return not_installed(["casadi"])

    def trajectory(self, problem: Problem) -> Prepared:
        run = lambda p, tolerance: np.asarray(_functions(problem, tolerance)[0](p)).ravel()
        return warmed(run, self.tolerances[0])

    def jacobian(self, problem: Problem) -> Prepared:
        run = lambda p, tolerance: np.asarray(_functions(problem, tolerance)[1](p)) * p
        return warmed(run, self.jacobian_tolerances[0])


def field(casadi: Any, time, state, p, voltage: float, frequency: float):
    """The coupled equations in um and um times `RATE`, as a user of CasADi writes them."""
    y, w, _, w_e, z = (state[i] for i in range(_STATES))
    u = voltage * frequency * time
    v = (w - w_e) * RATE
    s0, s1, f_ss = (casadi.if_else(v >= 0, p[k], p[k + 1]) for k in (4, 6, 8))
    rate = v - s0 * casadi.fabs(v) / (1e6 * f_ss) * z
    force = s0 * z + s1 * rate
    push = p[0] ** 2 * (1e6 * p[2] * u - y) - 2.0 * p[1] * p[0] * w * RATE
    return casadi.vertcat(w * RATE, push / RATE, w_e * RATE, force / p[3] / RATE, rate)


@functools.cache
def _functions(problem: Problem, tolerance: float) -> tuple[Any, Any]:
    """Trajectory and Jacobian: the tolerance is part of what CasADi builds."""
    casadi: Any = importlib.import_module("casadi")
    count = (problem.samples - 1) // problem.cycles
    if count * problem.cycles + 1 != problem.samples:
        raise ValueError(f"Expected as many samples in each cycle, found {problem.samples} in {problem.cycles} cycles.")
    time, state, p = casadi.SX.sym("t"), casadi.SX.sym("x", _STATES), casadi.SX.sym("p", len(PARAMETERS))
    rates = field(casadi, time, state, p, problem.voltage, problem.frequency)
    stops = np.arange(1, count + 1) / (count * problem.frequency)
    options = {"reltol": tolerance, "abstol": tolerance, "max_num_steps": _MOST_STEPS}
    cycle = casadi.integrator("cycle", "cvodes", {"t": time, "x": state, "p": p, "ode": rates}, 0, stops, options)
    q, at, parts = casadi.MX.sym("q", len(NAMES)), casadi.MX(_STATES, 1), [casadi.MX(1, 1)]
    for _ in range(problem.cycles):
        found = cycle(x0=at, p=q)["xf"]
        parts.append(found[2, :].T)
        at = found[:, -1]
    whole = casadi.vertcat(*parts)
    # ad_weight 0: forward sensitivities, ten of them, rather than one adjoint run a sample.
    slopes = casadi.jacobian(whole, q, {"helper_options": {"ad_weight": 0}})
    return casadi.Function("run", [q], [whole]), casadi.Function("slopes", [q], [slopes])


PEERS = (CasADiCVODES(),)
