"""Sweeps over actuators drawn at random, of any friction law."""

import dataclasses

import numpy as np
from quick_blocks import example_study

from experiments.actuator_structure import Structure
from pdssjax.core import member
from pdssjax.study import Parameter


def random_actuators(law, state, count, slowly=False):
    """A study of a law with its nominal numbers, and by path what is drawn: all of them, drive and direction.

    **Arguments:** transients that die out `slowly` come from a stack with little damping, driven fast.
    """
    structure, random = Structure(friction=law, state=state), np.random.default_rng([9, *law.encode(), *state.encode()])
    changed = dict(friction=member("friction", law), friction_state=state or "deflection", parameters={})
    study = dataclasses.replace(example_study(), **changed)
    legal = study.legal()
    parameters = {
        path: Parameter(path, legal[path].unit, legal[path], value=legal[path].nominal)
        for path in legal
        if path.split(".")[0] in ("piezo", "friction", "effector")
    }
    factors = np.exp(0.4 * random.uniform(-1.0, 1.0, (count, len(structure.nominal))))
    columns = {path: value * factors[:, i] for i, (path, value) in enumerate(structure.nominal.items())}
    columns["drive.voltage"] = random.uniform(8.0, 150.0, count)
    columns["drive.frequency"] = 10 ** random.uniform(0.3, 2.4, count)
    columns["drive.direction"] = random.choice([-1.0, 1.0], count)
    if slowly:
        columns["piezo.damping_ratio"] = 10 ** random.uniform(-2.5, -1.2, count)
        columns["drive.frequency"] = random.uniform(60.0, 250.0, count)
    return dataclasses.replace(study, parameters=parameters), columns
