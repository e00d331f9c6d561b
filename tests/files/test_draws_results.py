"""Draws on the disk: a posterior as ArviZ expects it, a bootstrap as a table, and what estimate.json says of them."""

import dataclasses
import json

import fabricated
import numpy as np
import pytest
import xarray

from pdssjax import InputError
from pdssjax.files import write_estimate
from pdssjax.files.draws_file import read_draws, write_draws


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


@pytest.mark.parametrize("kind", ["posterior", "bootstrap"])
@pytest.mark.parametrize("grouped", [True, False])
def test_draws_are_read_again(tmp_path, kind, grouped, monkeypatch):
    draws = whole(kind).draws
    assert draws is not None
    with monkeypatch.context() as lacking:
        if not grouped:
            lacking.setattr("importlib.util.find_spec", lambda name: None)
        write_draws(draws, UNITS, tmp_path)
    names, values = read_draws(tmp_path / "estimate.json", kind)
    assert names == draws.names
    np.testing.assert_allclose(values, draws.values.reshape(-1, len(names)), rtol=1e-9)


@pytest.mark.parametrize(("kind", "name"), [("posterior", "posterior.nc"), ("bootstrap", "bootstrap.csv")])
def test_draws_that_are_not_there_or_broken_are_told_in_a_line(tmp_path, kind, name):
    with pytest.raises(InputError, match=rf"{name}: there is no such file, .* --intervals {kind}"):
        read_draws(tmp_path / "estimate.json", kind)
    (tmp_path / name).write_text("piezo.gain [m/V]\nno number\n")
    with pytest.raises(InputError, match=f"{name}: cannot be read"):
        read_draws(tmp_path / "estimate.json", kind)


def test_arviz_opens_it(tmp_path):
    pytest.importorskip("h5netcdf")
    arviz = pytest.importorskip("arviz")
    draws = whole("posterior").draws
    assert draws is not None
    write_draws(draws, UNITS, tmp_path)
    opened = arviz.from_netcdf(str(tmp_path / "posterior.nc"))
    np.testing.assert_array_equal(opened["posterior"]["friction.sigma1_a"].values, draws.values[:, :, 1])
    np.testing.assert_array_equal(opened["sample_stats"]["lp"].values, -7.0)


def test_results_hold_draws_profiles_and_starts_and_replace_older_ones(undrawn, tmp_path):
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
    profiled = [profile["path"] for profile in document["profiles"]]
    assert profiled == ["piezo.gain", "friction.sigma0_a", "friction.sigma1_a"]
    assert len(document["profiles"][0]["excess"]) == 25
    assert document["multistart"]["optimum"].count(0) == 12 and document["multistart"]["chi2"][-1] is None
    assert document["draws"]["parameters"]["piezo.gain"]["basic"] is not None
    write_estimate(whole(), tmp_path)
    assert not (tmp_path / "bootstrap.csv").exists()
    assert json.loads((tmp_path / "estimate.json").read_text())["draws"] is None
