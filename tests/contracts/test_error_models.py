"""A contract that every error model keeps, found by itself."""

import equinox as eqx
import numpy as np
import pytest

from pdssjax.core import member, members
from pdssjax.inference import influence_of
from pdssjax.inference.uncertainty.error_models.base import AbstractErrorModel, RecordErrors

NAMES = members("inference.uncertainty.error_models")
every = pytest.mark.parametrize(
    "model", [member("inference.uncertainty.error_models", name)() for name in NAMES], ids=NAMES
)
RANDOM = np.random.default_rng(6)


def record(cycles=4.0, phases=50, frequency: float | None = 5.0, misfit=0.5) -> RecordErrors:
    """A record with a little misfit that its Jacobian is orthogonal to."""
    time = np.arange(round(cycles * phases)) / phases / 5.0
    phase = np.mod(5.0 * time, 1.0)
    jacobian = np.stack([np.cos(6 * phase), np.exp(-4 * phase)], axis=1) * np.array([3.0, 1e3])
    jacobian -= jacobian.mean(axis=0)
    off = RANDOM.normal(size=time.size) + misfit * np.sin(25 * phase)
    off -= off.mean()
    residual = off - jacobian @ np.linalg.lstsq(jacobian, off, rcond=None)[0]
    return RecordErrors(residual, jacobian, influence_of(jacobian), time, frequency, 1.0, time.size - 3.0)


RECORDS = {
    "cycles": record(),
    "cycles of no whole number of samples": record(phases=49),
    "one cycle and a third": record(cycles=1.3),
    "no cycle": record(frequency=None),
    "three samples": RecordErrors(*(part[:3] for part in record()[:4]), 5.0),
    "no samples": RecordErrors(*(part[:0] for part in record()[:4]), 5.0),
    "no residuals": record()._replace(residual=np.zeros(200)),
}


def test_there_is_one_for_every_rank():
    ranks = [member("inference.uncertainty.error_models", name).rank for name in NAMES]
    assert sorted(ranks) == list(range(len(NAMES)))


@every
def test_it_is_final_has_a_name_and_says_what_it_covers(model):
    assert isinstance(model, AbstractErrorModel)
    assert type(model).__mro__[1] is AbstractErrorModel
    assert model.name in NAMES
    assert model.covers
    assert eqx.tree_equal(type(model)(), model)


@every
@pytest.mark.parametrize("kind", RECORDS)
def test_a_covariance_is_symmetric_and_never_negative(model, kind):
    found, (evidence,) = model.covariance([RECORDS[kind]])
    assert found.shape == (2, 2)
    np.testing.assert_allclose(found, found.T, atol=1e-12 * np.abs(found).max(initial=0.0))
    size = np.sqrt(np.maximum(np.diag(found), 1e-300))
    assert np.linalg.eigvalsh(found / np.outer(size, size)).min() > -1e-9
    assert np.isfinite(evidence)


@every
def test_records_add_up_in_any_order(model):
    first, second = RECORDS["cycles"], RECORDS["no cycle"]
    whole, evidence = model.covariance([first, second])
    np.testing.assert_allclose(whole, model.covariance([first])[0] + model.covariance([second])[0])
    turned, behind = model.covariance([second, first])
    np.testing.assert_allclose(turned, whole)
    assert behind == evidence[::-1]


@every
@pytest.mark.parametrize("kind", ["cycles", "no cycle"])
def test_it_does_not_depend_on_the_unit_of_a_parameter(model, kind):
    plain = RECORDS[kind]
    unit = np.array([1e6, 1e-4])
    other = plain._replace(jacobian=plain.jacobian * unit, influence=plain.influence / unit)
    np.testing.assert_allclose(
        model.share(other).covariance * np.outer(unit, unit), model.share(plain).covariance, rtol=1e-6
    )


@every
def test_a_parameter_that_the_record_does_not_move_has_no_share(model):
    still = RECORDS["cycles"]._replace(influence=RECORDS["cycles"].influence * np.array([1.0, 0.0]))
    found = model.share(still).covariance
    assert found[0, 0] > 0.0
    assert not found[1].any()


def test_the_weaker_the_assumption_the_larger_the_errors_under_misfit():
    models = sorted(
        (member("inference.uncertainty.error_models", name)() for name in NAMES), key=lambda model: model.rank
    )
    errors = [np.sqrt(np.diag(model.share(record(misfit=3.0)).covariance)) for model in models]
    assert np.all(errors[-1] > 2.0 * errors[1])
