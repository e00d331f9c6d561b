"""Event-located integration of hybrid systems, with right derivatives.

Knows no actuator: a system tells its field, its guards and its resets.  Imports only `core`.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .accuracy import ROUNDING as ROUNDING
    from .accuracy import TIGHT as TIGHT
    from .accuracy import Accuracy as Accuracy
    from .closed_form import exact_states_at as exact_states_at
    from .closed_form import is_closed as is_closed
    from .event_location import LOOK_AHEAD as LOOK_AHEAD
    from .failure import FAILURES as FAILURES
    from .forward_pass import integrate_to_times as integrate_to_times
    from .hybrid_run import RESULTS as RESULTS
    from .hybrid_run import Events as Events
    from .hybrid_run import Solution as Solution
    from .hybrid_run import integrate as integrate
    from .hybrid_system import HybridSystem as HybridSystem
    from .periodic_orbit import SHORT as SHORT
    from .periodic_orbit import moved_orbit as moved_orbit
    from .restart import flat as flat
    from .restart import restarted as restarted
    from .solution import SteppedRun as SteppedRun
    from .solution import integrate_steps as integrate_steps
    from .solution import states_at as states_at
    from .solver_names import SOLVERS as SOLVERS
    from .solver_names import TAYLOR as TAYLOR
    from .solver_names import accuracy_with as accuracy_with
    from .solver_names import step_method as step_method
    from .steady_cycle import PERIODS as PERIODS
    from .steady_cycle import Cycles as Cycles
    from .steady_cycle import integrate_cycles as integrate_cycles
    from .steady_motion import GRAZES as GRAZES
    from .steady_motion import SteadyState as SteadyState
    from .steady_motion import steady_state as steady_state
    from .step_methods.base import AbstractStepMethod as AbstractStepMethod
    from .step_methods.diffrax_solver import OneStep as OneStep
    from .step_methods.picard import Picard as Picard
    from .step_methods.taylor import Taylor as Taylor
    from .system import SETTLED as SETTLED
    from .system import AbstractHybridSystem as AbstractHybridSystem
    from .system import Visited as Visited
    from .system import unflattener as unflattener
    from .taylor_series import N as N
    from .taylor_series import N_co as N_co
    from .taylor_series import Term as Term
    from .taylor_series import constant as constant
    from .taylor_series import cosine_and_sine as cosine_and_sine
    from .taylor_series import exp as exp
    from .taylor_series import power as power
    from .taylor_series import weighted as weighted
    from .taylor_solver import TaylorSolver as TaylorSolver
    from .visited_states import visit as visit
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(
        __name__,
        {
            "accuracy": ["Accuracy", "ROUNDING", "TIGHT"],
            "closed_form": ["exact_states_at", "is_closed"],
            "event_location": ["LOOK_AHEAD"],
            "failure": ["FAILURES"],
            "forward_pass": ["integrate_to_times"],
            "hybrid_run": ["Events", "RESULTS", "Solution", "integrate"],
            "hybrid_system": ["HybridSystem"],
            "periodic_orbit": ["SHORT", "moved_orbit"],
            "restart": ["flat", "restarted"],
            "solution": ["SteppedRun", "integrate_steps", "states_at"],
            "solver_names": ["SOLVERS", "TAYLOR", "accuracy_with", "step_method"],
            "steady_cycle": ["Cycles", "PERIODS", "integrate_cycles"],
            "steady_motion": ["GRAZES", "SteadyState", "steady_state"],
            "step_methods.base": ["AbstractStepMethod"],
            "step_methods.diffrax_solver": ["OneStep"],
            "step_methods.picard": ["Picard"],
            "step_methods.taylor": ["Taylor"],
            "system": ["AbstractHybridSystem", "SETTLED", "Visited", "unflattener"],
            "taylor_series": ["N", "N_co", "Term", "constant", "cosine_and_sine", "exp", "power", "weighted"],
            "taylor_solver": ["TaylorSolver"],
            "visited_states": ["visit"],
        },
    )
