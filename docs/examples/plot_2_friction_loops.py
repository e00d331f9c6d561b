"""
Loops of presliding
===================

Before a contact slides it gives way like a spring that forgets: its force over its displacement goes around a loop,
and the wider the motion, the more of it is lost as heat. Here the platform is driven slowly by sines of growing
voltage; on the anisotropic surface the loop is not symmetric, since the surface holds better one way.
"""

import jax

jax.config.update("jax_enable_x64", True)
import matplotlib.pyplot as plt
import numpy as np

import pdssjax
from pdssjax.drive.sine import Sine
from pdssjax.friction.anisotropic_lugre import AnisotropicLuGre
from pdssjax.friction.coulomb import Coulomb
from pdssjax.friction.dahl import Dahl
from pdssjax.piezo.second_order import SecondOrder

laws = {"anisotropic LuGre": AnisotropicLuGre(), "Dahl": Dahl(), "Coulomb": Coulomb()}
# The effector is so heavy that it stays where it is: what moves is the contact.
held = pdssjax.Effector(mass=1e9)
times = np.linspace(0.0, 2.0, 4001)

figure, panels = plt.subplots(1, 3, figsize=(9.0, 3.2), layout="constrained", sharey=True)
for axes, (name, law) in zip(panels, laws.items(), strict=True):
    for voltage in (10.0, 20.0, 40.0):
        run = pdssjax.simulate(pdssjax.Actuator(SecondOrder(), law, held), Sine(voltage, 1.0), times)
        second = run.time >= 1.0
        axes.plot(1e6 * (run.platform - run.effector)[second], run.friction[second], label=f"{voltage:g} V")
    axes.set_title(name)
    axes.set_xlabel("platform less end-effector (um)")
panels[0].set_ylabel("friction (N)")
figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
