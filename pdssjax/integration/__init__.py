"""Event-located integration of hybrid systems, with right derivatives.

Knows no actuator: a system tells its field, its guards and its resets.  Imports only `core`.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .accuracy import FAILURES as FAILURES, ROUNDING as ROUNDING, TIGHT as TIGHT, Accuracy as Accuracy
    from .event_location import LOOK_AHEAD as LOOK_AHEAD
    from .forward_pass import (
        empty_table as empty_table,
        find_steps as find_steps,
        integrate_to_times as integrate_to_times,
    )
    from .hybrid_run import RESULTS as RESULTS, Events as Events, Solution as Solution, integrate as integrate
    from .hybrid_system import HybridSystem as HybridSystem
    from .periodic_orbit import SHORT as SHORT, moved_orbit as moved_orbit
    from .restart import flat as flat, restarted as restarted
    from .solution import (
        SteppedRun as SteppedRun,
        exact_states_at as exact_states_at,
        integrate_steps as integrate_steps,
        is_closed as is_closed,
        sample_run as sample_run,
        states_at as states_at,
    )
    from .solver_names import (
        SOLVERS as SOLVERS,
        TAYLOR as TAYLOR,
        accuracy_with as accuracy_with,
        solver_name as solver_name,
        step_method as step_method,
    )
    from .steady_motion import (
        GRAZES as GRAZES,
        PERIODS as PERIODS,
        Cycles as Cycles,
        SteadyState as SteadyState,
        integrate_cycles as integrate_cycles,
        steady_state as steady_state,
    )
    from .step_methods.base import AbstractStepMethod as AbstractStepMethod
    from .step_methods.diffrax_solver import OneStep as OneStep
    from .step_methods.picard import Picard as Picard
    from .step_methods.taylor import Taylor as Taylor
    from .step_table import Table as Table, TakenSteps as TakenSteps
    from .system import (
        SETTLED as SETTLED,
        AbstractHybridSystem as AbstractHybridSystem,
        SampledStates as SampledStates,
        unflattener as unflattener,
    )
    from .taylor_series import (
        N as N,
        N_co as N_co,
        Term as Term,
        constant as constant,
        cosine_and_sine as cosine_and_sine,
        exp as exp,
        power as power,
        weighted as weighted,
    )
    from .taylor_solver import TaylorSolver as TaylorSolver
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(__name__)
