"""Texts of columns, and the samples of a walk, as files of instruments have them."""

import numpy as np


def text_of(header, *columns):
    return header + "\n" + "".join(",".join(f"{cell:.6f}" for cell in row) + "\n" for row in zip(*columns, strict=True))


def walk_of(volts_per_um, gain=1e-7):
    """A sawtooth of 60 V, 20 Hz, and an end-effector that sticks on its slow flanks, as a sensor in volts shows it."""
    time = 1e-4 * np.arange(6000)
    turn = 20.0 * time
    volts = 60.0 * np.mod(turn, 1.0)
    moved = 1e6 * gain * (volts + 20.0 * np.floor(turn))
    return time, volts, volts_per_um * moved
