"""Compiled code outlives the process where it may, and a missing place for it is no trouble."""

import os
import subprocess
import sys

import pytest

from pdssjax.core.jax_setup import cache_folder

PROGRAM = """
from pdssjax.core import prepare_jax
prepare_jax()
import jax
print(jax.jit(lambda x: x + 1)(1.0).dtype)
"""


def run(cache) -> str:
    environment = os.environ | {"PDSSJAX_CACHE": str(cache)}
    command = [sys.executable, "-W", "error", "-c", PROGRAM]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.strip()


def test_the_cache_can_be_put_elsewhere(tmp_path, monkeypatch):
    monkeypatch.setenv("PDSSJAX_CACHE", str(tmp_path))
    assert cache_folder() == tmp_path


def test_compiled_code_is_kept(tmp_path):
    assert run(tmp_path / "cache") == "float64"
    assert any((tmp_path / "cache").iterdir())


@pytest.mark.parametrize("place", ["file", "file/below"])
def test_without_a_place_for_the_cache_all_else_works(tmp_path, place):
    (tmp_path / "file").write_text("")
    assert run(tmp_path / place) == "float64"
