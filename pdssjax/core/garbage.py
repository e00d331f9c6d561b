"""How often Python looks for garbage."""

import gc

_OBJECTS = 100_000
"""Made, and not yet deleted, before Python looks for cycles among them; by default a few hundred."""


def seldom_look_for_garbage() -> None:
    """For programs: JAX, when it is imported and when it traces, makes objects by the hundred thousand.

    Nearly all of them stay: to look through them again and again is a tenth of the time to the first result.
    """
    gc.set_threshold(max(_OBJECTS, gc.get_threshold()[0]))
