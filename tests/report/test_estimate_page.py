"""The page of an identification says what the plain report says, and draws what there is."""

import dataclasses

import fabricated
import numpy as np
import pytest

from pdssjax import InputError
from pdssjax.core import percent
from pdssjax.report.page import Share, estimate_page
from pdssjax.study import Combination, Diagnosis, ErrorAdvice, Provenance, Remedy


def sections(estimate) -> dict:
    """By heading."""
    return {section.heading: section for section in estimate_page(estimate).sections}


def brief(**changes):
    """An estimate of one record."""
    estimate = fabricated.estimate()
    return dataclasses.replace(estimate, **{"records": estimate.records[:1], **changes})


def made():
    """An estimate with errors by three models, and what a command leaves in it."""
    estimate = fabricated.with_errors(fabricated.estimate())
    records = tuple(
        dataclasses.replace(record, excitation=f"sawtooth, 64.2 V, {n} Hz", file=f"run{n}.csv")
        for n, record in enumerate(estimate.records)
    )
    return dataclasses.replace(
        estimate,
        records=records,
        actuator={
            "piezo": "second-order",
            "friction": "anisotropic-lugre",
            "friction_state": "force",
            "feedback": True,
        },
        provenance=Provenance("pdssjax identify rig.toml --out x", "rig.toml", {"jax": "0.10.1"}),
    )


@pytest.fixture(scope="module")
def shown():
    return sections(made())


def test_the_outcome_is_told_in_sentences(shown):
    text = " ".join(shown["Result"].text)
    assert text.startswith("The joint fit converged: The step became smaller than the tolerance.")
    assert "8 parameters and 5 sensor zeros were fitted to 5605 samples of 2 records" in text
    assert "The reduced chi-square is 0.9987" in text
    assert (
        f"20 Hz A: residual {1e6 * made().records[2].rmse:.3g} µm rms" in text
        and "lost/run: the simulation failed" in text
    )
    assert "The records do not determine effector.load." in text
    assert shown["Findings"].points == made().notes


def test_what_failed_is_told_first():
    text = sections(brief(explained=False))["Result"].text
    assert "does not explain its records" in text[0] and "lacks something" in text[1]
    assert "did not converge" in sections(brief(converged=False))["Result"].text[0]


def test_what_was_measured_is_a_table_with_files_and_excitation(shown):
    (table,) = shown["What was measured"].tables
    row = dict(zip(table.head, table.rows[1], strict=True))
    assert row["record"] == "5 Hz A" and row["samples"] == "1600" and row["file"] == "run1.csv"
    assert row["excitation"] == "sawtooth, 64.2 V, 1 Hz" and row["interval (ms)"] == "1"
    assert row["noise"] == "0.0104 µm, given"
    assert "file" not in sections(brief())["What was measured"].tables[0].head


def test_what_was_fitted_names_models_and_way(shown):
    (table,) = shown["What was fitted"].tables
    told = {row[0]: row[1:] for row in table.rows}
    assert told["friction model"][0] == "anisotropic-lugre" and "LuGre" in told["friction model"][1]
    assert told["state of the law"][0] == "force" and told["friction feedback"][0] == "yes"


def test_parameters_have_value_error_bar_interval_and_meaning(shown):
    table = shown["Parameters"].tables[0]
    rows = {row[0]: dict(zip(table.head, row, strict=True)) for row in table.rows}
    gain, parameter = rows["piezo.gain"], made().parameters["piezo.gain"]
    assert gain["value"] == "0.1007020" and gain["standard error"] == "0.0000070" and gain["unit"] == "µm/V"
    assert isinstance(gain["relative error"], Share)
    assert gain["relative error"].text == percent(parameter.standard_error, parameter.value)
    assert gain["what it is"] == "Steady displacement per volt C"
    bars = [row["relative error"].share for row in rows.values() if isinstance(row["relative error"], Share)]
    assert max(bars) == rows["friction.sigma1_a"]["relative error"].share <= 1.0
    assert rows["effector.mass"]["what it is"].startswith("Fixed. Moving mass")
    assert rows["effector.load"]["what it is"].startswith("No information")
    assert rows["effector.mass"]["standard error"] == rows["effector.mass"]["95 % interval"] == ""
    further = shown["Parameters"].tables[1]
    assert further.head == ["parameter", "white", "coloured", "with misfit", "start", "unit"]
    assert shown["Parameters"].text[0] == made().error_advice.reason


def test_a_sequential_fit_shows_naive_errors_and_amplification():
    shown = sections(brief(method="sequential"))
    assert "naive" in shown["Parameters"].tables[1].head
    assert "Amplification of errors" in shown and shown["Amplification of errors"].figures


def test_strong_correlations_products_and_remedy_are_named():
    diagnosis = Diagnosis(
        (Combination({"piezo.gain": 1.0, "friction.sigma1_a": -0.5}, 0.1), Combination({"piezo.gain": 1.0}, 0.01)),
        Remedy("effector.mass", {"friction.sigma1_a": (0.1, 0.03)}),
        (),
    )
    estimate = brief(diagnosis=diagnosis)
    correlation = estimate.correlation.copy()
    correlation[0, 1] = correlation[1, 0] = -0.93
    shown = sections(dataclasses.replace(estimate, correlation=correlation))["Correlations"]
    assert shown.tables[0].rows[0] == ["piezo.gain", "piezo.natural_frequency", "-0.930"]
    assert shown.tables[1].rows[0] == ["least", "piezo.gain · friction.sigma1_a^-0.50", "10 %"]
    assert "If effector.mass were known from elsewhere" in shown.text[-1]
    calm = dataclasses.replace(estimate, correlation=np.eye(len(estimate.names)), diagnosis=None)
    assert "No two parameters are correlated by 0.7" in sections(calm)["Correlations"].text[0]


def test_every_record_is_drawn_and_described(shown):
    figures = shown["Measured and predicted"].figures
    assert len(figures) == len(made().records)
    assert figures[1].caption == '"5 Hz A": displacement of the effector, sawtooth, 64.2 V, 1 Hz.'
    assert f"residual {1e6 * made().records[1].rmse:.3g} µm rms" in figures[1].description
    residuals = shown["Residuals: misfit and noise"]
    assert residuals.folded and len(residuals.figures) == 2


def test_records_without_samples_are_listed_and_not_drawn():
    none = np.zeros(0)
    estimate = fabricated.estimate()
    records = tuple(dataclasses.replace(r, time=none, measured=none, predicted=none) for r in estimate.records)
    shown = sections(dataclasses.replace(estimate, records=records))
    assert len(shown["Measured and predicted"].tables[0].rows) == 4
    assert not shown["Measured and predicted"].figures
    assert "no samples in this folder" in shown["Measured and predicted"].text[0]
    assert "Residuals: misfit and noise" not in shown


def test_profiles_draws_and_starts_have_sections_of_their_own():
    estimate = brief()
    estimate = dataclasses.replace(
        estimate,
        profiles=fabricated.profiles(estimate.parameters),
        multistart=fabricated.multistart(estimate.parameters),
        draws=fabricated.draws(estimate.parameters, "posterior"),
        error_advice=ErrorAdvice("white", "Believe the white errors."),
    )
    shown = sections(estimate)
    for heading in ("Profiles of chi-square", "Posterior", "Other starts"):
        assert shown[heading].figures and shown[heading].lines
        assert not any(line.startswith("[[") for line in shown[heading].lines)


def test_it_can_be_repeated(shown):
    assert shown["How to repeat it"].lines == ["pdssjax identify rig.toml --out x"]
    assert shown["How to repeat it"].tables[0].rows == [["jax", "0.10.1"]]
    by_program = brief(method="sequential", provenance=Provenance(study="rig's.toml"))
    lines = "\n".join(sections(by_program)["How to repeat it"].lines)
    compile(lines, "page", "exec")
    assert """load_study("rig's.toml")""" in lines and "method='sequential'" in lines
    unknown = brief()
    assert "do not say" in sections(unknown)["How to repeat it"].text[-1]


def test_an_estimate_writes_its_page(tmp_path):
    estimate = brief(title="<script>alert(1)</script>")
    estimate.report(tmp_path / "rig.html")
    text = (tmp_path / "rig.html").read_text(encoding="utf-8")
    assert "<script>alert" not in text and "&lt;script&gt;alert(1)&lt;/script&gt;" in text
    with pytest.raises(InputError, match="found a file there already"):
        estimate.report(tmp_path / "rig.html")
    estimate.report(tmp_path / "rig.html", overwrite=True)
