"""A Dask cluster and several devices find what one finds; what is wrong with a cluster is told in a line."""

import importlib.metadata
import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from quick_blocks import example_study, quick as quick

import pdssjax
from pdssjax import InputError
from pdssjax.files import SweepStore
from pdssjax.sweeps import cluster_executor, execution
from pdssjax.sweeps.blocks import map_over_devices
from pdssjax.sweeps.execution import package_version

NEEDED = pytest.mark.skipif(importlib.util.find_spec("distributed") is None, reason="needs pdssjax[cluster]")


class Client:
    """Stands in for that of `distributed`."""

    def __init__(self, address, timeout, set_as_default):
        self.threads, self.versions = CLUSTERS[address]
        if self.threads is None:
            raise OSError(f"Timed out trying to connect to {address} after {timeout:g} s\nand a long tail")

    def nthreads(self):
        return self.threads

    def run(self, function, *given, on_error):
        assert (function, given, on_error) == (importlib.metadata.version, ("pdssjax",), "return")
        return self.versions

    def get_executor(self, **how):
        return SimpleNamespace(how=how)

    def close(self):
        pass


HERE = package_version()
CLUSTERS = {
    "tcp://good:1": ({"a": 2, "b": 1}, {"a": HERE, "b": HERE}),
    "tcp://nobody:1": (None, None),
    "tcp://empty:1": ({}, {}),
    "tcp://old:1": ({"a": 1, "b": 1}, {"a": HERE, "b": "0.0.1"}),
    "tcp://bare:1": ({"a": 1}, {"a": importlib.metadata.PackageNotFoundError("pdssjax")}),
}


@pytest.fixture
def distributed(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", SimpleNamespace(Client=Client))


def test_a_cluster_gives_its_executor_and_its_threads(distributed):
    with cluster_executor("tcp://good:1") as (executor, threads):
        assert threads == 3 and executor.how["pure"] is False


@pytest.mark.parametrize(
    ("address", "essential"),
    [
        ("tcp://nobody:1", "found none that answers (Timed out trying to connect to tcp://nobody:1 after 10 s)"),
        ("tcp://empty:1", "found no workers"),
        ("tcp://old:1", "worker b: found pdssjax 0.0.1, expected pdssjax"),
        ("tcp://bare:1", "worker a: found no pdssjax, expected pdssjax"),
    ],
)
def test_what_is_wrong_with_a_cluster_is_told_in_a_line(distributed, address, essential):
    with pytest.raises(InputError) as refused, cluster_executor(address):
        pass
    assert essential in str(refused.value) and "\n" not in str(refused.value)


def test_without_distributed_the_line_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install 'pdssjax\[cluster\]'"), cluster_executor("tcp://good:1"):
        pass


SMALL = dict(n_workers=2, threads_per_worker=1, processes=False, dashboard_address=None, host="127.0.0.1")
"""A cluster of threads in this process: real messages, but nothing to start."""
GRID = {"drive.voltage": np.linspace(20.0, 80.0, 30), "drive.frequency": np.linspace(2.0, 50.0, 20)}
"""600 points: ten blocks."""


@NEEDED
@pytest.mark.filterwarnings("ignore")  # of Dask's own
def test_a_real_cluster_finds_what_threads_find(quick):
    from distributed import LocalCluster

    study = example_study()
    with LocalCluster(protocol="tcp://", **SMALL) as local, cluster_executor(local.scheduler_address) as (pool, n):
        there = pdssjax.sweep(study, GRID, executor=pool, in_flight=2 * n)
    assert n == 2 and len(quick) == 10
    np.testing.assert_array_equal(there.net_step, pdssjax.sweep(study, GRID).net_step)


@NEEDED
@pytest.mark.filterwarnings("ignore")
def test_a_scheduler_that_goes_away_ends_the_sweep_with_a_line_and_what_was_done_is_kept(tmp_path, quick, monkeypatch):
    import dask
    from distributed import LocalCluster

    # A client looks for its scheduler that long.
    monkeypatch.setitem(dask.config.config["distributed"]["comm"]["timeouts"], "connect", "500ms")
    study, store, told = example_study(), SweepStore(tmp_path / "s.zarr"), []
    with LocalCluster(protocol="tcp://", **SMALL) as local, cluster_executor(local.scheduler_address) as (pool, _):

        def progress(done, count):
            told.append(done)
            if len(told) == 3:
                local.close()

        with pytest.raises(InputError) as refused:
            pdssjax.sweep(study, GRID, executor=pool, in_flight=2, store=store, progress=progress)
    assert "A store has the blocks that are done" in str(refused.value) and "\n" not in str(refused.value)
    # A thread of a worker that has gone may still be at its block: `quick` counts that, too.
    resumed = []
    kept = SweepStore(tmp_path / "s.zarr", resume=True)
    again = pdssjax.sweep(study, GRID, store=kept, progress=lambda done, count: resumed.append(done))
    assert len(resumed) == 10 - len(told) and len(quick) >= 10
    np.testing.assert_array_equal(again.net_step, pdssjax.sweep(study, GRID).net_step)


@pytest.fixture
def certificate(tmp_path):
    """A key and a certificate that signs itself, and Dask's settings that name them."""
    key, signed = tmp_path / "key.pem", tmp_path / "certificate.pem"
    command = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "1", "-subj", "/CN=pdssjax"]
    subprocess.run([*command, "-keyout", key, "-out", signed], check=True, capture_output=True)
    named = {"ca-file": signed}
    named |= {f"{role}.{what}": file for role in ("client", "scheduler", "worker") for what, file in
              (("cert", signed), ("key", key))}  # fmt: skip
    return {f"distributed.comm.tls.{setting}": str(file) for setting, file in named.items()}


@NEEDED
@pytest.mark.skipif(shutil.which("openssl") is None, reason="needs openssl")
@pytest.mark.filterwarnings("ignore")
def test_the_tls_settings_of_dask_are_those_of_a_sweep(quick, monkeypatch, certificate):
    import dask
    from distributed import LocalCluster
    from distributed.security import Security

    with dask.config.set(certificate), LocalCluster(protocol="tls://", security=Security(), **SMALL) as local:
        assert local.scheduler_address.startswith("tls://")
        with cluster_executor(local.scheduler_address) as (pool, _):
            there = pdssjax.sweep(example_study(), GRID, executor=pool)
        monkeypatch.setattr(execution, "_SCHEDULER_TIMEOUT", 0.3)
        with (
            dask.config.set({"distributed.comm.tls.ca-file": None}),
            pytest.raises(InputError, match=r"scheduler tls://.*TLS") as refused,
            cluster_executor(local.scheduler_address),
        ):
            pass
    assert "\n" not in str(refused.value) and np.isfinite(there.net_step).all()


@pytest.mark.slow
@NEEDED
@pytest.mark.filterwarnings("ignore")  # of Dask's own
def test_a_cluster_that_loses_a_worker_loses_no_block_and_computes_none_twice(tmp_path):
    from distributed import LocalCluster

    over = {"drive.voltage": np.linspace(20.0, 80.0, 20), "drive.frequency": np.linspace(20.0, 50.0, 20)}
    study, told, kept = example_study(), [], []

    class Counted(SweepStore):
        def keep(self, number, found):
            kept.append(number)
            super().keep(number, found)

    settings = dict(n_workers=2, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=None)
    with LocalCluster(**settings) as cluster, cluster_executor(cluster.scheduler_address) as (executor, threads):

        def progress(done, count):
            told.append(done)
            if len(told) == 2:
                next(iter(cluster.workers.values())).process.process._process.kill()

        store = Counted(tmp_path / "s.zarr")
        there = pdssjax.sweep(study, over, executor=executor, in_flight=2 * threads, store=store, progress=progress)
    here = pdssjax.sweep(study, over)
    np.testing.assert_allclose(there.net_step, here.net_step, rtol=1e-12, atol=0.0)
    assert sorted(kept) == list(range(7)) and told[-1] == 400


ROOT = Path(__file__).parents[2]
HALVED = """\
import jax, json
import jax.numpy as jnp
from pdssjax.sweeps.blocks import default_workers, default_lanes, map_over_devices, round_up_to_devices
from test_cluster import POINTS, turns
found = jax.jit(lambda points: map_over_devices(jax.vmap(turns), points))(POINTS)
print(json.dumps([found.tolist(), len(found.devices()), round_up_to_devices(7), default_lanes(), default_workers()]))
"""
SWEPT = """\
import numpy as np, sys
from pdssjax import prepare_jax
prepare_jax()
from test_cluster import found_by_a_sweep
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
    assert map_over_devices(jax.vmap(turns), POINTS).tolist() == expected and len(set(expected)) == 6
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
