"""
Hysteresis of the stack
=======================

Displacement against voltage, with the hysteresis of Bouc and Wen: the loop grows faster than the voltage. The lower
panel shows what a straight line leaves of it, which is what a fit without hysteresis would have to explain otherwise.
"""

import jax

jax.config.update("jax_enable_x64", True)
import matplotlib.pyplot as plt
import numpy as np

import pdssjax
from pdssjax.drive.sine import Sine
from pdssjax.friction.anisotropic_lugre import AnisotropicLuGre
from pdssjax.piezo.bouc_wen import BoucWen

times = np.linspace(0.0, 4.0, 4001)
figure, (loops, left) = plt.subplots(2, 1, figsize=(5.5, 5.0), layout="constrained", sharex=True)
for voltage in (60.0, 40.0, 20.0):
    drive = Sine(voltage, 1.0)
    run = pdssjax.simulate(pdssjax.Actuator(BoucWen(), AnisotropicLuGre()), drive, times)
    last = run.time >= 3.0
    volts, microns = np.asarray(run.voltage)[last], 1e6 * np.asarray(run.platform)[last]
    loops.plot(volts, microns, label=f"{voltage:g} V")
    left.plot(volts, microns - np.polyval(np.polyfit(volts, microns, 1), volts))
loops.set_ylabel("displacement (um)")
loops.legend()
left.set_ylabel("less a line (um)")
left.set_xlabel("voltage (V)")
