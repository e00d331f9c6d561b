"""Plans of a small rig: what they promise is what a fit of their records has, and what nothing sees is named."""

import dataclasses

import numpy as np
import pytest
from fabricated_plan import SOURCE

import pdssjax
from pdssjax import Aim, InputError, Limits, Resources, design_experiment
from pdssjax.design import rehearse
from pdssjax.inference import pose

LIMITS = Limits(
    kinds=("platform",),
    waveforms=("step", "sawtooth"),
    voltage=(20.0, 60.0),
    frequency=(10.0, 40.0),
    interval=1e-4,
    duration=0.3,
    noise={"platform": 1e-8},
)
"""A platform alone, whose motion is known in closed form: quick to compile."""

BUDGET = Resources(240, 2)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A rig whose stack is free, and nothing else."""
    file = tmp_path_factory.mktemp("rig") / "rig.toml"
    file.write_text(SOURCE.replace('"friction.sigma1" = { start', '"friction.sigma1" = { value'))
    study = pdssjax.load_study(file, virtual=True)
    fixed = study.with_values({"friction.f_ss": 0.65})
    damped = dataclasses.replace(fixed.parameters["piezo.damping_ratio"], value=None, start=0.18)
    return dataclasses.replace(fixed, parameters=dict(fixed.parameters) | {"piezo.damping_ratio": damped})


@pytest.fixture(scope="module")
def plan(study):
    """Best for all parameters of the stack."""
    return design_experiment(study, BUDGET, limits=LIMITS, draws=1)


def jacobian_errors(study, records):
    """Standard errors [SI] of a fit of these records, by the Jacobian of the fit's own residuals."""
    whole = dataclasses.replace(study, records=tuple(records))
    problem = pose(whole, whole.values(), whole.accuracy)
    free = problem.encode(whole.values())
    jacobian = np.asarray(problem.jacobian(free))
    errors = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    return dict(zip(problem.residual.transform.paths, problem.residual.transform.slope(free) * errors, strict=True))


def test_a_plan_keeps_its_budget_and_promises_what_the_fits_jacobian_says(study, plan):
    assert plan.samples <= 240 and len(plan.records) <= 2
    told = jacobian_errors(study, [planned.record(study) for planned in plan.records])
    assert plan.after == pytest.approx(told, rel=1e-6)
    assert all(planned.contributes > 1.0 for planned in plan.records)


def test_a_plan_beats_even_samples_of_the_same_records(study, plan):
    records = [planned.record(study) for planned in plan.records]
    even = [
        dataclasses.replace(r, time=np.linspace(0.0, 0.29, r.time.size), measured=np.zeros(r.time.size))
        for r in records
    ]
    errors = jacobian_errors(study, even)
    gain = np.mean([np.log(errors[path] / plan.after[path]) for path in errors])
    assert np.exp(gain) > 1.5


def test_one_parameter_is_better_known_by_a_plan_for_it(study, plan):
    path = "piezo.gain"
    aimed = design_experiment(study, BUDGET, limits=LIMITS, draws=1, aim=Aim("parameter", (path,)))
    assert aimed.after[path] < plan.after[path]


def test_what_nothing_sees_is_named(study):
    """The platform does not feel the end-effector."""
    mass = dataclasses.replace(study.parameters["effector.mass"], value=None, start=0.086)
    free = dataclasses.replace(study, parameters=dict(study.parameters) | {"effector.mass": mass})
    with pytest.raises(InputError, match=r"found no experiment within the limits that changes with effector\.mass"):
        design_experiment(free, BUDGET, limits=LIMITS, draws=1)


@pytest.mark.slow
def test_a_rehearsal_has_the_errors_that_were_promised(plan):
    rehearsal = rehearse(plan, seed=3)
    assert rehearsal.estimate.converged
    assert rehearsal.ratio == pytest.approx(1.0, rel=0.2)
