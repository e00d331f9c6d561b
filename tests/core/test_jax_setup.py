"""Compiled code outlives the process where it may, a missing place for it is no trouble, and it is compiled lightly."""

import os
import subprocess
import sys

import pytest

from pdssjax import prepare_jax
from pdssjax.core.jax_setup import cache_folder

LIGHT = "--xla_cpu_use_fusion_emitters=false"
WHOLE = "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=1000000000"

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


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("", f"{LIGHT} {WHOLE}"),
        ("--xla_dump_to=somewhere", f"--xla_dump_to=somewhere {LIGHT} {WHOLE}"),
        (f"{WHOLE} {LIGHT}", f"{WHOLE} {LIGHT}"),
        ("--xla_cpu_use_fusion_emitters=true", f"--xla_cpu_use_fusion_emitters=true {WHOLE}"),
        ("--xla_backend_extra_options=a=1", f"--xla_backend_extra_options=a=1 {LIGHT}"),
        ("flags.txt", "flags.txt"),
    ],
)
def test_xla_is_told_how_to_compile_unless_it_was_told_otherwise(monkeypatch, given, told):
    """With the installed jaxlib, which knows the flags; a newer one must be looked at before it is told."""
    monkeypatch.setenv("XLA_FLAGS", given)
    prepare_jax()
    assert os.environ["XLA_FLAGS"] == told


def test_a_jaxlib_that_may_not_know_the_flag_is_not_told(monkeypatch):
    monkeypatch.setenv("XLA_FLAGS", "")
    monkeypatch.setattr("pdssjax.core.jax_setup.jaxlib_version", "99.0.0")
    prepare_jax()
    assert os.environ["XLA_FLAGS"] == ""
