"""A Ray cluster on this machine, whose processes are killed on purpose."""

import contextlib
import math
import os
import random
import signal
import socket
import sys
import threading
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip("ray")

from shapely import box

from slamgym.agents.registry import make_explorer
from slamgym.cad import FloorPlan
from slamgym.core.errors import ConfigError, SlamgymError
from slamgym.core.parallel.backlog import MAX_ATTEMPTS, Lost
from slamgym.core.parallel.engine import Execution
from slamgym.core.parallel.ray import IN_FLIGHT_PER_CPU, check_address
from slamgym.dataset import DatasetConfig, build_dataset
from slamgym.envs import EpisodeConfig, ExploreConfig
from slamgym.slam import SlamConfig

CPUS = 2
QUICK = DatasetConfig(
    seed=5, episode=EpisodeConfig(minutes=0.1, env=ExploreConfig(slam=SlamConfig(particles=2)))
)
OPTIONS = ["--seed", "5", "--minutes", "0.1", "--set", "particles=2"]


class Plans:
    """Two small rooms."""

    def __init__(self):
        self.plans = {
            f"room{i}": FloorPlan(f"room{i}", box(0, 0, 2.0 + 0.2 * i, 2.0)) for i in range(2)
        }
        self.ids = list(self.plans)

    def __len__(self):
        return len(self.ids)

    def load(self, plan_id):
        return self.plans[plan_id]


def square(value):
    return value * value


def fail_on_three(value):
    if value == 3:
        raise ConfigError("three")
    return value


def die_on_three(item):
    """Note each attempt; item 3 kills its worker every time, item 5 the first time."""
    folder, value = item
    first = not list(folder.glob(f"{value}-*"))
    (folder / f"{value}-{time.monotonic_ns()}").touch()
    if value == 3 or (value == 5 and first):
        os.kill(os.getpid(), signal.SIGKILL)
    return value


@pytest.fixture(scope="module")
def cluster():
    """A cluster that the engines find running."""
    import ray

    quiet = {"include_dashboard": False, "log_to_driver": False, "logging_level": "ERROR"}
    ray.init(address="local", num_cpus=CPUS, object_store_memory=128 << 20, **quiet)
    yield
    ray.shutdown()


def content(root):
    return {
        str(path.relative_to(root)): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file() and path.name not in ("timing.jsonl", ".lock")
    }


@pytest.mark.parametrize(("most", "under_way"), [(0, IN_FLIGHT_PER_CPU * CPUS), (1, 1)])
def test_every_item_is_done_once_and_few_are_under_way(cluster, most, under_way):
    drawn = 0

    def items():
        nonlocal drawn
        for i in range(40):
            drawn += 1
            yield i

    results = []
    with Execution(most, "ray").open() as engine:
        for result in engine.run(square, items()):
            results.append(result)
            assert drawn <= len(results) + under_way
    assert sorted(results) == [i * i for i in range(40)]


def test_an_error_of_a_task_is_raised_as_it_is(cluster):
    with Execution(CPUS, "ray").open() as engine, pytest.raises(ConfigError, match=r"^three$"):
        list(engine.run(fail_on_three, range(9)))


def test_a_killed_worker_s_task_is_tried_again_and_at_last_given_up(cluster, tmp_path):
    with Execution(CPUS, "ray").open() as engine:
        results = list(engine.run(die_on_three, [(tmp_path, value) for value in range(8)]))
    lost = [result for result in results if isinstance(result, Lost)]
    assert [entry.item for entry in lost] == [(tmp_path, 3)]
    assert "a worker process died" in lost[0].reason
    assert sorted(result for result in results if not isinstance(result, Lost)) == [
        0,
        1,
        2,
        4,
        5,
        6,
        7,
    ]
    begun = [int(path.name.split("-")[0]) for path in tmp_path.iterdir()]
    assert begun.count(3) == MAX_ATTEMPTS
    assert begun.count(5) == 2


def hang_on_one(value):
    while value == 1:
        pass
    return value


def test_a_task_that_hangs_is_ended_and_handed_back(cluster):
    with Execution(CPUS, "ray", task_timeout=1.0).open() as engine:
        results = list(engine.run(hang_on_one, range(4)))
    lost = [result for result in results if isinstance(result, Lost)]
    assert lost == [Lost(1, "took longer than 1 s, the --task-timeout", "TimeoutError")]
    assert sorted(result for result in results if result not in lost) == [0, 2, 3]


def test_nodes_with_another_version_are_refused(cluster, monkeypatch):
    monkeypatch.setattr("slamgym.core.parallel.ray.__version__", "0.0.0")
    with (
        Execution(CPUS, "ray").open() as engine,
        pytest.raises(ConfigError, match=r"the driver has 0\.0\.0"),
    ):
        list(engine.run(square, range(2)))


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="finds the workers in /proc")
def test_the_same_bytes_as_on_one_machine_while_workers_are_killed(cluster, tmp_path):
    """Workers die at random moments; the folder has every pair once, and not a byte is different."""
    here = Execution(engine="in_process")
    build_dataset(tmp_path / "local", Plans(), QUICK, make_explorer, pairs=6, execution=here)
    kills: list[int] = []
    over = threading.Event()
    killer = threading.Thread(target=_kill_workers, args=(random.Random(3), kills, over))
    killer.start()
    try:
        report = build_dataset(
            tmp_path / "ray",
            Plans(),
            QUICK,
            make_explorer,
            pairs=6,
            execution=Execution(CPUS, "ray"),
        )
    finally:
        over.set()
        killer.join()
    assert kills
    assert (report.pairs, report.rejected) == (6, {})
    assert content(tmp_path / "ray") == content(tmp_path / "local")


def _kill_workers(rng, kills, over):
    """Kill workers at work, less often than a task may be begun."""
    while len(kills) < MAX_ATTEMPTS - 1 and not over.wait(0.002):
        at_work = [pid for pid in _processes("ray::_run_on_node") if pid not in kills]
        if at_work:
            over.wait(rng.uniform(0.0, 0.1))
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid := rng.choice(at_work), signal.SIGKILL)
                kills.append(pid)


def _processes(title):
    for path in Path("/proc").iterdir():
        if path.name.isdigit():
            with contextlib.suppress(OSError):
                if (path / "cmdline").read_bytes().startswith(title.encode()):
                    yield int(path.name)


class FakeRay:
    """What the engine asks of Ray, done in this process."""

    def __init__(self, *errors):
        import ray

        self.exceptions = ray.exceptions
        self.errors = [*errors]
        """What is wrong with the next results."""
        self.cancelled = 0

    def remote(self, **_):
        return lambda function: SimpleNamespace(
            remote=lambda *arguments: partial(function, *arguments)
        )

    def wait(self, references, num_returns):
        return references[:num_returns], references[num_returns:]

    def get(self, reference, timeout):
        assert 0.0 < timeout < math.inf
        if self.errors:
            raise self.errors.pop(0)
        return reference()

    def cancel(self, reference, force):
        self.cancelled += 1

    def is_initialized(self):
        return True

    def cluster_resources(self):
        return {"CPU": 3.0}


def run_on(fake, monkeypatch):
    monkeypatch.setattr("slamgym.core.parallel.ray.import_ray", lambda: fake)
    with Execution(0, "ray").open() as engine:
        return sorted(engine.run(square, range(20)))


def test_a_result_that_does_not_arrive_is_made_again(monkeypatch):
    from ray.exceptions import GetTimeoutError, WorkerCrashedError

    fake = FakeRay(GetTimeoutError("late"), WorkerCrashedError())
    assert run_on(fake, monkeypatch) == [value * value for value in range(20)]
    assert fake.cancelled == 0


@pytest.mark.parametrize("error", ["OutOfDiskError", "LocalRayletDiedError", "ConnectionError"])
def test_what_trying_again_can_not_cure_ends_the_run_in_one_sentence(monkeypatch, error):
    import ray

    fake = FakeRay(getattr(ray.exceptions, error, ConnectionError)("full"))
    with pytest.raises(SlamgymError, match=r"^Ray failed: .*run the same command again to go on$"):
        run_on(fake, monkeypatch)
    assert fake.cancelled == 3 * IN_FLIGHT_PER_CPU - 1


def test_a_worker_lost_with_the_head_is_not_the_tasks_fault(monkeypatch):
    from ray.exceptions import RaySystemError, WorkerCrashedError

    fake = FakeRay(WorkerCrashedError())

    def fail_after_the_loss():
        if not fake.errors:
            raise RaySystemError("no head")
        return {"CPU": 3.0}

    monkeypatch.setattr(fake, "cluster_resources", fail_after_the_loss)
    with pytest.raises(SlamgymError, match=r"^Ray failed: .*no head"):
        run_on(fake, monkeypatch)


def test_an_address_where_nothing_answers_is_one_clear_error(monkeypatch):
    import ray

    def fail(**_):
        raise ConnectionError("Could not find any running Ray instance.\nMore about it.")

    monkeypatch.setattr(ray, "is_initialized", lambda: False)
    monkeypatch.setattr(ray, "init", fail)
    monkeypatch.setattr("slamgym.core.parallel.ray.check_address", lambda _: None)
    with pytest.raises(
        ConfigError,
        match=r"no Ray cluster answers at 10\.0\.0\.1:6379 \(Could not.*More about it.*ray status",
    ):
        Execution(2, "ray", "10.0.0.1:6379").open()


def test_a_cluster_must_be_named(monkeypatch):
    import ray

    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    monkeypatch.setattr(ray, "is_initialized", lambda: False)
    with pytest.raises(ConfigError, match=r"--engine ray needs a cluster that runs: add --address"):
        Execution(2, "ray").open()


def test_a_port_where_nobody_listens_is_found_at_once():
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        with pytest.raises(ConfigError, match="no Ray cluster answers at 127"):
            check_address(f"127.0.0.1:{closed.getsockname()[1]}")


def test_without_ray_the_command_to_install_it_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ConfigError, match=r"pip install 'slamgym\[ray\]'"):
        Execution(2, "ray").open()
