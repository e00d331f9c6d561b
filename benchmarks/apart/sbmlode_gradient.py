"""The walk of `benchmarks.gradient` by the diffrax code that sbmlode writes, in an environment of its own.

Imports nothing of pdssjax.  Reads voltage, frequency, cycles, parameters and tolerance as JSON from the command line;
prints the end-effector's place at the end [um], its derivatives by the logarithms, and the seconds as JSON.
"""

import importlib.util
import json
import sys
import tempfile
from pathlib import Path

import jax.numpy as jnp
import libsbml  # pyright: ignore[reportMissingImports]
from sbmlode import OdeSystem  # pyright: ignore[reportMissingImports]
from timed_gradient import tell

NAMES = tuple("omega damping gain mass s0_a s0_b s1_a s1_b f_ss_a f_ss_b".split())
RATES = {
    "y": "w * 1e3",
    "w": "(omega^2 * (1e6 * gain * voltage * (frequency * time - drops) - y) - 2 * damping * omega * w * 1e3) / 1e3",
    "x_e": "w_e * 1e3",
    "w_e": "(stiffness * z + viscosity * bristle) / mass / 1e3",
    "z": "bristle",
}
"""Speeds are in um times 1e3 a second, so that all states are of like size."""
ASSIGNED = {
    "slip": "(w - w_e) * 1e3",
    "stiffness": "piecewise(s0_a, sense > 0, s0_b)",
    "viscosity": "piecewise(s1_a, sense > 0, s1_b)",
    "limit": "piecewise(f_ss_a, sense > 0, f_ss_b)",
    "bristle": "slip - stiffness * slip * sense / (1e6 * limit) * z",
}
EVENTS = {
    "drop": ("time >= (drops + 1) / frequency", {"drops": "drops + 1"}),
    "reversal": ("(w - w_e) * sense < 0", {"sense": "-sense"}),
}


def sbml(constants: dict[str, float]) -> libsbml.SBMLDocument:
    """The model: the sense of sliding is a parameter that changes where the relative speed passes zero."""
    document = libsbml.SBMLDocument(3, 2)
    model = document.createModel()
    model.setId("walk")
    for name, value in {**constants, "drops": 0.0, "sense": 1.0, **dict.fromkeys(RATES, 0.0)}.items():
        parameter = model.createParameter()
        parameter.setId(name)
        parameter.setValue(value)
        parameter.setConstant(name in constants)
    for name in ASSIGNED:
        parameter = model.createParameter()
        parameter.setId(name)
        parameter.setConstant(False)
    for make, formulas in ((model.createAssignmentRule, ASSIGNED), (model.createRateRule, RATES)):
        for name, formula in formulas.items():
            rule = make()
            rule.setVariable(name)
            rule.setMath(libsbml.parseL3Formula(formula))
    for name, (condition, changes) in EVENTS.items():
        event = model.createEvent()
        event.setId(name)
        event.setUseValuesFromTriggerTime(True)
        trigger = event.createTrigger()
        trigger.setInitialValue(True)
        trigger.setPersistent(True)
        trigger.setMath(libsbml.parseL3Formula(condition))
        for changed, formula in changes.items():
            assignment = event.createEventAssignment()
            assignment.setVariable(changed)
            assignment.setMath(libsbml.parseL3Formula(formula))
    return document


def written(document: libsbml.SBMLDocument, folder: Path):
    """The module that sbmlode writes of a model."""
    file = folder / "walk.py"
    OdeSystem.from_sbml(document).write(file, fmt="diffrax")
    made = importlib.util.spec_from_file_location("walk", file)
    assert made is not None and made.loader is not None
    module = importlib.util.module_from_spec(made)
    made.loader.exec_module(module)
    return module


def main() -> None:
    asked = json.loads(sys.argv[1])
    numbers = dict(zip(NAMES, asked["parameters"], strict=True))
    constants = numbers | {"voltage": asked["voltage"], "frequency": asked["frequency"]}
    with tempfile.TemporaryDirectory() as folder:
        walk = written(sbml(constants), Path(folder))
    import diffrax

    places = jnp.array([walk.PIDS.index(name) for name in NAMES])
    adjoint = diffrax.ForwardMode() if asked["mode"] == "forward" else diffrax.RecursiveCheckpointAdjoint()
    times = jnp.array([0.0, asked["cycles"] / asked["frequency"]])

    def end(logarithms):
        p = walk.P0.at[places].set(walk.P0[places] * jnp.exp(logarithms))
        limits = dict(rtol=asked["tolerance"], atol=asked["tolerance"], max_step=2e-3, max_steps=20_000)
        simulation = walk.simulate(times, p, solver=diffrax.Tsit5(), adjoint=adjoint, **limits)
        return simulation.x[-1, walk.XIDS.index("x_e")]

    tell(end, asked["mode"], len(NAMES))


if __name__ == "__main__":
    main()
