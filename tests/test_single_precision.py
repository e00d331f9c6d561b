"""Single precision is refused at every public entrance, by its name: no event can be located in it."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
import pytest
from parts import Coulomb, Sawtooth, SecondOrder
from platform_study import write_platform

import pdssjax
from pdssjax import Accuracy, Actuator, InputError
from pdssjax.integration import HybridSystem, integrate, integrate_steps, sample_run
from pdssjax.simulation import StickSlip

TIMES = np.linspace(0.0, 5e-3, 6)
"""[s]"""


class Decay(HybridSystem):
    """Goes down."""

    def vector_field(self, t, y, args, mode):
        return -y


def by_diffrax():
    term = diffrax.ODETerm(lambda t, y, args: -y)
    diffrax.diffeqsolve(term, pdssjax.TaylorSolver(), 0.0, 1.0, 0.1, jnp.ones(()))


def by_optimistix():
    solver = pdssjax.BoundedLevenbergMarquardt(rtol=1e-8)
    optimistix.least_squares(lambda y, args: y - 1.0, solver, jnp.zeros(2))


def moved():
    """An actuator and its drive."""
    return Actuator(SecondOrder(), Coulomb()), Sawtooth(voltage=64.0, frequency=400.0)


ENTRANCES = {
    "simulate": lambda study: pdssjax.simulate(*moved(), TIMES),
    "steady_cycle": lambda study: pdssjax.steady_cycle(*moved()),
    "vector_field": lambda study: pdssjax.vector_field(*moved()),
    "predict": lambda study: study.predict(),
    "initial_guess": pdssjax.initial_guess,
    "pose_problem": pdssjax.pose_problem,
    "identify": pdssjax.identify,
    "sweep": lambda study: pdssjax.sweep(study, {"drive.voltage": [1.0, 2.0]}),
    "integrate": lambda study: integrate(Decay(), 0.0, 1.0, 1.0),
    "pdssjax.integration": lambda study: integrate_steps(StickSlip(*moved()), 5e-3, Accuracy()),
    "TaylorSolver": lambda study: by_diffrax(),
    "BoundedLevenbergMarquardt": lambda study: by_optimistix(),
}


@pytest.mark.parametrize("name", ENTRANCES)
def test_an_entrance_refuses_it_by_name(name, tmp_path):
    study = pdssjax.load_study(write_platform(tmp_path))
    with jax.enable_x64(False), pytest.raises(InputError, match=f"^{name}: found JAX in single precision"):
        ENTRANCES[name](study)


def test_so_does_every_run_of_an_integrator():
    with jax.enable_x64(False), pytest.raises(InputError, match=r"pdssjax\.integration: found JAX in single"):
        sample_run(StickSlip(*moved()), jnp.asarray(TIMES), Accuracy())
