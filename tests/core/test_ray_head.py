"""The head of a Ray cluster is killed under a run: Ray ends the run, nothing is lost, and another run goes on."""

import contextlib
import os
import signal
import subprocess
import sys
import time

import pytest

pytest.importorskip("ray")

from shapely import box

from slamgym.cad import FloorPlan, write_houseexpo
from slamgym.commands import cli
from slamgym.dataset import Layout, read_manifest
from slamgym.dataset.check import check_dataset

ENDLESS = 100_000
"""Pairs of the run that is killed: more than it can make, however late the kill comes."""
TIMEOUT = 300.0
"""A run that hangs is a failure, not a wait [s]."""
ENVIRONMENT = {**os.environ, "RAY_AUTH_MODE": "disabled"}
# Ray's own patience is a minute.
HASTY = {**ENVIRONMENT, "RAY_gcs_rpc_server_reconnect_timeout_s": "2"}

# In a process of its own: whoever has spoken with a head is ended by Ray some time after the head.
HEAD = """
import sys
from ray.cluster_utils import Cluster
cluster = Cluster(True, head_node_args=dict(num_cpus=1, include_dashboard=False, include_log_monitor=False))
pids = [info.process.pid for infos in cluster.head_node.all_processes.values() for info in infos]
print("HEAD", cluster.address, *pids, flush=True)
sys.stdin.read()
"""


@pytest.fixture
def head():
    """A cluster: its address, and what kills it."""
    holder = subprocess.Popen(
        [sys.executable, "-c", HEAD],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=ENVIRONMENT,
    )  # fmt: skip
    with holder:
        _, address, *pids = next(line for line in holder.stdout if line.startswith("HEAD")).split()

        def kill():
            for pid in [*map(int, pids), holder.pid]:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)

        yield address, kill
        kill()


def names(root):
    episodes = Layout(root).episodes
    return {path.name for path in episodes.iterdir()} if episodes.exists() else set()


def test_a_run_whose_head_is_killed_ends_and_the_next_goes_on(head, tmp_path):
    plans, out = tmp_path / "plans", tmp_path / "out"
    plans.mkdir()
    write_houseexpo(plans / "room.json", FloorPlan("room", box(0, 0, 2.4, 2.0)))
    command = ["generate", "--plans", str(plans), "--minutes", "0.1", "--set", "particles=2"]
    command += ["--out", str(out), "--pairs"]
    address, kill = head
    with subprocess.Popen(
        [sys.executable, "-m", "slamgym", *command, str(ENDLESS), "--engine", "ray", "--address", address],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=HASTY,
    ) as driver:  # fmt: skip
        while driver.poll() is None and len(names(out)) < 2:
            time.sleep(0.01)
        kill()
        _, errors = driver.communicate(timeout=TIMEOUT)
    assert driver.returncode > 0
    assert "Ray failed" in errors or "Failed to connect to GCS" in errors

    before = names(out)
    assert len(before) >= 2
    total = len(before) + 3
    assert not Layout(out).rejected.exists()  # the end of the cluster does not speak against a plan
    assert cli.main([*command, str(total), "--workers", "1"]) == 0
    assert [record.index for record in read_manifest(out)] == list(range(total))
    assert before <= names(out)
    assert check_dataset(out) == []
