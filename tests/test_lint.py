"""Commit hooks and CI run the same linters as `make lint`."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def test_the_hooks_run_the_commands_of_make_lint():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    recipe = re.search(r"^lint:.*\n((?:\t.*\n)+)", makefile, re.M)
    folder = re.search(r"^BIN := (.+)$", makefile, re.M)
    assert recipe and folder
    commands = [line.strip().replace("$(BIN)", folder[1]) for line in recipe[1].splitlines()]
    hooks = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    assert re.findall(r"^ +entry: (.+)$", hooks, re.M) == commands
    assert set(re.findall(r"^ +language: (.+)$", hooks, re.M)) == {"system"}, "hooks need no network"


def test_ci_runs_make_lint():
    assert "\nmake lint\n" in (ROOT / ".ci/run").read_text(encoding="utf-8")


def programs() -> dict[str, str]:
    """The programs that benchmarks hand to fresh processes, which no linter sees: strings of several lines."""
    found = {}
    for path in sorted((ROOT / "benchmarks").rglob("*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            text = node.value.value if isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant) else None
            if isinstance(text, str) and "\nimport " in text:
                found[f"{path.stem} {ast.unparse(node.targets[0])}"] = text
    return found


@pytest.mark.parametrize("name", programs())
def test_programs_for_fresh_processes_use_no_name_before_it_is_there(name):
    command = [str(Path(sys.executable).with_name("ruff")), "check", "--isolated", "--select", "F821,F823", "-"]
    run = subprocess.run(command, input=programs()[name], capture_output=True, text=True)
    assert run.returncode == 0, run.stdout
