"""JAX as a program sets it up: what is compiled is kept where it may be, light and checked; one BLAS thread."""

import functools
import gc
import os
import subprocess
import sys

import jax
import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from pdssjax import InputWarning, prepare_jax
from pdssjax.cli.main import main
from pdssjax.core import MiscompilationError, jax_setup, one_blas_thread
from pdssjax.core.jax_setup import add_xla_flags, cache_folder, in_jaxlib, usable_cache, xla_flags

LIGHT = "--xla_cpu_use_fusion_emitters=false"
WHOLE = "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=1000000000"
LEVEL = "--xla_backend_optimization_level=1"
PASSES = "--xla_disable_hlo_passes=tree_reduction_rewriter,while-loop-invariant-code-motion"
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
        ("0.10.1", [LIGHT, WHOLE, LEVEL, PASSES, PARTS]),
        ("0.11.0", [LIGHT, WHOLE, LEVEL, PASSES, PARTS]),
        ("0.11.1", [WHOLE, LEVEL, PASSES, PARTS]),
        ("0.12.0.1", [WHOLE, LEVEL, PASSES, PARTS]),
        ("0.12.1.dev20261128", [WHOLE, LEVEL, PASSES, PARTS]),
    ],
)
def test_a_jaxlib_is_told_only_what_it_knows(monkeypatch, version, flags):
    """An unknown flag ends the process; an accelerator's code is compiled at XLA's own level."""
    plugins = []
    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: plugins)
    assert xla_flags(version) == flags
    plugins.append("cuda")
    assert xla_flags(version) == [flag for flag in flags if flag not in (LEVEL, PASSES)]


@pytest.mark.parametrize("held", [True, False])
def test_a_jaxlib_newer_than_was_tried_is_asked(monkeypatch, held):
    monkeypatch.setattr("pdssjax.core.jax_setup.in_jaxlib", lambda flag: held and flag == "xla_backend_extra_options")
    assert xla_flags("99.0") == [WHOLE] * held


def test_a_jaxlib_holds_the_names_of_its_flags():
    assert in_jaxlib("xla_backend_extra_options")
    assert in_jaxlib("xla_cpu_use_fusion_emitters") == (LIGHT in xla_flags())
    assert not in_jaxlib("xla_backend_extra_opti")


def last_row_lost(matrix, rows):
    """What jaxlib 0.10.2 makes of the squares."""
    found = np.sum((rows @ matrix) ** 2, axis=1)
    found[-1] = found[-2]
    return found


@pytest.fixture
def miscompiled(monkeypatch, tmp_path):
    monkeypatch.setenv("PDSSJAX_CACHE", str(tmp_path))
    monkeypatch.setattr(jax_setup, "_squares", last_row_lost)
    jax_setup._run_once.cache_clear()
    before = jax.config.jax_compilation_cache_dir
    yield tmp_path
    jax.config.update("jax_compilation_cache_dir", before)
    jax_setup._run_once.cache_clear()


def test_a_wrong_result_is_refused_with_what_was_computed_and_what_to_install(miscompiled):
    for _ in range(2):  # it is never taken for checked
        with pytest.raises(MiscompilationError) as raised:
            prepare_jax()
    message = str(raised.value)
    assert f"jaxlib {jax_setup.jaxlib_version} computes wrongly" in message
    assert "row 16384: found 268402689, expected 268435456" in message
    assert f"pip install 'jax>=0.10.1,!={jax_setup.jaxlib_version}'" in message
    assert not list(miscompiled.glob("compiler-checked-*"))


def test_without_a_cache_it_is_refused_too(miscompiled):
    with pytest.raises(MiscompilationError, match="computes wrongly"):
        jax_setup.check_compiler(None)


def test_the_command_line_refuses(miscompiled, capsys):
    assert main(["identify", "--out", str(miscompiled / "out")]) == 2
    assert "computes wrongly" in capsys.readouterr().err
    assert not (miscompiled / "out").exists()


def test_a_right_result_is_checked_once_for_a_jaxlib_and_its_flags(tmp_path, monkeypatch):
    """The package's own run, compiled."""
    jax_setup._run_once.cache_clear()
    jax_setup.check_compiler(tmp_path)
    (stamp,) = tmp_path.glob("compiler-checked-*")
    monkeypatch.setattr(jax_setup, "_squares", last_row_lost)
    jax_setup._run_once.cache_clear()
    jax_setup.check_compiler(tmp_path)
    assert list(tmp_path.glob("compiler-checked-*")) == [stamp]
    monkeypatch.setenv("XLA_FLAGS", "--xla_cpu_enable_fast_math=true")
    with pytest.raises(MiscompilationError, match="with XLA_FLAGS=--xla_cpu_enable_fast_math=true"):
        jax_setup.check_compiler(tmp_path)


def threads():
    np.linalg.qr(np.eye(3))
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


def test_within_it_is_one_and_afterwards_what_it_was():
    with threadpool_limits(2, user_api="blas"):
        with one_blas_thread():
            assert threads() == {1}
        assert threads() == {2}


def test_a_function_that_raises_leaves_it_as_it_was():
    @one_blas_thread()
    def failing():
        assert threads() == {1}
        raise KeyError

    with threadpool_limits(2, user_api="blas"):
        for _ in range(2):
            try:
                failing()
            except KeyError:
                assert threads() == {2}
