"""Compiled code outlives the process where it may, a missing place for it is no trouble, and it is compiled lightly."""

import functools
import gc
import os
import subprocess
import sys

import pytest

from pdssjax import InputWarning, prepare_jax
from pdssjax.core.jax_setup import add_xla_flags, cache_folder, in_jaxlib, usable_cache, xla_flags

LIGHT = "--xla_cpu_use_fusion_emitters=false"
WHOLE = "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=1000000000"
LEVEL = "--xla_backend_optimization_level=1"
SUMS = "--xla_disable_hlo_passes=tree_reduction_rewriter"
PARTS = "--xla_cpu_parallel_codegen_split_count=1"

PROGRAM = """
from pdssjax.core import prepare_jax
prepare_jax(dedicated=DEDICATED)
import jax
print(jax.jit(lambda x: x + 1)(1.0).dtype)
"""


def run(cache, dedicated: bool = True) -> str:
    environment = os.environ | {"PDSSJAX_CACHE": str(cache)}
    command = [sys.executable, "-W", "error", "-c", PROGRAM.replace("DEDICATED", str(dedicated))]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.strip()


def test_the_cache_can_be_put_elsewhere(tmp_path, monkeypatch):
    monkeypatch.setenv("PDSSJAX_CACHE", str(tmp_path))
    assert cache_folder() == tmp_path


@pytest.mark.parametrize("dedicated", [True, False])
def test_functions_compiled_quickly_are_kept_only_on_request(tmp_path, dedicated):
    assert run(tmp_path / "cache", dedicated) == "float64"
    assert any((tmp_path / "cache").glob("jit__lambda*")) == dedicated


def test_other_settings_of_the_process_stay_as_they_are(monkeypatch):
    changed = []
    for name in ("raise_gc_threshold", "_share_free_memory"):
        monkeypatch.setattr(f"pdssjax.core.jax_setup.{name}", functools.partial(changed.append, name))
    thresholds = gc.get_threshold()
    gc.set_threshold(701, 11, 12)
    try:
        prepare_jax()
        assert gc.get_threshold() == (701, 11, 12)
        assert not changed
        prepare_jax(dedicated=True)
        assert set(changed) == {"raise_gc_threshold", "_share_free_memory"}
    finally:
        gc.set_threshold(*thresholds)


@pytest.mark.skipif(os.name != "posix", reason="permissions are those of POSIX")
def test_a_cache_that_others_may_write_to_is_not_used(tmp_path, monkeypatch):
    """Code that is found there is run."""
    monkeypatch.setenv("PDSSJAX_CACHE", str(tmp_path))
    tmp_path.chmod(0o777)
    with pytest.warns(InputWarning, match=r"others may write there.*chmod go-w"):
        assert usable_cache() is None
    tmp_path.chmod(0o755)
    assert usable_cache() == tmp_path


@pytest.mark.skipif(os.name != "posix", reason="permissions are those of POSIX")
def test_the_cache_is_made_for_its_user_alone(tmp_path, monkeypatch):
    monkeypatch.setenv("PDSSJAX_CACHE", str(tmp_path / "new"))
    assert usable_cache() == tmp_path / "new"
    assert (tmp_path / "new").stat().st_mode & 0o777 == 0o700


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
    monkeypatch.setenv("XLA_FLAGS", given)
    monkeypatch.setattr("pdssjax.core.jax_setup.xla_flags", lambda: [LIGHT, WHOLE])
    add_xla_flags()
    assert os.environ["XLA_FLAGS"] == told


@pytest.mark.parametrize(
    ("version", "flags"),
    [
        ("0.10.1", [LIGHT, WHOLE, LEVEL, SUMS, PARTS]),
        ("0.11.0", [LIGHT, WHOLE, LEVEL, SUMS, PARTS]),
        ("0.11.1", [WHOLE, LEVEL, SUMS, PARTS]),
        ("0.12.0.1", [WHOLE, LEVEL, SUMS, PARTS]),
        ("0.12.1.dev20261128", [WHOLE, LEVEL, SUMS, PARTS]),
    ],
)
def test_a_jaxlib_is_told_only_what_it_knows(monkeypatch, version, flags):
    """An unknown flag ends the process; an accelerator's code is compiled at XLA's own level."""
    plugins = []
    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: plugins)
    assert xla_flags(version) == flags
    plugins.append("cuda")
    assert xla_flags(version) == [flag for flag in flags if flag not in (LEVEL, SUMS)]


@pytest.mark.parametrize("held", [True, False])
def test_a_jaxlib_newer_than_was_tried_is_asked(monkeypatch, held):
    monkeypatch.setattr("pdssjax.core.jax_setup.in_jaxlib", lambda flag: held and flag == "xla_backend_extra_options")
    assert xla_flags("99.0") == [WHOLE] * held


def test_a_jaxlib_holds_the_names_of_its_flags():
    assert in_jaxlib("xla_backend_extra_options")
    assert in_jaxlib("xla_cpu_use_fusion_emitters") == (LIGHT in xla_flags())
    assert not in_jaxlib("xla_backend_extra_opti")
