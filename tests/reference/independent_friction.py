"""The interface of friction laws written from their equations alone: plain floats.

`independent` simulates them on one stack, `combinations` on every stack, amplifier and stop.

A law of the package, `pdssjax/friction/NAME.py`, has its second self in `laws/NAME.py`: one class and CASES, by what
is special of each.
"""

import math
from typing import Any


class Law:
    """A contact: `z` its continuous state, `form` all else it remembers, `d` the relative displacement [m].

    `way` is the sign of the relative velocity `v` [m/s].
    """

    atol: tuple[float, ...] = ()
    """Absolute tolerance of each continuous state."""
    sticks = False
    """At v = 0 it may hold with any force between two bounds."""
    undamped = False
    """It rings on for hundreds of reversals a cycle, and the default accuracy leaves 1.3e-4 N after 500 of them."""

    def born(self) -> Any:
        """The form before anything has moved."""
        return None

    def turned(self, z, form, d, way, v=0.0) -> Any:
        """The form with which a motion in the direction `way` begins at d; it may begin with a jump of v."""
        return form

    def jumped(self, z, form, d, v, way) -> Any:
        """The form after the relative velocity has jumped to v in the direction that it had."""
        return form

    def resting(self, force) -> tuple[list[float], Any]:
        """State and form of a contact that has long rested under a friction force [N], as d = 0 has it."""
        raise NotImplementedError

    def force(self, z, form, d, v, way) -> float:
        """Friction force on the end-effector [N]."""
        raise NotImplementedError

    def flow(self, z, form, d, v, way) -> list[float]:
        """Rates of the continuous state."""
        return []

    def room(self, z, form, d, v, way) -> list[float]:
        """Positive while the form lasts."""
        return []

    def next(self, z, form, d, way, which) -> Any:
        """The form after room number `which` is used up."""
        return form


def curve(v, f_c, f_s, v_s, delta=2.0):
    """The Stribeck curve [N]."""
    return f_c + (f_s - f_c) * math.exp(-(abs(v / v_s) ** delta))
