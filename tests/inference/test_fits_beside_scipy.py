"""Fits of real and of made-up records: a fit that says it converged is not beaten by SciPy from where it ended."""

import dataclasses

import pytest
from beside_scipy import best_of_scipy
from four_kinds import plan, startless
from liu_record import LAWS, liu
from tribometer_record import TRIBOMETER

import pdssjax
from experiments import blind_rigs, tribometer
from pdssjax import Accuracy
from pdssjax.files import EXAMPLE
from pdssjax.inference import SUCCESSES, Ending, joint
from pdssjax.inference.search.multistart import best_fit
from pdssjax.study import make_recordings


def beside_scipy(study):
    """Our fit, its problem, and SciPy's best from where it ended."""
    evidence, _ = best_fit(study, Accuracy(), joint, lambda message: None)
    fit, problem = evidence.fit, evidence.problem
    best = best_of_scipy(problem.whitened, problem.jacobian, fit.free, *problem.bounds, evaluations=100)
    return fit, problem, best


def is_not_beaten(fit, best):
    """Within 0.5 % and 4 units."""
    return fit.chi2 <= 1.005 * best + 4.0


@pytest.mark.slow
def test_liu_s_record_with_coulomb_s_law_is_not_left_half_way(tmp_path):
    fit, _, best = beside_scipy(liu("coulomb", tmp_path))
    # Of many minima: 550.07 from the starts given, 505.42 the best of those with less than 1 N of friction that is not
    # all but undamped (0.001 to 0.01 of critical: 487 to 500), 480.20 with 8.3 N.  498 was asked for.
    assert fit.chi2 < 481.0
    # Friction and fall time are told in combination alone, in a valley in which the last steps hardly gain anything.
    assert fit.ending in (*SUCCESSES, Ending.SLOW_STEPS), fit.message
    assert is_not_beaten(fit, best)


@pytest.mark.slow
@pytest.mark.parametrize("law", [law for law in LAWS if law != "coulomb"])
def test_liu_s_record_with_other_laws(law, tmp_path):
    fit, _, best = beside_scipy(liu(law, tmp_path))
    assert not fit.success or is_not_beaten(fit, best), (fit.chi2, best, fit.message)


@pytest.mark.slow
def test_the_example():
    fit, _, best = beside_scipy(pdssjax.load_study(EXAMPLE / "study.toml"))
    assert fit.success, fit.message
    assert is_not_beaten(fit, best)


@pytest.mark.slow
def test_the_four_kinds_of_records(tmp_path):
    (tmp_path / "study.toml").write_text(plan(), encoding="utf-8")
    planned = pdssjax.load_study(tmp_path / "study.toml", virtual=True)
    records = tuple(made.record for made in make_recordings(planned, 1))
    without_starts = tmp_path / "without_starts"
    without_starts.mkdir()
    (without_starts / "study.toml").write_text(startless(plan()), encoding="utf-8")
    study = pdssjax.load_study(without_starts / "study.toml", virtual=True)
    fit, _, best = beside_scipy(dataclasses.replace(study, records=records))
    assert fit.success, fit.message
    assert is_not_beaten(fit, best)


@pytest.mark.slow
@pytest.mark.skipif(not TRIBOMETER.exists(), reason="the record is not part of the repository")
@pytest.mark.parametrize("law", ["dahl, n free", "elastoplastic"])
def test_the_tribometer_s_loops(law):
    fit, _, best = beside_scipy(tribometer.study(*tribometer.LAWS[law], tribometer.prepared(TRIBOMETER)))
    assert not fit.success or is_not_beaten(fit, best), (fit.chi2, best, fit.message)


@pytest.mark.slow
@pytest.mark.parametrize("number", [2, 5])
def test_random_rigs(number):
    """One of each reading, without starts; of 100 none is beaten by 0.03."""
    fit, _, best = beside_scipy(blind_rigs.rig(number)[0])
    assert fit.success, fit.message
    assert fit.chi2 <= best + 0.1
