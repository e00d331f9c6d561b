"""A measured stack with hysteresis and creep is identified from no starts in 1 GB, and foretells what was held out."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import pdssjax

COMMAND = """
import sys
from pdssjax.cli.main import main
status = main(sys.argv[1:])
peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))
print(status, peak.split()[1])
"""

STUDY = Path(__file__).parents[2] / "experiments" / "aye2018" / "study.toml"


@pytest.mark.slow
def test_the_second_half_of_a_measured_record_is_foretold_by_the_first():
    estimate = pdssjax.identify(pdssjax.load_study(STUDY))
    fitted, held_out = estimate.records
    assert estimate.converged
    assert fitted.rmse < 0.20e-6
    residual = held_out.measured - held_out.predicted
    # Gain alone leaves 3.3 um of this half, a lag without hysteresis 0.47, play elements without asymmetry 0.32.
    assert np.std(residual) < 0.20e-6
    creep = [estimate.parameters[f"piezo.creep_{j}"] for j in (1, 2)]
    assert any(c.value > 3.0 * c.standard_error for c in creep if c.identifiable and not c.at_bound)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="Linux tells the peak of one process alone")
def test_the_very_first_run_of_the_command_stays_below_a_gigabyte(tmp_path):
    """With nothing compiled, figures and all: 0.9 GB (1.3 GB without `core.jax_setup`'s light compilation)."""
    environment = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"}
    environment |= {"PDSSJAX_CACHE": str(tmp_path / "cache"), "PYTHONPATH": str(STUDY.parents[2])}
    command = [sys.executable, "-c", COMMAND, "identify", str(STUDY), "--out", str(tmp_path / "out")]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    status, kilobytes = done.stdout.split()[-2:]
    assert int(status) == 3  # it converges, and leaves more than noise
    assert 1024 * int(kilobytes) < 1e9
