"""Samples that would be fitted twice are named, whatever their files are called."""

import dataclasses

import numpy as np
import pytest
from record_tables import step_table
from study_files import STUDY, write_study

import pdssjax
from pdssjax import InputError
from pdssjax.core import member
from pdssjax.inference.record_checks import check_measured_once

NOISE = np.random.default_rng(0)


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    """A record of 400 noisy samples, counted in steps of 0.01 um, at rest for its first 100."""
    loaded = pdssjax.load_study(write_study(tmp_path_factory.mktemp("study"))).records[0]
    time = 1e-4 * np.arange(400)
    return dataclasses.replace(loaded, name="a", time=time, measured=_counted(time), role="fit")


def _counted(time):
    motion = np.where(time < 0.01, 0.0, 5e-6 * (1.0 - np.exp(-(time - 0.01) / 0.005)))
    return np.round((motion + 1e-8 * NOISE.standard_normal(time.size)) / 1e-8) * 1e-8


def part(record, begin, end, **change):
    kept = slice(begin, end)
    return dataclasses.replace(record, time=record.time[kept], measured=record.measured[kept], **change)


REPEATED = {
    "listed twice": (lambda r: dataclasses.replace(r, name="b"), 400),
    "under another drive": (lambda r: dataclasses.replace(r, name="b", overrides=frozenset()), 400),
    "a copy with another clock": (lambda r: dataclasses.replace(r, name="b", time=r.time + 3.7), 400),
    "another start on the same clock": (lambda r: dataclasses.replace(r, name="b", time=r.time - 0.5, start=0.5), 400),
    "in another unit": (lambda r: dataclasses.replace(r, name="b", measured=(r.measured / 1e-9) * 1e-9), 400),
    "a window of the other": (lambda r: part(r, 150, 300, name="b"), 150),
    "windows that overlap": (lambda r: part(r, 300, 400, name="b"), 100),
}


@pytest.mark.parametrize("kind", REPEATED)
def test_samples_that_are_fitted_twice_are_refused_with_both_records(record, kind):
    make, shared = REPEATED[kind]
    with pytest.raises(InputError) as refused:
        check_measured_once([record, make(record)], "study.toml")
    told = str(refused.value)
    assert told.startswith('study.toml: record "b" (') and 'in record "a" (' in told and "\n" not in told
    assert f"found {shared} of its" in told


APART = {
    "another run": lambda r: dataclasses.replace(r, name="b", measured=_counted(r.time)),
    "validated only": lambda r: dataclasses.replace(r, name="b", role="validate"),
    "a later run": lambda r: dataclasses.replace(r, name="b", time=r.time + 1.0, measured=_counted(r.time)),
    "other samples of it": lambda r: dataclasses.replace(
        r, name="b", time=r.time + 5e-5, measured=_counted(r.time + 5e-5)
    ),
    "a rest that is the same": lambda r: dataclasses.replace(
        r, name="b", measured=np.where(r.time < 0.01, r.measured, 2.0 * r.measured + 1e-8)
    ),
    "another quantity": lambda r: dataclasses.replace(
        r, name="b", measurement=member("study.measurement", "effector")()
    ),
}


@pytest.mark.parametrize("kind", APART)
def test_what_was_measured_anew_is_fitted(record, kind):
    check_measured_once([record, APART[kind](record)], "study.toml")


def test_a_record_that_never_moves_is_not_judged(record):
    """One that is still to be made is zero all along."""
    rest = dataclasses.replace(record, measured=np.zeros(400))
    check_measured_once([rest, dataclasses.replace(rest, name="b")], "study.toml")


def test_identify_refuses_a_file_under_two_names(tmp_path):
    again = step_table('noise = "0.01 um"', voltage="48.2 V").replace('name = "step"', 'name = "again"')
    path = write_study(tmp_path, f"{STUDY}\n{again.replace('step.csv', 'copy.csv')}")
    (tmp_path / "copy.csv").write_text((tmp_path / "step.csv").read_text())
    with pytest.raises(InputError, match=r'record "again" .*copy\.csv.*40 of its 40 samples in record "step"'):
        pdssjax.identify(pdssjax.load_study(path))
