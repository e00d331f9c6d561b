"""Differentiable models and joint identification of piezoelectric stick-slip actuators."""

from typing import TYPE_CHECKING

from .core.presentation import present_with

if TYPE_CHECKING:
    from .actuator import (
        Actuator as Actuator,
        Amplifier as Amplifier,
        Effector as Effector,
        Sensor as Sensor,
        Stop as Stop,
    )
    from .core import InputError as InputError, InputWarning as InputWarning, prepare_jax as prepare_jax
    from .design import (
        Aim as Aim,
        Limits as Limits,
        Plan as Plan,
        Resources as Resources,
        design_experiment as design_experiment,
    )
    from .drive.base import AbstractDrive as AbstractDrive
    from .files import characterise as characterise, compare as compare, load_study as load_study
    from .friction.base import AbstractFriction as AbstractFriction
    from .inference import (
        BoundedLevenbergMarquardt as BoundedLevenbergMarquardt,
        Drawing as Drawing,
        FitInterrupted as FitInterrupted,
        identify as identify,
        initial_guess as initial_guess,
        pose_problem as pose_problem,
    )
    from .integration import (
        AbstractHybridSystem as AbstractHybridSystem,
        AbstractStepMethod as AbstractStepMethod,
        Accuracy as Accuracy,
        OneStep as OneStep,
        Taylor as Taylor,
        TaylorSolver as TaylorSolver,
    )
    from .piezo.base import AbstractPiezo as AbstractPiezo
    from .selection import Comparison as Comparison
    from .simulation import simulate as simulate, steady_cycle as steady_cycle, vector_field as vector_field
    from .study import (
        AbstractMeasurement as AbstractMeasurement,
        Estimate as Estimate,
        Record as Record,
        Study as Study,
    )
    from .sweeps import sweep as sweep
else:
    # Loaded on first use: JAX and its solvers take a second, for which `pdssjax --help` need not wait.
    from .core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(__name__)

present_with("pdssjax.report.presenter")  # results show themselves in a notebook through it
