"""The report says what a user must know, in units people read and with digits that mean something."""

import dataclasses
import json

import fabricated
import numpy as np
import pytest

from pdssjax.core import decimals_for, display_unit, percent, rounded
from pdssjax.files import estimate_text
from pdssjax.report.text import format_comparison, format_report


def line_of(text: str, start: str) -> str:
    """The one line of `text` that begins with `start`, its runs of spaces made one."""
    (line,) = [line for line in text.splitlines() if line.strip().startswith(start)]
    return " ".join(line.split())


@pytest.mark.parametrize(
    ("value", "error", "expected"),
    [(54.4321, 6.2, "54.4"), (0.1007021, 7e-6, "0.1007021"), (6736.21, 120.0, "6736"), (0.086, float("nan"), "0.086")],
)
def test_a_value_has_as_many_decimals_as_its_error_deserves(value, error, expected):
    assert rounded(value, decimals_for(error)) == expected


def test_units_and_shares_are_those_people_read():
    assert display_unit("m/V") == ("um/V", 1e6)
    assert display_unit("rad/s") == ("rad/s", 1.0)
    assert percent(0.5, -50.0) == "1 %"
    assert percent(1.0, 0.0) == "-"


def test_a_parameter_is_shown_with_error_interval_and_start():
    line = line_of(format_report(fabricated.estimate()), "friction.sigma1_a")
    assert line == "friction.sigma1_a N s/m 54.4 6.2 11.4 % 42.0 .. 66.8 65.28"


@pytest.mark.parametrize(
    ("path", "remark"),
    [("effector.mass", "fixed"), ("drive.fall_time", "at bound"), ("effector.load", "no information")],
)
def test_what_is_special_about_a_parameter_is_said(path, remark):
    assert line_of(format_report(fabricated.estimate()), path).endswith(remark)


def test_an_interval_that_ends_at_a_bound_says_so_wherever_it_is_shown():
    found = fabricated.estimate()
    path, other = "friction.f_ss_a", "friction.sigma1_a"
    cut = dataclasses.replace(found.parameters[path], interval=(0.79, 0.8184), bounds=(0.79, np.inf))
    wide = dataclasses.replace(found.parameters[other], bounds=(0.0, np.inf))
    found = dataclasses.replace(found, parameters=found.parameters | {path: cut, other: wide})
    said = "interval ends at its lower bound"
    assert line_of(format_report(found), path).endswith(said)
    assert format_report(found).count(said) == 1 and found._repr_html_().count(said) == 1
    document = json.loads(estimate_text(found))["parameters"]
    assert document[path]["bounds"] == [0.79, None] and document[path]["interval_at_bound"] == ["lower"]
    assert document[other]["interval_at_bound"] == [] == document["effector.mass"]["interval_at_bound"]


@pytest.mark.parametrize(("verdict", "ends"), [("held by a bound", ("lower",)), ("flat", ())])
def test_an_open_end_of_a_profile_is_no_bound(verdict, ends):
    plain = fabricated.estimate().parameters["friction.f_ss_a"]
    found = dataclasses.replace(plain, interval=(0.0, 0.9), bounds=(0.0, np.inf), verdicts=(verdict, "bounded"))
    assert found.interval_at_bound == ends


def test_statistics_records_and_notes_are_there():
    text = format_report(fabricated.estimate())
    assert line_of(text, "reduced chi-square") == "reduced chi-square = 0.9987"
    assert line_of(text, "records fitted") == "records fitted = 2 of 4"
    assert line_of(text, "20 Hz A").startswith("20 Hz A validate 1600 0.9999999 0.0102")
    assert line_of(text, "lost/run").endswith("simulation failed")
    assert "The data say nothing about effector.load" in text.split("[[Notes]]")[1]
    assert text.isascii()


def test_correlations_come_strongest_first_and_small_ones_stay_out():
    text = format_report(fabricated.estimate()).split("[[Correlations")[1]
    sizes = [abs(float(line.split()[-1])) for line in text.splitlines() if "C(" in line]
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[0] == pytest.approx(0.835)
    assert min(sizes) >= 0.3


def test_a_fit_that_failed_says_so_at_the_top():
    text = format_report(fabricated.estimate(converged=False))
    assert line_of(text, "joint fit") == "joint fit DID NOT CONVERGE: No progress after 50 iterations."


def test_records_of_a_precise_sensor_keep_their_digits():
    whole = fabricated.estimate()
    quiet = dataclasses.replace(whole.records[0], rmse=5.1e-11, noise=4.9e-11, noise_estimated=False)
    text = format_report(dataclasses.replace(whole, records=(quiet, *whole.records[1:])))
    assert "0.000051" in text and "0.000049" in text


def test_a_fit_that_does_not_explain_its_records_does_not_count_as_converged():
    found = dataclasses.replace(fabricated.estimate(), explained=False)
    assert "joint fit CONVERGED, BUT DOES NOT EXPLAIN ITS RECORDS: The step" in format_report(found)
    assert (fabricated.estimate().success, found.success) == (True, False)
    assert "joint fit converged, but does not explain its records, 8 free" in repr(found)


def test_a_sequential_fit_shows_the_naive_error_beside_the_corrected_one():
    line = line_of(format_report(fabricated.estimate("sequential")).split("[[Amplification")[0], "friction.sigma1_a")
    assert "11.4 % 0.735 %" in line
    assert "naive" not in format_report(fabricated.estimate("joint"))


def test_a_fit_of_one_parameter_has_no_correlations():
    estimate = fabricated.estimate()
    alone = dataclasses.replace(estimate, names=estimate.names[:1], correlation=np.ones((1, 1)))
    assert format_report(alone).split("[[Correlations")[1].splitlines()[1].strip() == "none"


def test_what_the_stack_s_errors_do_to_the_friction_is_said_in_words():
    report = format_report(fabricated.estimate("sequential"))
    assert "1 % in piezo.gain moves friction.sigma1_a by 99 %." in report
    rows = [" ".join(line.split()) for line in report.splitlines()]
    assert "friction.sigma0_a -12.50 0.31 0.02" in rows
    assert "Amplification" not in format_report(fabricated.estimate("joint"))


def test_three_ways_stand_below_one_another_with_both_errors():
    ways = [fabricated.estimate(method) for method in ("joint", "sequential", "peaks")]
    moved = dataclasses.replace(ways[1].parameters["friction.sigma1_a"], value=60.6)
    ways[1] = dataclasses.replace(ways[1], parameters=ways[1].parameters | {moved.path: moved})
    text = format_comparison(*ways)
    rows = [" ".join(line.split()) for line in text.splitlines()]
    assert rows[0] == "[[Joint, sequential and peaks side by side]]"
    at = rows.index("friction.sigma1_a joint N s/m 54.4 11.4 %")
    # The shift is in standard errors with those of the stack in them.
    assert rows[at + 1] == "sequential 60.6 0.66 % 10.2 % 1.00"
    assert rows[at + 2] == "peaks 54.4 0.735 % 11.4 % 0.00"
    assert "1 % in piezo.gain moves friction.sigma1_a by 99 % and friction.sigma0_a by 12 %." in rows
    assert max(map(len, text.splitlines())) < 120


def test_errors_by_three_models_stand_side_by_side_with_the_one_to_believe():
    text = format_report(fabricated.with_errors(fabricated.estimate()))
    head = next(line for line in text.splitlines() if "+/-" in line)
    assert "white  coloured  with misfit  95 % interval" in head
    line = line_of(text, "friction.sigma1_a")
    assert line == "friction.sigma1_a N s/m 54.4 6.2 11.4 % 22.8 % 45.6 % 42.0 .. 66.8 65.28"
    assert line_of(text, "effector.load").startswith("effector.load N 0.1 - - - - - 0.12")
    words = " ".join(text.split())
    assert '+/- and interval: white. Believe the errors with misfit: residuals in "5 Hz A" repeat.' in words
    for model in ("white: covers the true", "coloured: covers where the fit would end", "with misfit: covers the phys"):
        assert model in words
    assert text.isascii()


def test_a_sequential_fit_has_its_naive_errors_beside_all_of_them():
    text = format_report(fabricated.with_errors(fabricated.estimate("sequential")))
    line = line_of(text.split("[[Amplification")[0], "friction.sigma1_a")
    assert "11.4 % 22.8 % 45.6 % 0.735 % 42.0 .. 66.8" in line


def test_profiles_say_how_far_the_ends_lie_from_the_linear_ones():
    whole = fabricated.estimate()
    parameters = dict(whole.parameters)
    parameters["friction.sigma1_a"] = dataclasses.replace(parameters["friction.sigma1_a"], verdicts=("bounded", "flat"))
    for path in ("piezo.gain", "friction.sigma0_a"):
        parameters[path] = dataclasses.replace(parameters[path], verdicts=("bounded", "bounded"))
    profiles = list(fabricated.profiles(parameters))
    profiles[1] = dataclasses.replace(profiles[1], linear=profiles[1].linear * np.linspace(0.25, 1.44, 25))
    text = format_report(dataclasses.replace(whole, parameters=parameters, profiles=tuple(profiles)))
    assert "[[Profiles of chi-square]]" in text and "[[Profiles" not in format_report(whole)
    below = text[text.index("[[Profiles") :]
    assert line_of(below, "piezo.gain") == "piezo.gain bounded 1.00 1.00 0.97"
    assert line_of(below, "friction.sigma0_a") == "friction.sigma0_a bounded 0.50 1.20 0.97"
    assert line_of(below, "friction.sigma1_a") == "friction.sigma1_a one-sided 1.00 - 0.97"
    assert line_of(below, "drive.fall_time") == "drive.fall_time held by a bound: the estimate lies there - - -"
    assert line_of(below, "effector.load") == "effector.load flat: no information - - -"


def test_draws_are_summed_up_beside_the_linear_errors():
    whole = fabricated.estimate()
    boot, posterior = (
        format_report(dataclasses.replace(whole, draws=fabricated.draws(whole.parameters, kind)))
        for kind in ("bootstrap", "posterior")
    )
    assert "40 replicates, seed 5; 3 did not converge and are left out" in boot
    line = line_of(boot[boot.index("[[Bootstrap]]") :], "friction.sigma1_a")
    assert "42.0 .. 66.8" in line and "43.2 .. 68.0" in line and line.endswith("6.2")
    assert "4 chains of 25 draws, seed 5; 3 proposals refused by the model" in posterior
    assert line_of(posterior[posterior.index("[[Posterior]]") :], "friction.sigma1_a").endswith("1.004 644")


def test_starts_are_counted_by_the_optimum_they_led_to():
    whole = fabricated.estimate()
    text = format_report(dataclasses.replace(whole, multistart=fabricated.multistart(whole.parameters)))
    assert "20 starts, 18 of them converged, to 3 distinct optima" in text
    below = text[text.index("[[Starts]]") :]
    assert [line_of(below, f"{n} ").split() for n in (1, 2, 3)] == [
        ["1", "12", "0"],
        ["2", "4", "31"],
        ["3", "2", "420"],
    ]


def test_with_profile_or_drawn_intervals_the_legend_says_so():
    whole = fabricated.with_errors(fabricated.estimate())
    path = "friction.sigma1_a"
    profiled = dataclasses.replace(whole.parameters[path], verdicts=("bounded", "bounded"))
    text = format_report(dataclasses.replace(whole, parameters=whole.parameters | {path: profiled}))
    assert "+/-: white; interval: by profile likelihood. Believe" in " ".join(text.split())
    drawn = dataclasses.replace(whole, draws=fabricated.draws(whole.parameters, "bootstrap"))
    assert "+/-: white; interval: by bootstrap. Believe" in " ".join(format_report(drawn).split())
