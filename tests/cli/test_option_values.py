"""Values of options are judged before any work, each refusal in a line."""

import argparse
import contextlib
import importlib
import io
import sys

import pytest
from platform_study import PLATFORM, write_platform

import pdssjax
from pdssjax.cli import main as cli
from pdssjax.cli.main import COMMANDS
from pdssjax.core import MOST_SEED, check_executor

pytestmark = pytest.mark.usefixtures("undrawn")
NEEDED = {
    "identify": ["--out", "out"],
    "simulate": ["study.toml", "--out", "out"],
    "record": ["study.toml", "--out", "out"],
    "sweep": ["study.toml", "--out", "out"],
    "characterise": ["file.csv", "--out", "out"],
    "new": ["folder", "--files", "file.csv"],
    "channels": ["file.csv"],
    "example": ["folder"],
    "explore": ["study.toml"],
    "design": ["study.toml", "--budget", "samples=100", "--out", "out"],
}
"""What a command cannot do without."""


def options_of(name):
    """The options of a command that take a value."""
    parser = argparse.ArgumentParser()
    importlib.import_module(f"pdssjax.cli.{name}").add_options(parser)
    return [a for a in parser._actions if a.option_strings and a.nargs != 0 and a.dest != "help"]


WHOLE = [(name, action.option_strings[-1]) for name in COMMANDS for action in options_of(name) if callable(action.type)]
WHOLE = [(name, option) for name, option in WHOLE if option not in ("--out", "--estimate", "--files", "--sweep")]


def refused(arguments, capsys):
    """What is said where a command is refused."""
    assert cli.main(arguments) == 2, arguments
    printed = capsys.readouterr()
    assert not printed.out
    (line,) = printed.err.strip().splitlines()
    return line


def test_options_that_are_whole_numbers_are_known():
    assert {option for _, option in WHOLE} == {
        *("--starts", "--replicates", "--draws", "--seed", "--workers", "--cycles", "--port")
    }
    assert not any(action.type in (int, float) for name in COMMANDS for action in options_of(name))


@pytest.mark.parametrize(("name", "option"), WHOLE)
def test_a_whole_number_out_of_its_range_is_refused_before_any_work_and_its_ends_are_taken(name, option, capsys):
    for value in ("-1", "1.5", "nan", "inf", "1e999", "x", "", "--", "1_0", "9" * 5000, str(2**64)):
        line = refused([name, *NEEDED[name], f"{option}={value}"], capsys)
        assert line.startswith(f"pdssjax: error: option {option}: found ") and "expected" in line and len(line) < 200
    command = argparse.ArgumentParser()
    importlib.import_module(f"pdssjax.cli.{name}").add_options(command)
    taken = lambda value: vars(command.parse_args([*NEEDED[name], f"{option}={value}"]))[option[2:]]
    assert taken("12") == 12 and (option != "--seed" or taken(str(MOST_SEED)) == MOST_SEED)
    assert option != "--cycles" or taken("steady") == "steady"


def test_a_nul_is_refused(capsys):
    said = refused(["simulate", "study.toml", "--out", "o\0ut"], capsys)
    assert said.startswith("pdssjax: error: argument 'o\\x00ut': found a NUL character")


@pytest.mark.parametrize("name", NEEDED)
def test_two_dashes_are_no_value(name, capsys):
    for action in options_of(name):
        option = action.option_strings[-1]
        assert refused([name, *NEEDED[name], f"{option}=--"], capsys).startswith(
            f"pdssjax: error: option {option}: found"
        )


NEW = ["new", *NEEDED["new"]]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["characterise", "a.csv", "--frequency", "0"], "option --frequency: found 0 Hz, expected a number above 0."),
        (["characterise", "a.csv", "--frequency="], "option --frequency"),
        (["characterise", "a.csv", "--slip-duration=-1 ms"], "found -0.001 s, expected a number of at least 0."),
        (["characterise", "a.csv", "--window", "nan", "1"], "option --window: found nan, expected a finite number"),
        ([*NEW, "--unit", "speed=m"], "option --unit"),
        ([*NEW, "--interval", "0 s"], "option --interval"),
        ([*NEW, "--frequency", "0"], "option --frequency: found 0 Hz, expected a number above 0"),
        ([*NEW, "--scale", "voltage"], "option --scale"),
        ([*NEW, "--scale", "voltage=0"], 'option --scale: found "voltage=0'),
        ([*NEW, "--scale", "voltage=0 V/V"], 'option --scale: found "voltage=0'),
        ([*NEW, "--scale", "voltage=nan"], 'option --scale: found "voltage=nan"'),
        ([*NEW, "--peak", "0 V"], "option --peak: found 0 V, expected a voltage that is not 0"),
        ([*NEW, "--mass", "3 m"], "option --mass"),
        ([*NEW, "--mass", "-45 g"], "option --mass: found -0.045 kg, expected a number above 0"),
        ([*NEW, "--mass", "inf"], "option --mass: found inf, expected a finite number"),
    ],
)
def test_a_number_out_of_its_range_is_refused(arguments, said, capsys):
    assert said in refused(arguments, capsys)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--sample", "sobol:" + "9" * 5000], "option --sample: found 999999"),
        (["--sample", "sobol:0"], "option --sample: found 0, expected at least 1"),
        (["--sample", "sobol:-1"], "option --sample: found -1, expected at least 1"),
        (["--voltage", "1:2:" + "9" * 5000], "number of values"),
        (["--voltage", "nan:2:3"], "expected a finite number"),
    ],
)
def test_counts_of_points_are_refused(tmp_path, options, said, capsys, monkeypatch):
    monkeypatch.setattr("pdssjax.cli.sweep.study_of", lambda options: pdssjax.load_study(options.study))
    cli.main(["example", str(tmp_path / "rig")])
    capsys.readouterr()
    study = tmp_path / "rig" / "study.toml"
    assert said in refused(["sweep", str(study), "--out", str(tmp_path / "out"), *options], capsys)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "utf-8"])
def test_letters_that_a_console_does_not_have_cost_no_results(tmp_path, encoding):
    text = PLATFORM.replace('title = "', 'title = "μ-Tisch 步 ') if 'title = "' in PLATFORM else PLATFORM
    text = text.replace('name = "step"', 'name = "步進"')
    assert "步" in text
    study = write_platform(tmp_path, text)
    shown = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    with contextlib.redirect_stdout(shown):
        assert cli.main(["simulate", str(study), "--guess", "--out", str(tmp_path / "out")]) == 0
    shown.flush()
    told = shown.buffer.getvalue().decode(encoding)
    assert ("步進" in told) == (encoding == "utf-8") and "Results are in" in told
    assert [path.name for path in (tmp_path / "out" / "predictions").iterdir()] == ["步進.csv"]


def test_an_executor_that_forks_is_refused(tmp_path):
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

    for executor in (None, ThreadPoolExecutor(1), ProcessPoolExecutor(mp_context=multiprocessing.get_context("spawn"))):
        check_executor(executor)
    if sys.platform != "linux":
        return
    forks = ProcessPoolExecutor(mp_context=multiprocessing.get_context("fork"))
    said = r'executor: found a ProcessPoolExecutor whose processes are forked.*get_context\("spawn"\)'
    study = pdssjax.load_study(write_platform(tmp_path))
    for asked in (
        lambda: pdssjax.identify(study, intervals="bootstrap", executor=forks),
        lambda: pdssjax.sweep(study, {}, executor=forks),
    ):
        with pytest.raises(pdssjax.InputError, match=said):
            asked()


@pytest.mark.parametrize("name", ["workers", "in_flight"])
def test_workers_are_whole_numbers(tmp_path, name):
    study = pdssjax.load_study(write_platform(tmp_path))
    for number in (0, -1, 1.5, "2"):
        with pytest.raises(pdssjax.InputError, match=f"{name}: found"):
            pdssjax.sweep(study, {}, **{name: number})
