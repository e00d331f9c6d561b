"""Warns of records that are stepped for so long that their derivatives fill the memory, before it is full."""

import warnings

import jax
import jax.numpy as jnp

from ..core import InputWarning
from ..integration import is_closed
from ..study import Run, Values, with_room
from .problem import Problem

_MUCH = 2e9
"""Bytes that every evaluation may take without a word."""

_A_STEP = 200.0
"""Bytes by step, component and direction: 2.6 GB of 240 000 steps of 6 components in 9 directions were seen."""


def question_lengths(problem: Problem, starts: Values) -> None:
    """Warns with `InputWarning` of records whose derivatives take more than 2 GB.

    What is known in closed form is not stepped.
    """
    residual = problem.residual
    for record in problem.records:
        models, motion = residual.predictor.models, record.motion
        setup = record.measurement.setup(models)
        run = Run(record.drive, jnp.asarray(record.time), None if motion is None else jnp.asarray(motion))
        system = setup.system(models, {**residual.fixed, **starts}, run)
        if is_closed(system):
            continue
        segments, last = setup.segments(record.drive, record.time), float(record.time[-1])
        steps = with_room(residual.accuracy, setup, models, segments, last).max_steps
        directions = 1 + len(residual.transform.paths)
        size = _A_STEP * steps * len(jax.tree.leaves(system.initial())) * directions
        if size > _MUCH:
            warnings.warn(
                f'record "{record.name}": {last:.3g} s of it are stepped, with room for {steps} steps: their '
                f"derivatives take about {1e-9 * size:.1f} GB, where 2 GB are usual. A window shortens a record "
                '(window = ["0 s", "1 s"]); stacks of play or maxwell-slip whose platform is seen alone, by a sensor '
                "without a bandwidth and without an amplifier, need no steps.",
                InputWarning,
                stacklevel=2,
            )
