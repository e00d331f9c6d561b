"""
Stick, slip, ring-down
======================

One cycle of the thesis's actuator under a sawtooth of 64 V and 5 Hz: on the slow flank the end-effector rides on the
platform, at the drop of the voltage it slips, and what it keeps of the stroke is its step.
"""

import jax

jax.config.update("jax_enable_x64", True)  # pdssjax needs double precision
import matplotlib.pyplot as plt
import numpy as np

import pdssjax
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.friction.anisotropic_lugre import AnisotropicLuGre
from pdssjax.piezo.second_order import SecondOrder

actuator = pdssjax.Actuator(SecondOrder(), AnisotropicLuGre())
run = pdssjax.simulate(actuator, Sawtooth(64.0, 5.0), np.linspace(0.0, 0.6, 60001))

figure, (whole, slip) = plt.subplots(1, 2, figsize=(8.0, 3.2), layout="constrained")
near = (run.time > 0.199) & (run.time < 0.206)
for axes, part in ((whole, slice(None)), (slip, near)):
    axes.plot(1e3 * run.time[part], 1e6 * run.platform[part], label="platform")
    axes.plot(1e3 * run.time[part], 1e6 * run.effector[part], label="end-effector")
    axes.set_xlabel("time (ms)")
whole.set_ylabel("displacement (um)")
whole.set_title("three cycles")
whole.legend()
slip.set_title("the first slip")

# %%
# During the slip the platform rings at its resonance, and the contact is dragged back and forth with it: the friction
# force changes its sign at every reversal of their relative motion, and the integrator locates each of them.

figure, axes = plt.subplots(figsize=(8.0, 2.4), layout="constrained")
axes.plot(1e3 * run.time[near], run.friction[near], color="tab:red")
axes.axhline(0.0, color="0.7", linewidth=0.8)
axes.set_xlabel("time (ms)")
axes.set_ylabel("friction (N)")
print(f"{int(run.events)} reversals located, in {int(run.steps)} steps")
