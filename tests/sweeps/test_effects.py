"""Every axis of a sweep changes its points, or is refused by name before any work."""

import numpy as np
import pytest
from quick_blocks import study as study
from study_files import write_estimate

from pdssjax import InputError
from pdssjax.cli.main import main
from pdssjax.files import EXAMPLE
from pdssjax.sweeps import CovarianceDraws, Crossed, Grid, Sobol, changes_a_sweep, find_border, plan_sweep
from pdssjax.sweeps.execution import job_document, point_function


@pytest.mark.parametrize(
    "over",
    [
        {"amplifier.bandwidth": [100.0, 1e4]},
        {"amplifier.bandwidth": [100.0], "amplifier.slew": [1e4, 1e5]},
        Sobol({"amplifier.bandwidth": (100.0, 1e3)}, 4),
    ],
    ids=["bandwidth", "slew, too", "sample"],
)
def test_an_amplifier_that_the_study_has_not_is_put_before_the_stack(study, over):
    function = plan_sweep(study, over).function
    values = plan_sweep(study, over).points.values()[0]
    amplifier = function.system(values).actuator.amplifier
    assert float(amplifier.bandwidth) == values[0]
    # Another process makes the same of the job.
    again = point_function(job_document(function))
    assert float(again.system(values).actuator.amplifier.bandwidth) == values[0]
    assert plan_sweep(study, {"drive.voltage": [60.0]}).function.system(np.array([60.0])).actuator.amplifier is None


@pytest.mark.parametrize(
    ("over", "says"),
    [
        ({"sensor.bandwidth": [50.0, 1e4]}, "not what the sensor shows"),
        ({"sensor.delay": [0.0, 1e-3]}, "not what the sensor shows"),
        ({"stop.stiffness": [1e4, 1e5]}, "--metrics output_force"),
        ({"piezo.mass": [0.1, 1.0]}, r"feedback = true in \[actuator\]"),
        ({"amplifier.slew": [1e4, 1e5]}, 'without "amplifier.bandwidth"'),
        (Sobol({"sensor.bandwidth": (50.0, 1e4)}, 4), "sensor.bandwidth"),
    ],
)
def test_an_axis_that_would_change_nothing_is_refused(study, over, says):
    with pytest.raises(InputError, match=says) as refused:
        plan_sweep(study, over)
    assert str(refused.value).startswith("sweep: found ")


def test_an_axis_takes_effect_where_what_it_needs_is_asked_for(study):
    plan_sweep(study, {"stop.stiffness": [1e4, 1e5]}, metrics=["output_force"])
    with pytest.raises(InputError, match="output_force"):
        plan_sweep(study, {"stop.stiffness": [1e4, 1e5]})


def test_a_border_and_a_derivative_along_what_changes_nothing_are_refused(study):
    with pytest.raises(InputError, match="sensor shows"):
        find_border(study, "sensor.bandwidth", (50.0, 1e4), {}, tolerance=10.0)
    listed = study.with_values({"sensor.bandwidth": 1e3})
    with pytest.raises(InputError, match="sensor shows"):
        plan_sweep(listed, {"drive.voltage": [60.0]}, derivatives=["sensor.bandwidth"])
    assert not changes_a_sweep("sensor.bandwidth", listed, ()) and changes_a_sweep("piezo.gain", listed, ())


def test_draws_of_what_is_known_may_hold_what_changes_nothing(study):
    """A band by a parameter without effect has no width, which is right."""
    listed = study.with_values({"sensor.bandwidth": 1e3})
    about = CovarianceDraws(["sensor.bandwidth"], np.array([1e3]), np.array([[100.0]]), np.array([True]), 5)
    assert len(plan_sweep(listed, Crossed(Grid({"drive.voltage": [60.0]}), about)).points) == 5


def test_the_command_refuses_it_too(study, tmp_path, capsys):
    estimate = write_estimate(tmp_path, study.values())
    out = ["--estimate", str(estimate), "--out", str(tmp_path / "out")]
    assert main(["sweep", str(EXAMPLE / "study.toml"), "--vary", "sensor.bandwidth=50,1000", *out]) == 2
    assert '"sensor.bandwidth", which changes nothing' in capsys.readouterr().err
