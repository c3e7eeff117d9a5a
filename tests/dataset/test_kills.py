"""Killed at any moment: no torn file, no pair twice, none lost, and in the end the same bytes."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from shapely import box

from slamgym.cad import FloorPlan, write_houseexpo
from slamgym.commands import cli
from slamgym.dataset import Layout, load_pair, read_manifest
from slamgym.dataset.folder import open_dataset
from slamgym.dataset.record import Slot
from slamgym.interop import read_carmen

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="forks and kills processes")

PAIRS = 12
KILLS = 6
SETTINGS = {"seed": 1}
STEPS = frozenset(
    {"open", "os.rename", "os.mkdir", "os.rmdir", "os.remove", "os.scandir", "shutil.rmtree"}
)
"""Audit events of what changes files, or stands between two changes."""


def content(root):
    return {
        str(path.relative_to(root)): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file() and path.name not in ("timing.jsonl", ".lock")
    }


# --- every step of the book-keeping, with pairs made by hand


def slot(index):
    return Slot(index, f"plan{index}", 0, 100 + index)


def commit_pairs(root, count):
    """What a run does, but for the exploring: whichever of the first pairs are missing are made."""
    with open_dataset(root, SETTINGS) as folder:
        for index in range(count):
            if index in folder.committed:
                continue
            staged = folder.stage(slot(index).name)
            (staged / "episode").mkdir(parents=True)
            line = json.dumps({"name": slot(index).name, "index": index}) + "\n"
            (staged / "episode" / "episode.json").write_text(line)
            for side in "AB":
                (staged / f"{side}.png").write_bytes(side.encode())
            folder.commit(slot(index), staged, {"cpu_seconds": 1.0})
            if index == 1:
                folder.write_index()  # in the midst, as time goes by


def killed_at(step, root, count):
    """Do it in a process that kills itself before its ``step``-th change of a file; whether it came so far."""
    pid = os.fork()
    if pid == 0:
        left = step

        def count_down(event, _):
            nonlocal left
            if event in STEPS:
                left -= 1
                if left < 0:
                    os.kill(os.getpid(), signal.SIGKILL)

        try:
            sys.addaudithook(count_down)
            commit_pairs(root, count)
        finally:
            os._exit(0)
    _, status = os.waitpid(pid, 0)
    return os.WIFSIGNALED(status)


def check_index(root):
    """What a reader finds at this moment is whole."""
    layout = Layout(root)
    if layout.manifest.exists():
        listed = [json.loads(line)["name"] for line in layout.manifest.read_text().splitlines()]
        assert listed == sorted(set(listed))
        for name in listed:
            assert all(layout.image(side, name).read_bytes() == side.encode() for side in "AB")
    if layout.episodes.exists():
        for episode in layout.episodes.iterdir():
            assert json.loads((episode / "episode.json").read_text())["name"] == episode.name
            assert layout.image("A", episode.name).exists()
            assert layout.image("B", episode.name).exists()


def test_killed_before_every_single_step(tmp_path):
    commit_pairs(tmp_path / "steady", 3)
    expected = content(tmp_path / "steady")
    step = 0
    while killed_at(step, root := tmp_path / f"killed-{step}", 3):
        if root.exists():
            check_index(root)
        commit_pairs(root, 3)
        assert content(root) == expected, f"killed before step {step}"
        assert not Layout(root).incoming.exists()
        step += 1
    assert step > 50  # the hook has seen the work


def test_killed_again_and_again_before_the_end(tmp_path):
    """Each run comes a few steps further than it takes to find out what the last one left."""
    commit_pairs(tmp_path / "steady", 6)
    rng = random.Random(4)
    runs = 1
    root = tmp_path / "killed"
    while killed_at(rng.randrange(10, 90), root, 6):
        check_index(root)
        runs += 1
    assert runs > 3
    assert content(root) == content(tmp_path / "steady")


# --- whole runs, at random moments

OPTIONS = ["--seed", "3", "--minutes", "0.2", "--set", "particles=5", "--pairs", str(PAIRS)]

STARTER = """
import os, sys
from slamgym.commands import cli
import slamgym.commands.generate, slamgym.agents.registry
for _ in sys.stdin:
    pid = os.fork()
    if pid == 0:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os._exit(cli.main(sys.argv[1:]))
    print(pid, flush=True)
    os.waitpid(pid, 0)
    print("over", flush=True)
"""
"""Starts run after run without importing everything again: reads a line for each, answers with its process id
and with "over" when it has ended."""


@pytest.fixture(scope="module")
def plans(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plans")
    rooms = box(0, 0, 3.0, 2.4).difference(box(1.4, 0.0, 1.6, 1.4))
    for name in ("a", "b", "c"):
        write_houseexpo(folder / f"{name}.json", FloorPlan(name, rooms))
    return folder


@pytest.fixture(scope="module")
def steady(plans, tmp_path_factory):
    """The dataset of a run that nothing disturbs."""
    root = tmp_path_factory.mktemp("steady") / "out"
    assert cli.main(arguments(plans, root)) == 0
    return root


def arguments(plans, root, workers=None):
    """Of a run; one without workers starts at once."""
    where = ["--engine", "in_process"] if workers is None else ["--workers", str(workers)]
    return ["generate", "--plans", str(plans), "--out", str(root), *OPTIONS, *where]


def committed(root):
    episodes = Layout(root).episodes
    return len(list(episodes.iterdir())) if episodes.exists() else 0


def check_pairs(root):
    """Every pair and every episode's files are whole, and none is listed twice."""
    layout = Layout(root)
    if not layout.episodes.exists():
        return
    for episode in layout.episodes.iterdir():
        record = json.loads((episode / "episode.json").read_text())
        cad, slam = load_pair(root, record["name"])
        assert list(cad.shape) == list(slam.shape) == record["shape"]
        assert (
            len(read_carmen(episode / "scans.log.gz"))
            == len((episode / "truth.tum").read_text().splitlines()) - 1
        )
    if layout.manifest.exists():
        names = [record.name for record in read_manifest(root)]
        assert len(set(names)) == len(names)


def test_a_run_killed_many_times_loses_nothing(plans, steady, tmp_path):
    root = tmp_path / "out"
    rng = random.Random(0)
    kills = 0
    starter = subprocess.Popen(
        [sys.executable, "-c", STARTER, *arguments(plans, root)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    with starter, starter.stdin as orders, starter.stdout as answers:
        for number in range(KILLS):
            before = committed(root)
            orders.write("go\n")
            orders.flush()
            pid = int(answers.readline())
            # Every other run is killed when it has got one more pair, the others perhaps while they start.
            deadline = time.monotonic() + (60.0 if number % 2 else rng.uniform(0.0, 0.3))
            while time.monotonic() < deadline and committed(root) == before:
                time.sleep(0.001)
            time.sleep(rng.uniform(0.0, 0.1))
            os.kill(
                pid, rng.choice([signal.SIGKILL, signal.SIGTERM])
            )  # at the latest now it is a zombie, as nobody has waited for it
            kills += 1
            assert answers.readline() == "over\n"
            check_pairs(root)
            assert committed(root) >= before  # what was there stays
            if committed(root) == PAIRS:
                break
    assert kills > 1  # a busy machine comes far between two looks
    assert cli.main(arguments(plans, root)) == 0
    assert content(root) == content(steady)


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="finds the workers in /proc")
@pytest.mark.parametrize(("workers", "last"), [(1, signal.SIGKILL), (2, signal.SIGTERM)])
def test_workers_and_their_driver_killed_lose_nothing(plans, steady, tmp_path, workers, last):
    root = tmp_path / "out"
    rng = random.Random(1)
    command = [sys.executable, "-m", "slamgym", *arguments(plans, root, workers)]
    driver = subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    # One worker, another when there are more pairs, then the driver, or all of them as batch systems do.
    for pairs, number in ((1, signal.SIGTERM), (3, signal.SIGKILL)):
        wait_for_pairs(root, pairs, driver)
        time.sleep(rng.uniform(0.0, 0.1))
        os.kill(rng.choice(workers_of(driver.pid)), number)
    wait_for_pairs(root, 5, driver)
    if last == signal.SIGKILL:
        driver.kill()
    else:
        os.killpg(driver.pid, last)
    _, error = driver.communicate(timeout=300)
    check_pairs(root)
    assert 5 <= committed(root) < PAIRS
    if last == signal.SIGTERM:
        assert driver.returncode == cli.EXIT_TERMINATED
        assert error.splitlines()[-1] == "slamgym: error: ended by SIGTERM"
        assert len(list(read_manifest(root))) == committed(root)
    assert cli.main(arguments(plans, root)) == 0
    assert content(root) == content(steady)
    assert not Layout(
        root
    ).rejected.exists()  # a worker that died once does not speak against a plan


def wait_for_pairs(root, count, driver):
    deadline = time.monotonic() + 300.0
    while committed(root) < count:
        assert driver.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.002)


def workers_of(pid):
    children = [
        int(child)
        for task in Path(f"/proc/{pid}/task").iterdir()
        for child in (task / "children").read_text().split()
    ]
    return [
        child for child in children if b"popen_loky" in Path(f"/proc/{child}/cmdline").read_bytes()
    ]
