"""The head of a Ray cluster is killed under a run: one clear error soon, nothing lost, and another run goes on."""

import contextlib
import math
import os
import signal
import socket
import subprocess
import sys
import time
from functools import partial

import pytest

pytest.importorskip("ray")

import ray
from shapely import box

from slamgym.cad import FloorPlan, write_houseexpo
from slamgym.commands import cli
from slamgym.core.errors import SlamgymError
from slamgym.core.parallel import ray_cluster as module
from slamgym.core.parallel.ray import IN_FLIGHT_PER_CPU, RayEngine
from slamgym.core.parallel.ray_cluster import ClusterLostError, RayCluster
from slamgym.dataset import Layout, read_manifest
from slamgym.dataset.check import check_dataset

PAIRS = 30
TIMEOUT = 90.0
"""A run that hangs is a failure, not a wait [s]."""
NO_TOKENS = {**os.environ, "RAY_AUTH_MODE": "disabled"}

# In a process of its own: whoever has spoken with a head is ended by Ray a minute after the head.
HEAD = """
import sys
from ray.cluster_utils import Cluster
cluster = Cluster(True, head_node_args=dict(num_cpus=1, include_dashboard=False, include_log_monitor=False))
pids = [info.process.pid for infos in cluster.head_node.all_processes.values() for info in infos]
print("HEAD", cluster.address, *pids, flush=True)
sys.stdin.read()
"""
# With less patience than users have.
DRIVER = """
import sys
from slamgym.commands import cli
from slamgym.dataset import ray_cluster
ray_cluster.CHECK_INTERVAL, ray_cluster.HEAD_PATIENCE = 0.5, 1.0
sys.exit(cli.main(sys.argv[1:]))
"""


def start_head():
    """Start a cluster; returns the process that holds it, its address and the ids of its processes."""
    head = subprocess.Popen(
        [sys.executable, "-c", HEAD],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=NO_TOKENS,
    )  # fmt: skip
    for line in head.stdout:
        if line.startswith("HEAD"):
            _, address, *pids = line.split()
            return head, address, [int(pid) for pid in pids]
    raise AssertionError("the cluster did not start")


def kill_head(head, pids):
    for pid in [*pids, head.pid]:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    head.communicate(timeout=TIMEOUT)


def names(root):
    episodes = Layout(root).episodes
    return sorted(path.name for path in episodes.iterdir()) if episodes.exists() else []


def test_a_head_that_is_killed_ends_the_run_with_one_line(tmp_path):
    plans, out = tmp_path / "plans", tmp_path / "out"
    plans.mkdir()
    write_houseexpo(plans / "room.json", FloorPlan("room", box(0, 0, 2.4, 2.0)))
    command = [
        "generate",
        "--plans",
        str(plans),
        "--minutes",
        "0.1",
        "--particles",
        "2",
        "--contact-sheet",
        "0",
    ]
    command += ["--pairs", str(PAIRS), "--out", str(out)]
    head, address, pids = start_head()
    try:
        driver = subprocess.Popen(
            [sys.executable, "-c", DRIVER, *command, "--engine", "ray", "--address", address],
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=NO_TOKENS,
        )  # fmt: skip
        deadline = time.monotonic() + TIMEOUT
        while driver.poll() is None and len(names(out)) < 2 and time.monotonic() < deadline:
            time.sleep(0.01)
    finally:
        kill_head(head, pids)
    try:
        _, errors = driver.communicate(timeout=TIMEOUT)
    finally:
        driver.kill()
    said = [line for line in errors.splitlines() if " pairs, " not in line]
    assert driver.returncode == cli.EXIT_USER_ERROR, errors
    assert len(said) == 1, errors
    assert said[0].startswith("slamgym: error: ")
    assert said[0].endswith("start Ray again and repeat the same command to go on")

    before = names(out)
    assert 2 <= len(before) < PAIRS
    assert check_dataset(out) == []
    assert cli.main([*command, "--workers", "1"]) == 0
    records = list(read_manifest(out))
    assert [record.index for record in records] == list(range(PAIRS))
    assert set(before) <= set(names(out))
    assert check_dataset(out) == []


class Ray:
    """What driver and connection ask of Ray, done in this process; its good-bye takes for ever."""

    exceptions = ray.exceptions

    def __init__(self, address):
        self.address = address
        self.cancelled = []
        self.errors = []
        """What is wrong with the next results."""
        self.is_silent = False
        """Whether no task ends any more."""

    def remote(self, **_):
        def make_remote(function):
            class Remote:
                def remote(self, *arguments):
                    return partial(function, *arguments)

            return Remote()

        return make_remote

    def wait(self, references, num_returns, timeout):
        assert num_returns == 1
        assert 0.0 < timeout < math.inf
        return ([], references) if self.is_silent else (references[:1], references[1:])

    def get(self, reference, timeout):
        assert 0.0 < timeout < math.inf
        if self.errors:
            raise self.errors.pop(0)
        return reference()

    def is_initialized(self):
        return False

    def init(self, **_):
        pass

    def get_runtime_context(self):
        class Context:
            gcs_address = self.address

        return Context()

    def cluster_resources(self):
        return {"CPU": 3.0}

    def cancel(self, reference, force):
        assert force
        self.cancelled.append(reference)

    def shutdown(self):
        time.sleep(1000.0)


@pytest.fixture
def listener(monkeypatch):
    for name in ("HEAD_PATIENCE", "RETRY_INTERVAL", "CHECK_INTERVAL", "CLOSE_TIMEOUT"):
        monkeypatch.setattr(module, name, 0.05)
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server


def connect(monkeypatch, listener):
    fake = use_fake(monkeypatch, listener)
    return RayCluster(0, fake.address), fake


def use_fake(monkeypatch, listener):
    fake = Ray(f"127.0.0.1:{listener.getsockname()[1]}")
    monkeypatch.setattr(module, "_import_ray", lambda: fake)
    monkeypatch.setattr(module, "_connect", lambda *_: None)
    return fake


def double(value):
    return 2 * value


def test_a_head_that_listens_is_asked_and_told(monkeypatch, listener):
    cluster, fake = connect(monkeypatch, listener)
    assert cluster.cpus() == 3
    cluster.cancel(["task"])
    assert fake.cancelled == ["task"]


def test_a_result_that_does_not_arrive_is_made_again(monkeypatch, listener):
    fake = use_fake(monkeypatch, listener)
    fake.errors = [ray.exceptions.GetTimeoutError("late"), ray.exceptions.WorkerCrashedError()]
    assert sorted(RayEngine(0, fake.address).run(double, range(20))) == list(range(0, 40, 2))
    assert fake.cancelled == []


def test_what_trying_again_can_not_cure_ends_the_run_in_one_sentence(monkeypatch, listener):
    fake = use_fake(monkeypatch, listener)
    fake.errors = [ray.exceptions.OutOfDiskError("full")]
    with pytest.raises(SlamgymError, match=r"^Ray failed: .*run the same command again to go on$"):
        list(RayEngine(0, fake.address).run(double, range(20)))
    assert len(fake.cancelled) == 3 * IN_FLIGHT_PER_CPU - 1


def test_ray_s_death_on_this_machine_is_not_the_task_s_fault(monkeypatch, listener):
    fake = use_fake(monkeypatch, listener)
    fake.errors = [ray.exceptions.LocalRayletDiedError()]
    with pytest.raises(ClusterLostError, match=r"^Ray on this machine has died.*repeat the same command"):
        list(RayEngine(0, fake.address).run(double, range(20)))


@pytest.mark.parametrize("says", ["nothing", "that workers die"])
def test_a_head_that_dies_under_a_run_ends_it(monkeypatch, listener, says):
    fake = use_fake(monkeypatch, listener)
    run = RayEngine(0, fake.address).run(double, range(1000))
    assert [next(run) for _ in range(5)] == [0, 2, 4, 6, 8]
    listener.close()
    fake.is_silent = says == "nothing"
    fake.errors = [ray.exceptions.WorkerCrashedError() for _ in range(1000)]
    with pytest.raises(ClusterLostError, match="head of the Ray cluster"):
        next(run)
    assert fake.cancelled == []


def test_of_a_head_that_is_gone_nothing_is_asked_and_the_good_bye_is_short(monkeypatch, listener):
    cluster, fake = connect(monkeypatch, listener)
    listener.close()
    with pytest.raises(ClusterLostError, match=r"head of the Ray cluster, 127.*what was committed is safe"):
        cluster.cpus()
    cluster.cancel(["task"])
    assert fake.cancelled == []
    cluster.close()


def test_a_head_that_comes_back_in_time_is_waited_for(monkeypatch, listener):
    cluster, _ = connect(monkeypatch, listener)
    monkeypatch.setattr(module, "HEAD_PATIENCE", 60.0)
    answers = iter([False, False, True])
    monkeypatch.setattr(module, "_listens", lambda _: next(answers))
    assert cluster.cpus() == 3


def test_a_head_that_can_not_be_reached_directly_is_not_watched(monkeypatch, listener):
    use_fake(monkeypatch, listener)
    listener.close()
    assert RayCluster(0).cpus() == 3
