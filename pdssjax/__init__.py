"""Differentiable models and joint identification of piezoelectric stick-slip actuators."""

from typing import TYPE_CHECKING

from .core.presentation import present_with

if TYPE_CHECKING:
    from .actuator import Actuator as Actuator
    from .actuator import Amplifier as Amplifier
    from .actuator import Effector as Effector
    from .actuator import Sensor as Sensor
    from .actuator import Stop as Stop
    from .core import InputError as InputError
    from .core import InputWarning as InputWarning
    from .core import prepare_jax as prepare_jax
    from .drive.base import AbstractDrive as AbstractDrive
    from .files import characterise as characterise
    from .files import load_study as load_study
    from .friction.base import AbstractFriction as AbstractFriction
    from .inference import BoundedLevenbergMarquardt as BoundedLevenbergMarquardt
    from .inference import Drawing as Drawing
    from .inference import FitInterrupted as FitInterrupted
    from .inference import identify as identify
    from .inference import initial_guess as initial_guess
    from .inference import pose_problem as pose_problem
    from .integration import AbstractHybridSystem as AbstractHybridSystem
    from .integration import AbstractStepMethod as AbstractStepMethod
    from .integration import Accuracy as Accuracy
    from .integration import OneStep as OneStep
    from .integration import Taylor as Taylor
    from .integration import TaylorSolver as TaylorSolver
    from .piezo.base import AbstractPiezo as AbstractPiezo
    from .simulation import simulate as simulate
    from .simulation import steady_cycle as steady_cycle
    from .simulation import vector_field as vector_field
    from .study import AbstractMeasurement as AbstractMeasurement
    from .study import Estimate as Estimate
    from .study import Record as Record
    from .study import Study as Study
    from .sweeps import sweep as sweep
else:
    # Loaded on first use: JAX and its solvers take a second, for which `pdssjax --help` need not wait.
    from .core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(
        __name__,
        {
            "actuator": ["Actuator", "Amplifier", "Effector", "Sensor", "Stop"],
            "core": ["InputError", "InputWarning", "prepare_jax"],
            "drive.base": ["AbstractDrive"],
            "files": ["characterise", "load_study"],
            "friction.base": ["AbstractFriction"],
            "inference": [
                "BoundedLevenbergMarquardt",
                "Drawing",
                "FitInterrupted",
                "identify",
                "initial_guess",
                "pose_problem",
            ],
            "integration": [
                "AbstractHybridSystem",
                "AbstractStepMethod",
                "Accuracy",
                "OneStep",
                "Taylor",
                "TaylorSolver",
            ],
            "piezo.base": ["AbstractPiezo"],
            "simulation": ["simulate", "steady_cycle", "vector_field"],
            "study": ["AbstractMeasurement", "Estimate", "Record", "Study"],
            "sweeps": ["sweep"],
        },
    )

present_with("pdssjax.report.presenter")  # results show themselves in a notebook through it
