"""Commands load no more than they need: JAX takes most of a second, for which none waits that computes nothing."""

import subprocess
import sys

import pytest

from pdssjax.cli.main import COMMANDS
from pdssjax.files import EXAMPLE

PROGRAM = """
import sys
from pdssjax.cli.main import main
try:
    main(sys.argv[1:])
finally:
    print("loaded:", *(name for name in ("jax", "numpy", "pint", "threading") if name in sys.modules))
"""


def loaded(*arguments: str) -> set[str]:
    done = subprocess.run([sys.executable, "-c", PROGRAM, *arguments], capture_output=True, text=True, check=False)
    return set(done.stdout.rpartition("loaded:")[2].split())


@pytest.mark.parametrize("name", ["", *COMMANDS])
def test_help_loads_nothing_that_is_slow(name):
    assert not loaded(*name.split(), "--help")


def test_what_is_at_fault_in_the_options_is_said_as_soon():
    assert not loaded("identify", "nothing.toml")


def test_models_are_listed_without_any_library():
    assert not loaded("models") & {"jax", "numpy"}


def test_the_own_integrator_needs_no_other():
    program = "import sys, pdssjax; print(pdssjax.load_study(sys.argv[1]).accuracy); sys.exit('diffrax' in sys.modules)"
    study = str(EXAMPLE / "study.toml")
    done = subprocess.run([sys.executable, "-c", program, study], capture_output=True, text=True, check=True)
    assert "Taylor" in done.stdout


def test_channels_are_listed_without_jax():
    assert "jax" not in loaded("channels", str(EXAMPLE / "sawtooth_5Hz_A.csv"))
