"""Bands are those of the covariance: exact for what is linear, flagged where first order does not hold."""

import json

import numpy as np
import pytest
import xarray
from quick_blocks import example_study, quick as quick
from study_files import write_estimate

import pdssjax
from pdssjax import InputError
from pdssjax.cli.main import main
from pdssjax.files import EXAMPLE, read_covariance
from pdssjax.sweeps import (
    GRAZING,
    CovarianceDraws,
    Crossed,
    Grid,
    Listed,
    SigmaPoints,
    execution,
    plan_sweep,
    with_bands,
)
from pdssjax.sweeps.sweeping import labelled

pytestmark = pytest.mark.usefixtures("undrawn")
MEANS = np.array([2.0, -1.0])
COVARIANCE = np.array([[4e-4, 3e-4], [3e-4, 2.5e-3]])
DRAWS = CovarianceDraws(["a.b", "c.d"], MEANS, COVARIANCE, np.array([True, False]), 4000, seed=2)
GRID = Grid({"drive.voltage": [1.0, 2.0, 3.0]})


def swept(about, function):
    """A sweep whose only metric is a function of voltage, a and c."""
    points = Crossed(GRID, about)
    metric = function(*points.values().T).reshape(tuple(points.dimensions().values()))
    dims = tuple(points.dimensions())
    said = {"units": "m", "long_name": "net step"}
    data = {"net_step": (dims, metric, said), "failure": (dims, np.zeros(metric.shape, np.int8), {"meanings": ""})}
    return xarray.Dataset(data, {"drive_voltage": GRID.axes["drive.voltage"]})


def linear(voltage, a, c):
    return voltage * (3.0 * np.log(a) - 2.0 * c)


@pytest.mark.parametrize(("about", "tolerance"), [(SigmaPoints(DRAWS), 1e-9), (DRAWS, 0.05)])
def test_bands_of_what_is_linear_are_those_of_the_covariance(about, tolerance):
    found = with_bands(swept(about, linear))
    slope = np.array([3.0 / 2.0, -2.0])
    sd = np.sqrt(slope @ COVARIANCE @ slope) * GRID.axes["drive.voltage"]
    np.testing.assert_allclose(found.net_step_sd, sd, rtol=tolerance)
    np.testing.assert_allclose(found.net_step_high - found.net_step_low, 2 * 1.96 * sd, rtol=max(tolerance, 1e-4))
    np.testing.assert_allclose(found.net_step, linear(GRID.axes["drive.voltage"], *MEANS), rtol=tolerance, atol=0.01)
    assert found.sizes == {"drive_voltage": 3} and found.net_step_sd.attrs["units"] == "m"


def test_where_a_metric_breaks_within_the_uncertainty_first_order_is_said_not_to_hold():
    broken = with_bands(swept(SigmaPoints(DRAWS), lambda voltage, a, c: np.where((voltage < 1.5) | (a < 2.0), a, 2.5)))
    np.testing.assert_array_equal(broken.net_step_straight, [1.0, 0.0, 0.0])
    assert with_bands(swept(SigmaPoints(DRAWS), linear)).net_step_straight.all()


def test_where_first_order_is_said_to_hold_a_quadratic_metric_has_its_standard_deviation():
    """Variance of g'z + z'Hz/2 with normal z: g'g + tr(H H)/2; most of it lies in products, which no axis shows."""
    count, random = 9, np.random.default_rng(0)
    normal = CovarianceDraws(list("abcdefghi"), np.zeros(count), np.eye(count), np.zeros(count, bool), 1)
    points = SigmaPoints(normal)
    held = []
    for bend in np.geomspace(0.003, 0.3, 300):
        slope, root = random.standard_normal(count), random.standard_normal((count, count))
        hessian = bend * (root + root.T)
        metric = points.values() @ slope + 0.5 * np.einsum("ki,ij,kj->k", points.values(), hessian, points.values())
        data = xarray.Dataset({"net_step": ("sigma_point", metric, {"units": "m", "long_name": "net step"})})
        found = with_bands(data.assign(failure=("sigma_point", np.zeros(metric.size, np.int8))))
        missed = 1.0 - found.net_step_sd.item() / np.sqrt(slope @ slope + 0.5 * np.sum(hessian**2))
        held.append(bool(found.net_step_straight))
        assert missed < 0.05 or not held[-1]
        assert missed > 0.005 or held[-1]
    assert 90 < sum(held) < 210


@pytest.mark.slow
@pytest.mark.parametrize("error", [0.003, 0.02])
def test_where_first_order_is_said_to_hold_draws_at_random_points_agree(error):
    study = example_study()
    names = [name for name, value in study.values().items() if value > 0.0 and not name.startswith("effector")]
    values, random = study.values(), np.random.default_rng(7)
    means = np.array([values[name] for name in names])
    about = CovarianceDraws(names, means, np.diag((error * means) ** 2), np.ones(len(names), bool), 4000)
    drives = {"drive.voltage": random.uniform(np.log(4.0), np.log(150.0), 24)}
    drives["drive.frequency"] = random.uniform(np.log(2.0), np.log(400.0), 24)
    points = Listed({path: np.exp(value) for path, value in drives.items()})
    linear, drawn = (
        with_bands(pdssjax.sweep(study, Crossed(points, kind), cycles="steady")) for kind in (SigmaPoints(about), about)
    )
    for name, least in {"speed": 3, "stroke": 10, "efficiency": 3, "back_slip": 3}.items():
        holds = linear[f"{name}_straight"].values == 1
        assert holds.sum() >= least, name
        ratio = (linear[f"{name}_sd"] / drawn[f"{name}_sd"]).values[holds]
        np.testing.assert_allclose(ratio, 1.0, atol=0.05, err_msg=name)


def test_a_point_that_failed_says_more_than_one_that_grazes():
    data = swept(SigmaPoints(DRAWS), linear)
    data.failure[:, 1] = GRAZING
    data.failure[1, 2] = 2
    found = with_bands(data).failure
    assert found.values.tolist() == [GRAZING, 2, GRAZING] and found.dtype == np.int8 and "meanings" in found.attrs


def test_a_dataset_without_draws_has_no_bands():
    with pytest.raises(ValueError, match="Expected a sweep over draws"):
        with_bands(swept(DRAWS, linear).isel(draw=0))


@pytest.fixture
def estimate(tmp_path):
    """An estimate.json of the example, of which two parameters are known to 1 % and 2 %."""
    study = example_study()
    names = ["piezo.gain", "friction.f_ss_a", "friction.f_ss_b"]
    values = study.values()
    errors = np.array([0.01, 0.02, np.nan]) * [values[name] for name in names]
    matrix = [
        [None if np.isnan(e * f) else e * f * (i == j) for j, f in enumerate(errors)] for i, e in enumerate(errors)
    ]
    return write_estimate(tmp_path, values, covariance={"names": names, "matrix": matrix})


def test_the_covariance_of_an_estimate_is_read_without_what_nothing_is_known_of(estimate):
    names, covariance, errors = read_covariance(estimate)
    assert names == ("piezo.gain", "friction.f_ss_a") and errors == "standard"
    assert np.sqrt(covariance[0, 0]) == pytest.approx(0.01 * 1.007e-7, rel=1e-3)


def bands_of_the_command(tmp_path, estimate, *more):
    """The dataset of a sweep with bands."""
    command = ["sweep", str(EXAMPLE / "study.toml"), "--voltage", "20:80:4", "--estimate", str(estimate)]
    assert main([*command, "--bands", *more, "--out", str(tmp_path / "out")]) == 0
    return xarray.open_dataset(tmp_path / "out" / "sweep.nc", engine="scipy").load()


@pytest.mark.parametrize("kind", ["linear", "draws", "bootstrap"])
def test_the_command_gives_bands_and_tells_what_they_scatter_about(tmp_path, estimate, capsys, monkeypatch, kind):
    linear_in_gain = lambda function, points: np.column_stack(
        [*[1e7 * points[:, 1:2] * points[:, :1]] * 5, 0 * points[:, :1]]
    )
    monkeypatch.setattr(execution, "compute_block", linear_in_gain)
    gains = 1.007e-7 * np.random.default_rng(6).normal(1.0, 0.01, 1000)
    np.savetxt(tmp_path / "bootstrap.csv", gains, "%.10g", header="piezo.gain [m/V]", comments="")
    data = bands_of_the_command(tmp_path, estimate, kind, "--draws", "400")
    np.testing.assert_allclose(data.net_step_sd / data.net_step, 0.01, rtol=1e-3 if kind == "linear" else 0.1)
    told, value = json.loads(data.attrs["parameters"]), example_study().values()["piezo.gain"]
    gain = told["piezo.gain"]
    assert gain["value"] == value and gain["source"] == f"estimate {estimate}"
    assert (
        gain["standard_error"] == pytest.approx(0.01 * value, rel=0.1) and "standard_error" not in told["effector.mass"]
    )
    assert json.loads((tmp_path / "out" / "parameters.json").read_text())["parameters"] == told
    # It is not held: neither an attribute of its own nor a number of the job, by which stores are told apart.
    assert "piezo.gain" not in data.attrs and data.attrs["effector.mass"] == told["effector.mass"]["value"]
    printed = capsys.readouterr().out
    assert " 95 % " in printed
    row = next(line.split() for line in printed.splitlines() if "piezo.gain" in line)
    assert row[:3] == ["piezo.gain", "um/V", "0.1007"] and float(row[3]) == pytest.approx(0.001, rel=0.1)


def test_draws_about_other_numbers_than_the_study_has_are_told_as_given():
    about = CovarianceDraws(["piezo.gain"], np.array([2e-7]), np.array([[1e-18]]), np.array([True]), 3)
    planned = plan_sweep(example_study(), Crossed(GRID, about))
    assert "piezo.gain" not in planned.document["parameters"]
    found = np.zeros((len(planned.points), 6))
    data = labelled(planned, found)
    told = json.loads(data.attrs["parameters"])["piezo.gain"]
    assert told == {"value": 2e-7, "unit": "m/V", "source": "given", "standard_error": 1e-9}


@pytest.mark.parametrize("model", ["white", "with-misfit"])
def test_bands_are_by_the_errors_that_the_estimate_says_to_believe(tmp_path, estimate, quick, capsys, model):
    document = json.loads(estimate.read_text())
    names, white = document["covariance"].values()
    wide = [[None if entry is None else 9.0 * entry for entry in row] for row in white]
    document["covariances"] = {"names": names, "white": white, "with-misfit": wide}
    plain = read_covariance(estimate).covariance
    estimate.write_text(json.dumps(document | {"error_advice": {"model": model, "reason": ""}}))
    known, factor = read_covariance(estimate), {"white": 1.0, "with-misfit": 9.0}[model]
    np.testing.assert_allclose(known.covariance, factor * plain)
    data = bands_of_the_command(tmp_path, estimate)
    assert data.attrs["errors"] == known.errors == model
    told = json.loads(data.attrs["parameters"])["piezo.gain"]
    assert told["standard_error"] == pytest.approx(0.01 * np.sqrt(factor) * told["value"])
    words = {"white": "the white errors", "with-misfit": "the errors with misfit"}[model]
    assert f"half the 95 % band, by {words} of the estimate" in capsys.readouterr().out


def test_white_errors_are_to_the_last_bit_those_with_which_stores_were_begun(estimate):
    """A sweep whose points differ by rounding could not be resumed."""
    document, plain = json.loads(estimate.read_text()), read_covariance(estimate).covariance
    names, white = document["covariance"].values()
    rounded = [[None if entry is None else (1.0 + 1e-15) * entry for entry in row] for row in white]
    told = {"covariances": {"names": names, "white": rounded}, "error_advice": {"model": "white", "reason": ""}}
    estimate.write_text(json.dumps(document | told))
    np.testing.assert_array_equal(read_covariance(estimate).covariance, plain)


def test_bands_without_an_estimate_are_refused(tmp_path, quick, capsys):
    command = ["sweep", str(EXAMPLE / "study.toml"), "--voltage", "20:80:4", "--guess", "--bands"]
    assert main([*command[:-2], "--bands", "--out", str(tmp_path / "out")]) == 2
    assert "found no --estimate" in capsys.readouterr().err and not quick


def test_a_file_that_says_nothing_of_errors_is_refused(tmp_path, estimate):
    document = json.loads(estimate.read_text()) | {"covariance": {"names": [], "matrix": []}}
    estimate.write_text(json.dumps(document))
    with pytest.raises(InputError, match="found no parameter with a standard error"):
        read_covariance(estimate)
