"""Executables on disk: the same numbers without tracing again, for what has a name, and never in place of another."""

import os
import zlib
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pdssjax.core import forget_programs, keep_programs_in, kept_jit, kept_programs
from pdssjax.friction.coulomb import Coulomb

TRACED = []


class Pair(NamedTuple):
    twice: jax.Array
    solved: jax.Array


@kept_jit
def function(model, numbers, choice):
    TRACED.append(choice)
    matrix = jnp.eye(3) + numbers[:, None] * numbers
    return Pair((2.0 + isinstance(choice, bool)) * numbers, jnp.linalg.solve(matrix, choice * numbers))


@pytest.fixture
def folder(tmp_path):
    keep_programs_in(tmp_path, "here")
    TRACED.clear()
    yield tmp_path
    keep_programs_in(None, "")
    forget_programs()


@pytest.fixture
def choice(tmp_path):
    """A number that no other run has: JAX then has nothing of it in a cache of its own."""
    return 1.0 + zlib.crc32(f"{tmp_path} {np.datetime64('now')}".encode()) / 2**32


NUMBERS = np.array([1.0, 2.0, 3.0])


def test_the_next_process_does_not_trace(folder, choice):
    first = function(Coulomb(), NUMBERS, choice)
    forget_programs()
    again = function(Coulomb(), NUMBERS, choice)
    assert len(TRACED) == 1 and isinstance(again, Pair)
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    np.testing.assert_allclose(again.solved, np.linalg.solve(np.eye(3) + np.outer(NUMBERS, NUMBERS), choice * NUMBERS))
    np.testing.assert_array_equal(function(Coulomb(), 2.0 * NUMBERS, choice).twice, 4.0 * NUMBERS)
    assert len(TRACED) == 1


def test_choices_and_circumstances_make_another_program(folder, choice):
    function(Coulomb(), NUMBERS, choice)
    function(Coulomb(), NUMBERS, 2.0 * choice)
    forget_programs()
    keep_programs_in(folder, "there")
    function(Coulomb(), NUMBERS, choice)
    assert len(TRACED) == 3


def test_equal_choices_of_different_kinds_are_told_apart(folder):
    assert function(None, NUMBERS, 1).twice[0] == 2.0
    assert function(None, NUMBERS, True).twice[0] == 3.0


def test_arrays_and_choices_in_other_places_make_another_program(folder):
    @kept_jit
    def difference(first, second):
        return first - second

    three, array = 3.0, np.array(1.0)
    for _ in range(2):
        assert difference(three, array) == 2.0
        assert difference(array, three) == -2.0
        assert difference(array, 2.0 * array) == -1.0
        forget_programs()


def test_a_damaged_file_is_made_again(folder, choice):
    function(Coulomb(), NUMBERS, choice)
    (file,) = folder.iterdir()
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    forget_programs()
    np.testing.assert_array_equal(function(Coulomb(), NUMBERS, choice).twice, 2.0 * NUMBERS)
    assert len(TRACED) == 2


def test_models_of_other_packages_are_not_kept(folder, choice):
    class OfTheUser(eqx.Module):
        number: float = 1.0

    function(OfTheUser(), NUMBERS, choice)
    assert not list(folder.iterdir())


def test_a_process_holds_few(folder, choice):
    for k in range(9):
        function(None, NUMBERS, choice + k)
    function(None, NUMBERS, choice + 8)
    assert len(TRACED) == 9
    for file in folder.iterdir():
        file.unlink()
    function(None, NUMBERS, choice)
    assert len(TRACED) == 10


def test_what_was_used_the_longest_ago_is_removed(folder, choice, monkeypatch):
    (folder / "jit_old-cache").write_bytes(bytes(1000))  # as JAX keeps its own
    for k in range(2):
        function(None, NUMBERS, choice + k)
        for file in folder.iterdir():
            os.utime(file, (file.stat().st_atime, file.stat().st_mtime - 1000.0))
    forget_programs()
    function(None, NUMBERS, choice)  # the older one, used again
    (size,) = {round(file.stat().st_size, -3) for file in folder.glob("program-*")}
    monkeypatch.setattr(kept_programs, "_MOST_BYTES", 2 * size + 2000)
    function(None, NUMBERS, choice + 2)
    assert len(list(folder.iterdir())) == 2 and len(TRACED) == 3
    forget_programs()
    function(None, NUMBERS, choice)
    function(None, NUMBERS, choice + 2)
    assert len(TRACED) == 3


def test_within_a_trace_it_is_compiled_with_what_calls_it(folder):
    slope = jax.jit(jax.grad(lambda x: function(None, x * NUMBERS, 1.0).twice.sum()))(1.0)
    assert slope == pytest.approx(2.0 * NUMBERS.sum())
    assert not list(folder.iterdir())


@kept_jit
def calling_back(numbers):
    return jax.pure_callback(np.sin, numbers, numbers)


def test_what_calls_back_into_python_is_not_kept(folder):
    np.testing.assert_array_equal(calling_back(NUMBERS), np.sin(NUMBERS))
    assert not list(folder.iterdir())
