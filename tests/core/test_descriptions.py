"""Models show their numbers with units."""

import jax
import numpy as np

import pdssjax
from pdssjax.drive.sampled import Sampled
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.friction.simplified_lugre import SimplifiedLuGre
from pdssjax.piezo.second_order import SecondOrder


def test_models_show_values_and_units():
    assert repr(pdssjax.Effector(0.1)) == "Effector(mass=0.1 kg, load=0 N, tilt=0 rad)"
    assert "gain=1.007e-07 m/V, natural_frequency=6736 rad/s" in repr(SecondOrder())
    assert "direction=backward" in repr(Sawtooth(direction="backward"))
    shown = repr(pdssjax.Actuator(SecondOrder(), SimplifiedLuGre(), pdssjax.Effector(0.086)))
    assert "friction=SimplifiedLuGre(sigma0=" in shown and "effector=Effector(mass=0.086 kg" in shown
    assert "amplifier=None" in shown


def test_arrays_and_traced_numbers_show_their_shapes():
    assert "times=f64[2]" in repr(Sampled(np.array([0.0, 1.0]), np.array([0.0, 1.0])))
    shown = []
    jax.jit(lambda drive: shown.append(repr(drive)))(Sawtooth())
    assert shown[0].startswith("Sawtooth(voltage=")
