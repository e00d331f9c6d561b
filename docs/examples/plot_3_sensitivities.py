"""
What each parameter does to a record
====================================

The derivatives of the end-effector's motion by the parameters, each for a change of 1 %. Columns that look alike are
hard to tell apart in a fit; a column that is zero tells nothing. They pass through every reversal of the contact,
whose instant they move.
"""

import jax

jax.config.update("jax_enable_x64", True)
import matplotlib.pyplot as plt
import numpy as np

import pdssjax
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.friction.anisotropic_lugre import AnisotropicLuGre
from pdssjax.piezo.second_order import SecondOrder

names = ("sigma0_a", "sigma0_b", "sigma1_a", "sigma1_b", "f_ss_a", "f_ss_b")
published = {name: getattr(AnisotropicLuGre(), name) for name in names}
times = np.linspace(0.095, 0.115, 2001)


def motion(changes):
    """Of the end-effector [um], the parameters changed by such factors."""
    law = AnisotropicLuGre(**{name: published[name] * changes[name] for name in names})
    return 1e6 * pdssjax.simulate(pdssjax.Actuator(SecondOrder(), law), Sawtooth(64.0, 10.0), times).effector


columns = jax.jit(jax.jacfwd(motion))(dict.fromkeys(names, 1.0))

figure, panels = plt.subplots(3, 2, figsize=(8.0, 5.0), layout="constrained", sharex=True)
for axes, name in zip(panels.flat, names, strict=True):
    axes.plot(1e3 * times, 10.0 * columns[name])  # 1e3 nm/um, 1e-2 for a change of 1 %
    axes.set_title(name, fontsize=9)
for axes in panels[:, 0]:
    axes.set_ylabel("nm per 1 %")
for axes in panels[-1]:
    axes.set_xlabel("time (ms)")
