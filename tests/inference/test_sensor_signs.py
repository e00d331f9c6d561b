"""A record that moves against its drive is questioned; the packaged records, which move with it, are not."""

import dataclasses
import warnings

import pytest

from pdssjax import InputWarning, load_study
from pdssjax.files import EXAMPLE
from pdssjax.inference.record_checks import about_signs, warn_of_reversed_signs

RECORDS = load_study(EXAMPLE / "study.toml").records


def test_records_that_move_with_their_drives_are_not_questioned():
    assert len(RECORDS) == 7
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_reversed_signs(RECORDS)
    assert about_signs(RECORDS) == []


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.name)
def test_a_sensor_that_counts_the_other_way_is_questioned(record):
    turned = dataclasses.replace(record, measured=-record.measured)
    with pytest.warns(InputWarning, match=r"found a motion against the voltage.*scale = -1") as said:
        warn_of_reversed_signs([turned])
    assert len(said) == 1
    (note,) = about_signs([turned])
    assert note.startswith(f'Record "{record.name}": found a motion against the voltage')
    assert ("direction" in str(said[0].message)) == (record.measures == "effector")


def test_the_other_direction_is_questioned():
    walk = next(record for record in RECORDS if record.name == "5 Hz A")
    turned = dataclasses.replace(walk.drive, direction=-walk.drive.direction)
    with pytest.warns(InputWarning, match="the drive's direction is the other one"):
        warn_of_reversed_signs([dataclasses.replace(walk, drive=turned)])
