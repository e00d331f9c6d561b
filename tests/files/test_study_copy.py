"""A study saved with other numbers: legal, with the same records, over nothing unasked."""

import os

import numpy as np
import pytest
import study_files

from pdssjax import InputError, load_study
from pdssjax.files import save_study


@pytest.fixture
def source(tmp_path):
    (tmp_path / "rig").mkdir()
    return study_files.write_study(tmp_path / "rig")


VALUES = {"piezo.gain": 1.1e-7, "friction.sigma0": 1.25e6, "effector.mass": 0.09}


def test_starts_values_bounds_and_drives_are_kept_or_changed(source, tmp_path):
    target = save_study(source, tmp_path / "new.toml", VALUES, {"walk": {"frequency": 8.0, "direction": "forward"}})
    before, after = load_study(source), load_study(target)
    gain, mass = after.parameters["piezo.gain"], after.parameters["effector.mass"]
    assert (gain.start, gain.low, gain.high) == (1.1e-7, pytest.approx(5e-8), 2e-7)
    assert (mass.value, mass.free) == (0.09, False)
    assert after.parameters["friction.sigma0"].start == 1.25e6
    assert after.parameters["friction.f_ss"].number is None
    assert (after.records[1].drive.frequency, after.records[1].drive.direction) == (8.0, 1.0)
    for old, new in zip(before.records, after.records, strict=True):
        assert np.array_equal(old.measured, new.measured)
        assert (old.noise, old.offset, old.role) == (new.noise, new.offset, new.role)


def test_numbers_that_were_not_turned_stand_as_they_were_written(source, tmp_path):
    before = load_study(source)
    same = {path: parameter.number for path, parameter in before.parameters.items() if parameter.number is not None}
    text = save_study(source, tmp_path / "rig" / "same.toml", same, {}).read_text()
    assert text.partition("\n")[2] == source.read_text()


def test_one_of_several_that_a_star_frees_stays_free(source, tmp_path):
    loops = (
        source.read_text()
        .replace(
            'piezo = "second-order"',
            'piezo = { dynamics = "second-order", hysteresis = { law = "play", elements = 2 } }',
        )
        .replace("[parameters]", '[parameters]\n"piezo.play_*" = {}\n"piezo.play_range" = { value = 10 }')
    )
    (tmp_path / "rig" / "loops.toml").write_text(loops)
    made = save_study(tmp_path / "rig" / "loops.toml", tmp_path / "rig" / "made.toml", {"piezo.play_2": 1e-8}, {})
    assert load_study(made).parameters["piezo.play_2"].free
    assert load_study(made).parameters["piezo.play_2"].start == 1e-8


def test_nothing_is_overwritten_unasked(source, tmp_path):
    target = save_study(source, tmp_path / "new.toml", {}, {})
    before = target.read_text()
    with pytest.raises(InputError, match="found a file there already"):
        save_study(source, target, VALUES, {})
    assert target.read_text() == before
    save_study(source, target, VALUES, {}, overwrite=True)
    assert load_study(target).parameters["piezo.gain"].start == 1.1e-7
    with pytest.raises(InputError, match="found the study that is open"):
        save_study(source, source, VALUES, {}, overwrite=True)


@pytest.mark.parametrize("text", [b"mine", b"[tool.ruff]", b'format = "other/1"', b"format = 1", b"\xff\x00"])
def test_only_a_study_is_replaced(source, tmp_path, text):
    target = tmp_path / "pyproject.toml"
    target.write_bytes(text)
    with pytest.raises(InputError, match=r"pyproject\.toml: found a file that is no study"):
        save_study(source, target, VALUES, {}, overwrite=True)
    assert target.read_bytes() == text


def test_a_study_that_cannot_be_read_any_more_is_replaced(source, tmp_path):
    target = tmp_path / "old.toml"
    target.write_text('format = "pdssjax-study/0"')
    save_study(source, target, VALUES, {}, overwrite=True)
    assert load_study(target).parameters["piezo.gain"].start == 1.1e-7


@pytest.mark.parametrize(
    ("name", "values", "said"),
    [
        ("a\0b.toml", VALUES, "expected a name that a file can have"),
        ("\ud800.toml", VALUES, "expected a name that a file can have"),
        ("~nobody-at-all/new.toml", VALUES, "there is no folder"),
        ("new.txt", VALUES, "does not end in"),
        ("none/new.toml", VALUES, "there is no folder"),
        ("new.toml", {"piezo.gain": 1.0}, r"new\.toml: .*found 1 m/V, expected at most the max"),
    ],
)
def test_what_cannot_be_saved_leaves_nothing_behind(source, tmp_path, name, values, said):
    before = sorted(os.listdir(tmp_path))
    with pytest.raises(InputError, match=said):
        save_study(source, tmp_path / name, values, {})
    assert sorted(os.listdir(tmp_path)) == before


def test_texts_with_quotes_and_other_letters_survive(source, tmp_path):
    text = source.read_text().replace("Small rig", 'Small \\"rig\\" \\\\ äöü µ')
    source.write_text(text, encoding="utf-8")
    target = save_study(source, tmp_path / "new.toml", {}, {})
    assert load_study(target).title == 'Small "rig" \\ äöü µ' == load_study(source).title


def test_all_that_does_not_change_stays_as_it_was_written(source, tmp_path):
    lines = source.read_text().splitlines()
    lines.insert(lines.index("[parameters]"), "# Weighed on Monday.")
    gain = next(i for i, line in enumerate(lines) if line.startswith('"piezo.gain"'))
    lines[gain] += "  # of the data sheet"
    source.write_text("\n".join(lines) + "\n")
    first = save_study(source, tmp_path / "rig" / "first.toml", {"piezo.gain": 1.1e-7}, {})
    second = save_study(first, tmp_path / "rig" / "second.toml", {"piezo.gain": 1.2e-7}, {})
    head, *saved = second.read_text().splitlines()
    assert head.startswith("# Made by pdssjax explore from first.toml")
    assert saved[:gain] == lines[:gain] and saved[gain + 1 :] == lines[gain + 1 :]
    assert saved[gain].endswith("  # of the data sheet") and "1.2e-07" in saved[gain]


def test_a_number_that_the_study_left_out_is_added(source, tmp_path):
    target = save_study(source, tmp_path / "new.toml", {"piezo.mass": 0.01}, {})
    assert load_study(target).parameters["piezo.mass"].value == 0.01
