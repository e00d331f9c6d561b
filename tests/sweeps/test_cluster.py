"""A Dask cluster runs a sweep as threads do; what is wrong with one is told in a line."""

import importlib.metadata
import importlib.util
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from quick_blocks import example_study

import pdssjax
from pdssjax import InputError
from pdssjax.files import SweepStore
from pdssjax.sweeps import cluster_executor
from pdssjax.sweeps.job import package_version

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
