"""A jaxlib that computes wrongly is refused, by Python and by the command; one that does not is checked once."""

import jax
import numpy as np
import pytest

from pdssjax import prepare_jax
from pdssjax.cli.main import main
from pdssjax.core import MiscompilationError, jax_setup


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
