"""Commit hooks and CI run the same linters as `make lint`."""

import re
from pathlib import Path

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
