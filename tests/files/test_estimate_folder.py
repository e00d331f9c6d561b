"""An estimate is read back from its folder as it was written, and what is damaged is named."""

import dataclasses
import json

import fabricated
import numpy as np
import pytest

from pdssjax import Estimate, InputError
from pdssjax.files import read_estimate_folder, write_essentials, write_estimate
from pdssjax.report.text import format_report
from pdssjax.study import Agreement, Combination, Diagnosis, IntegratorCheck, MeasuredApart, Provenance, Remedy
from pdssjax.study.measurement.friction import Friction
from pdssjax.study.measurement.platform import Platform

RECORDS = fabricated.estimate().records[::3]
"""One that was simulated, one that could not be."""


def whole(kind="bootstrap") -> Estimate:
    """An estimate that has all that one may have."""
    estimate = fabricated.with_errors(fabricated.estimate("sequential"))
    apart = MeasuredApart(1.0e-7, 1e-10, float("nan"))
    gain = dataclasses.replace(estimate.parameters["piezo.gain"], verdicts=("bounded", "flat"), measured_apart=apart)
    return dataclasses.replace(
        estimate,
        records=tuple(dataclasses.replace(record, prescribed=Platform().prescribed_display) for record in RECORDS),
        parameters=estimate.parameters | {"piezo.gain": gain},
        profiles=fabricated.profiles(estimate.parameters),
        multistart=fabricated.multistart(estimate.parameters),
        draws=fabricated.draws(estimate.parameters, kind),
        check=IntegratorCheck("kvaerno5", {"piezo.gain": 0.01, "effector.load": float("nan")}, True, "it converged"),
        diagnosis=Diagnosis(
            (Combination({"piezo.gain": 1.0, "friction.sigma1_a": -0.5}, 0.1), Combination({"piezo.gain": 1.0}, 0.01)),
            Remedy("effector.mass", {"friction.sigma1_a": (0.1, 0.03)}),
            (Agreement(("5 Hz A",), "record", 1.2, {"piezo.gain": float("nan"), "friction.f_ss_a": 0.3}),),
        ),
        actuator={"piezo": "second-order", "friction": "anisotropic-lugre", "feedback": False},
        provenance=Provenance("pdssjax identify 'a b.toml' --out x", "a b.toml", {"jax": "0.10.1"}),
        explained=False,
        unexplained_by=("noise", "validation"),
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("results")
    write_estimate(whole(), place)
    return place


def equal(one, other) -> bool:
    """Alike to the nine digits of a file; NaN is like NaN."""
    if isinstance(one, np.ndarray):
        return one.shape == other.shape and np.allclose(one, other, rtol=1e-8, atol=1e-14, equal_nan=True)
    if isinstance(one, float):
        return equal(np.array(one), np.array(other))
    if dataclasses.is_dataclass(one):
        return type(one) is type(other) and all(equal(value, vars(other)[name]) for name, value in vars(one).items())
    if isinstance(one, dict):
        return list(one) == list(other) and all(equal(value, other[key]) for key, value in one.items())
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(equal, one, other))
    return one == other


def test_it_is_read_as_it_was_written(folder):
    read = read_estimate_folder(folder)
    for name, value in vars(whole()).items():
        assert equal(value, getattr(read, name)), name
    assert format_report(read) == (folder / "report.txt").read_text(encoding="utf-8")


def nothing_free() -> Estimate:
    none = np.zeros((0, 0))
    return dataclasses.replace(whole(), names=(), correlation=none, covariance=none, covariances={}, diagnosis=None)


@pytest.mark.parametrize("estimate", [fabricated.estimate(converged=False), whole("posterior"), nothing_free()])
def test_without_predictions_and_draws_all_else_is_read(estimate, tmp_path):
    write_essentials(estimate, tmp_path)
    read, none = read_estimate_folder(tmp_path), np.zeros(0)
    records = [dataclasses.replace(record, time=none, measured=none, predicted=none) for record in estimate.records]
    assert format_report(read) == format_report(dataclasses.replace(estimate, records=tuple(records)))
    assert all(record.time.size == 0 for record in read.records)
    assert read.draws is None or read.draws.values.size == 0


def test_a_prescribed_motion_and_glitches_are_read(tmp_path):
    time = np.linspace(0.0, 1.0, 50)
    kind = Friction()
    record = dataclasses.replace(
        fabricated.record("loop", "fit", "friction", time, np.sin(time)),
        unit="N",
        display=kind.display,
        prescribed=kind.prescribed_display,
        motion=1e-6 * np.cos(9.0 * time),
        outliers=np.array([3, 17]),
    )
    write_estimate(dataclasses.replace(fabricated.estimate(), records=(record,)), tmp_path)
    (read,) = read_estimate_folder(tmp_path).records
    np.testing.assert_allclose(read.motion, record.motion, rtol=1e-8)
    np.testing.assert_array_equal(read.outliers, [3, 17])
    assert read.display == record.display and read.prescribed == record.prescribed


LATER = (
    "provenance actuator loss effort solver minimiser explained unexplained_by covariances error_advice diagnosis check"
)
"""Keys that early versions did not write."""


def test_results_of_earlier_versions_are_read(folder, tmp_path):
    document = json.loads((folder / "estimate.json").read_text(encoding="utf-8"))
    for key in LATER.split():
        del document[key]
    for record in document["records"]:
        for key in ("frequency", "excitation", "file"):
            del record[key]
    (tmp_path / "estimate.json").write_text(json.dumps(document), encoding="utf-8")
    read = read_estimate_folder(tmp_path)
    assert read.provenance == Provenance() and read.loss == "squares"


GAIN = ("parameters", "piezo.gain", "value")

# name: (where in the document, what stands there instead; None: nothing)
DAMAGE = {
    "no statistics": (("statistics",), None),
    "a value that is a word": (GAIN, "large"),
    "records that are a number": (("records",), 7),
    "a record of something unknown": (("records", 0, "measures"), "temperature"),
    "a matrix that is too small": (("covariance", "matrix"), [[1.0]]),
    "parameters that are a list": (("parameters",), [1.0]),
    "a surplus statistic": (("statistics", "luck"), 1.0),
    "an unknown reason": (("unexplained_by",), ["bad luck"]),
}


@pytest.mark.parametrize(("place", "instead"), DAMAGE.values(), ids=DAMAGE)
def test_what_is_damaged_is_refused_in_one_line(folder, tmp_path, place, instead):
    document = json.loads((folder / "estimate.json").read_text(encoding="utf-8"))
    inner = document
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = instead
    if instead is None:
        del inner[place[-1]]
    (tmp_path / "estimate.json").write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(
        InputError, match=r"estimate\.json: found .*expected an estimate that pdssjax identify wrote\.$"
    ):
        read_estimate_folder(tmp_path)


@pytest.mark.parametrize(
    ("content", "found"),
    [
        ("time_s,measured_um,predicted_um,residual_um\n0,1,much,2\n", "cannot be read"),
        ("time_s,measured_um,predicted_um,residual_um\n0,1,2,3\n", "found 1 samples .*expected the 800 samples"),
        ("time_s,x\n" + "0,1\n" * 800, "found 800 samples of time_s, x; expected"),
    ],
)
def test_predictions_of_something_else_are_refused(folder, tmp_path, content, found):
    write_essentials(whole(), tmp_path)
    (tmp_path / "predictions").mkdir()
    file = next(file for file in sorted((folder / "predictions").iterdir()) if file.stem.startswith("step"))
    (tmp_path / "predictions" / file.name).write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=rf"{file.name}: {found}"):
        read_estimate_folder(tmp_path)
