"""The integrators that a study, a command or `Accuracy` may name."""

from typing import TYPE_CHECKING

from ..core import InputError, nearest

if TYPE_CHECKING:
    from ..core import Given
    from .accuracy import Accuracy
    from .step_methods.base import AbstractStepMethod

TAYLOR = "taylor"
"""The package's own Taylor series, which integrates where nothing else is asked for."""

_DIFFRAX = {
    "bosh3": "Bosh3",
    "dopri5": "Dopri5",
    "dopri8": "Dopri8",
    "kvaerno3": "Kvaerno3",
    "kvaerno4": "Kvaerno4",
    "kvaerno5": "Kvaerno5",
    "tsit5": "Tsit5",
}
"""Solvers of diffrax with an error estimate, by name."""

SOLVERS: tuple[str, ...] = (TAYLOR, *_DIFFRAX)
"""All names."""

_ROOM = 16384
"""Steps that a solver of diffrax may take: of fifth order it needs ten times as many as the series."""


def step_method(solver: "Given") -> "AbstractStepMethod":
    """The step method that `solver` stands for: one of `SOLVERS`, a solver of diffrax, or a step method itself.

    **Raises:** `InputError` for anything else, and for a solver without an error estimate.
    """
    from .step_methods.base import AbstractStepMethod
    from .step_methods.taylor import Taylor

    if isinstance(solver, AbstractStepMethod):
        return solver
    if isinstance(solver, str) and solver == TAYLOR:
        return Taylor()
    import diffrax  # as long as all of JAX, and the package's own method needs none of it

    from .step_methods.diffrax_solver import OneStep

    if isinstance(solver, str):
        if solver not in SOLVERS:
            raise InputError(f'solver: found "{solver}"; {nearest(solver, SOLVERS)}')
        return OneStep(getattr(diffrax, _DIFFRAX[solver])())
    if isinstance(solver, diffrax.AbstractSolver):
        try:
            return OneStep(solver)
        except ValueError as error:
            raise InputError(f"solver: {error}") from None
    raise InputError(
        f"solver: found {solver!r:.80}, expected one of {', '.join(SOLVERS)}, a solver of diffrax with an error "
        "estimate, or a step method such as pdssjax.Taylor()."
    )


def solver_name(method: "AbstractStepMethod") -> str:
    """The name of a step method, as in `SOLVERS` where it is one of those: `step_method` the other way round."""
    from .step_methods.taylor import Taylor

    if isinstance(method, Taylor):
        return TAYLOR
    from .step_methods.diffrax_solver import OneStep

    return type(method.solver if isinstance(method, OneStep) else method).__name__.lower()


def accuracy_with(solver: "Given") -> "Accuracy":
    """The default accuracy by another integrator, with room for the steps that it needs.

    **Raises:** `InputError` as `step_method` does.
    """
    from .accuracy import Accuracy
    from .step_methods.taylor import Taylor

    method = step_method(solver)
    room = {} if isinstance(method, Taylor) else {"max_steps": _ROOM}
    return Accuracy(method=method, **room)
