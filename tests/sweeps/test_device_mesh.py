"""Several devices find what one finds: here CPUs that XLA makes of one machine."""

import json
import os
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from quick_blocks import example_study

import pdssjax
from pdssjax.sweeps.blocks import shared_out

ROOT = Path(__file__).parents[2]
HALVED = """\
import jax, json
import jax.numpy as jnp
from pdssjax.sweeps.blocks import default_workers, lanes_here, shared_out, whole_shares
from test_device_mesh import POINTS, turns
found = jax.jit(lambda points: shared_out(jax.vmap(turns), points))(POINTS)
print(json.dumps([found.tolist(), len(found.devices()), whole_shares(7), lanes_here(), default_workers()]))
"""
SWEPT = """\
import numpy as np, sys
from pdssjax import prepare_jax
prepare_jax()
from test_device_mesh import found_by_a_sweep
np.savez(sys.argv[1], **found_by_a_sweep())
"""
POINTS = jnp.array([[1.0], [300.0], [7.0], [1e6], [2.0], [90.0]])


def turns(point):
    """A loop that ends at another turn for every point."""
    return jax.lax.while_loop(lambda now: now[0] > 1.5, lambda now: (now[0] / 2, now[1] + 1), (point[0], 0))[1]


def run(program, devices, *arguments):
    """What a process with so many devices prints."""
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count={devices}"
    path = os.pathsep.join(map(str, [ROOT, ROOT / "tests" / "sweeps", ROOT / "tests" / "helpers"]))
    environment = os.environ | {"XLA_FLAGS": flags, "PYTHONPATH": path}
    command = [sys.executable, "-c", program, *map(str, arguments)]
    return subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout


def test_loops_of_unlike_lengths_are_shared_out_over_three_devices():
    expected = [turns(point).tolist() for point in POINTS]
    assert shared_out(jax.vmap(turns), POINTS).tolist() == expected and len(set(expected)) == 6
    assert json.loads(run(HALVED, 3)) == [expected, 3, 9, 192, 2]


def found_by_a_sweep():
    """Steady cycles of the example, of which some are left to Newton's method, with what is found besides."""
    study = example_study()
    light = study.with_values({"piezo.damping_ratio": 0.004, "friction.sigma1_a": 1.0, "friction.sigma1_b": 1.0})
    over = {"drive.voltage": np.array([3.0]), "drive.frequency": np.array([5.0, 150.0, 200.0])}
    data = {
        "": pdssjax.sweep(study, {"drive.voltage": np.linspace(8.0, 150.0, 70)}, cycles="steady"),
        "light_": pdssjax.sweep(light, over, cycles="steady", metrics=["peak_friction"]),
    }
    return {f"{of}{name}": np.asarray(found[name]) for of, found in data.items() for name in found.data_vars}


@pytest.mark.slow
def test_a_sweep_over_eight_devices_is_that_of_one(tmp_path):
    run(SWEPT, 8, tmp_path / "eight.npz")
    eight, single = np.load(tmp_path / "eight.npz"), found_by_a_sweep()
    assert not eight["failure"].any() and (eight["light_cycles_to_repeat"] == 1).all() and set(eight) == set(single)
    for name, found in single.items():
        np.testing.assert_allclose(eight[name], found, rtol=1e-14, atol=1e-14, err_msg=name)
