"""
How steep a flank has to be
===========================

An amplifier takes its time. As long as the voltage falls much faster than the platform can follow, the step does not
change; once the fall takes longer than a period of the stack's resonance (here 0.93 ms), less and less of the stroke
is slipped, until the end-effector rides back with the platform.
"""

import jax

jax.config.update("jax_enable_x64", True)
import matplotlib.pyplot as plt
import numpy as np

import pdssjax
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.friction.anisotropic_lugre import AnisotropicLuGre
from pdssjax.piezo.second_order import SecondOrder

actuator = pdssjax.Actuator(SecondOrder(), AnisotropicLuGre())
falls = np.geomspace(2e-5, 2e-2, 60)


def net_step(voltage, fall_time):
    """Of a steady cycle [m]."""
    drive = Sawtooth(voltage, 20.0, fall_time=fall_time)
    return -pdssjax.steady_cycle(actuator, drive).gain[0]


mapped = jax.jit(jax.vmap(net_step, (None, 0)))  # over fall times

figure, axes = plt.subplots(figsize=(6.5, 3.4), layout="constrained")
for voltage in (32.0, 64.0, 96.0):
    axes.semilogx(1e3 * falls, 1e6 * mapped(voltage, falls), label=f"{voltage:g} V")
axes.axvline(2e3 * np.pi / 6736.0, color="0.6", linestyle="--")
axes.text(2e3 * np.pi / 6736.0, 9.0, "  period of the resonance", color="0.4")
axes.set_xlabel("fall time (ms)")
axes.set_ylabel("net step (um)")
axes.legend(loc="center right")
