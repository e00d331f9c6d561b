"""Draws on the disk: a posterior as ArviZ expects it, a bootstrap as a table, and what estimate.json says of them."""

import dataclasses
import json

import fabricated
import numpy as np
import pytest
import xarray

from pdssjax.files import write_estimate
from pdssjax.files.draws_results import write_draws


def whole(kind=None, **more):
    plain = fabricated.estimate()
    drawn = {} if kind is None else {"draws": fabricated.draws(plain.parameters, kind)}
    return dataclasses.replace(plain, records=plain.records[:1], **drawn, **more)


UNITS = {"piezo.gain": "m/V", "friction.sigma1_a": "N s/m"}


def test_a_posterior_has_the_groups_of_arviz(tmp_path):
    pytest.importorskip("h5netcdf")
    draws = whole("posterior").draws
    assert draws is not None
    write_draws(draws, UNITS, tmp_path)
    with xarray.open_datatree(tmp_path / "posterior.nc", engine="h5netcdf") as tree:
        assert set(tree.children) == {"posterior", "sample_stats"}
        gain = tree["posterior"]["piezo.gain"]
        assert gain.dims == ("chain", "draw") and gain.attrs["units"] == "m/V"
        np.testing.assert_array_equal(gain.values, draws.values[:, :, 0])
        np.testing.assert_array_equal(tree["sample_stats"]["lp"].values, -7.0)
        assert tree["posterior"].attrs["inference_library"] == "pdssjax"


def test_arviz_opens_it(tmp_path):
    pytest.importorskip("h5netcdf")
    arviz = pytest.importorskip("arviz")
    draws = whole("posterior").draws
    assert draws is not None
    write_draws(draws, UNITS, tmp_path)
    opened = arviz.from_netcdf(str(tmp_path / "posterior.nc"))
    np.testing.assert_array_equal(opened["posterior"]["friction.sigma1_a"].values, draws.values[:, :, 1])
    np.testing.assert_array_equal(opened["sample_stats"]["lp"].values, -7.0)


def test_without_h5netcdf_it_is_one_dataset(tmp_path, monkeypatch):
    draws = whole("posterior").draws
    assert draws is not None
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    write_draws(draws, UNITS, tmp_path)
    monkeypatch.undo()
    with xarray.open_dataset(tmp_path / "posterior.nc", engine="scipy") as data:
        np.testing.assert_array_equal(data["piezo.gain"].values, draws.values[:, :, 0])


def test_results_hold_draws_profiles_and_starts_and_replace_older_ones(tmp_path):
    parameters = fabricated.estimate().parameters
    bounded = {
        path: dataclasses.replace(parameter, verdicts=("bounded", "bounded")) for path, parameter in parameters.items()
    }
    more = dict(profiles=fabricated.profiles(parameters), multistart=fabricated.multistart(parameters))
    write_estimate(whole("bootstrap", parameters=bounded, **more), tmp_path)
    table = np.loadtxt(tmp_path / "bootstrap.csv", delimiter=",", skiprows=1)
    head = (tmp_path / "bootstrap.csv").read_text().splitlines()[0]
    assert table.shape == (40, 2) and head == "piezo.gain [m/V],friction.sigma1_a [N s/m]"
    assert {"profiles.png", "multistart.png"} <= {path.name for path in (tmp_path / "plots").iterdir()}
    document = json.loads((tmp_path / "estimate.json").read_text(), parse_constant=pytest.fail)
    assert [profile["path"] for profile in document["profiles"]] == list(fabricated_paths())
    assert len(document["profiles"][0]["excess"]) == 25
    assert document["multistart"]["optimum"].count(0) == 12 and document["multistart"]["chi2"][-1] is None
    assert document["draws"]["parameters"]["piezo.gain"]["basic"] is not None
    write_estimate(whole(), tmp_path)
    assert not (tmp_path / "bootstrap.csv").exists()
    assert json.loads((tmp_path / "estimate.json").read_text())["draws"] is None


def fabricated_paths():
    return ("piezo.gain", "friction.sigma0_a", "friction.sigma1_a")
