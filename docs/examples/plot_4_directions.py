"""
One surface, two directions
===========================

The net step of a steady cycle against the voltage, driven either way. The anisotropic surface holds better in one
direction, so the same drive makes steps of different lengths. Below 36 V it even decides alone: the end-effector walks
forward, whichever way it is driven.
"""

import jax

jax.config.update("jax_enable_x64", True)
import matplotlib.pyplot as plt
import numpy as np

import pdssjax
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.friction.anisotropic_lugre import AnisotropicLuGre
from pdssjax.piezo.second_order import SecondOrder


def net_step(voltage, direction):
    """Of a steady cycle [m], and its derivative by the voltage [m/V]."""
    actuator = pdssjax.Actuator(SecondOrder(), AnisotropicLuGre())

    def step(volts):
        drive = Sawtooth(volts, 20.0, direction=direction)
        return -pdssjax.steady_cycle(actuator, drive).gain[0]

    return jax.value_and_grad(step)(voltage)


# %%
# ``steady_cycle`` gives what the state gains in a cycle, without stepping through the transient; its first component is
# the platform's displacement less the end-effector's. It maps over voltages, and has derivatives.

voltages = np.linspace(2.0, 80.0, 40)
figure, (steps, slopes) = plt.subplots(1, 2, figsize=(8.0, 3.2), layout="constrained")
mapped = jax.jit(jax.vmap(net_step, (0, None)))  # over voltages
for name, direction in (("forward", 1.0), ("backward", -1.0)):
    found, by_voltage = mapped(voltages, direction)
    steps.plot(voltages, 1e6 * found, label=f"driven {name}")
    slopes.plot(voltages, 1e9 * by_voltage, label=f"driven {name}")
steps.set_ylabel("net step (um)")
slopes.set_ylabel("slope (nm/V)")
steps.legend()
for axes in (steps, slopes):
    axes.axhline(0.0, color="0.7", linewidth=0.8)
    axes.set_xlabel("voltage (V)")
