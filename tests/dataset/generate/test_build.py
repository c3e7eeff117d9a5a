"""The promises of a generated dataset, on plans that are explored in seconds."""

import contextlib
import dataclasses
import errno
import json
import math
import os
import signal
from pathlib import Path

import numpy as np
import pytest
from shapely import Polygon, box

from slamgym.agents.registry import make_explorer
from slamgym.cad import FloorPlan, read_houseexpo
from slamgym.core.errors import ConfigError, PlanError, SlamgymError
from slamgym.core.files import StorageError
from slamgym.core.names import exploration_seed
from slamgym.core.parallel.backlog import Lost
from slamgym.core.parallel.engine import Execution
from slamgym.dataset import DatasetConfig, Layout, build_dataset, load_pair, read_manifest
from slamgym.envs import EpisodeConfig, ExploreConfig
from slamgym.interop import read_carmen, read_ros_map, read_tum
from slamgym.metrics import absolute_trajectory_error
from slamgym.sim import lidar_level
from slamgym.slam import SlamConfig


class Plans:
    """Two small flats, and what the test adds."""

    def __init__(self, **more):
        rooms = box(0, 0, 3.0, 2.4).difference(box(1.4, 0.0, 1.6, 1.4))
        corner = Polygon([(0, 0), (3.2, 0), (3.2, 1.5), (1.6, 1.5), (1.6, 2.8), (0, 2.8)])
        self.plans = {
            "rooms": FloorPlan("rooms", rooms),
            "corner": FloorPlan("corner", corner),
        } | more
        self.ids = list(self.plans)

    def __len__(self):
        return len(self.ids)

    def load(self, plan_id):
        plan = self.plans[plan_id]
        if isinstance(plan, Exception):
            raise plan
        return plan


QUICK = DatasetConfig(
    seed=5, episode=EpisodeConfig(minutes=0.2, env=ExploreConfig(slam=SlamConfig(particles=5)))
)


def build(root, plans=None, config=QUICK, pairs=3, workers=1):
    execution = Execution(workers, "in_process" if workers == 1 else "local")
    return build_dataset(
        root, plans or Plans(), config, make_explorer, pairs=pairs, execution=execution
    )


def content(root: Path):
    """Every file but those that hold times, as bytes."""
    return {
        str(path.relative_to(root)): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file() and path.name not in ("timing.jsonl", ".lock")
    }


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    root = tmp_path_factory.mktemp("dataset")
    build(root)
    return root


def test_every_pair_has_its_files_and_its_line(dataset):
    records = list(read_manifest(dataset))
    assert [record.index for record in records] == [0, 1, 2]
    assert {record.plan_id for record in records} == {"rooms", "corner"}
    assert len({record.seed for record in records}) == 3
    for record in records:
        cad, slam = load_pair(dataset, record.name)
        assert cad.shape == slam.shape == record.shape
        assert set(np.unique(cad)) == {0, 254}
        assert set(np.unique(slam)) <= {0, 205, 254}
        assert 0.0 < record.coverage <= 1.0
        assert record.finished in ("explored", "time_limit")
        assert all(
            math.isfinite(getattr(record, name))
            for name in ("ate", "odometry_ate", "map_error", "mse")
        )


def test_the_episode_folder_agrees_with_the_pair(dataset):
    for record in read_manifest(dataset):
        folder = Layout(dataset).episode(record.name)
        truth = read_tum(folder / "truth.tum")
        odometry = read_tum(folder / "odometry.tum")
        estimate = read_tum(folder / "estimate.tum")
        log = read_carmen(folder / "scans.log.gz")
        assert len(truth) == len(odometry) == len(log)
        # A scan has the stamp of its first beam, 0.1 s before its last.
        assert truth.stamps[-1] + 0.1 == pytest.approx(record.robot_seconds)
        # The files hold micrometres.
        assert truth.length == pytest.approx(record.path_length, abs=1e-3)
        ate = absolute_trajectory_error(estimate, truth, align=False).translation.rmse
        assert ate == pytest.approx(record.ate, abs=1e-4)
        # The map frame begins at the start, with the world's axes.
        assert truth.poses[0] == pytest.approx([0.0, 0.0, record.start[2]], abs=1e-6)
        plan = read_houseexpo(folder / "plan.json")
        assert plan.area == pytest.approx(record.area, rel=1e-4)


def test_the_ros_map_is_the_slam_side(dataset):
    record = next(iter(read_manifest(dataset)))
    grid = read_ros_map(Layout(dataset).episode(record.name) / "map.yaml")
    _, slam = load_pair(dataset, record.name)
    row, col = record.frame.to_cell(*grid.frame.to_point(0, 0))
    window = slam[row : row + grid.frame.height_px, col : col + grid.frame.width_px]
    assert (window == grid.cells).all()


def test_a_map_made_from_true_poses_lies_on_the_plan(tmp_path):
    """Frame and scale of the two sides agree: without errors every wall is within a cell of its place."""
    env = ExploreConfig(slam=SlamConfig(mode="ground_truth"), lidar=lidar_level("gazebo"))
    build(tmp_path, config=DatasetConfig(episode=EpisodeConfig(minutes=0.5, env=env)), pairs=2)
    for record in read_manifest(tmp_path):
        assert record.ate < 1e-6
        assert record.map_error < 0.05
        cad, slam = load_pair(tmp_path, record.name)
        seen = slam == 254
        assert seen.sum() > 500
        # The outermost row of free cells may reach into a wall's face by the noise of a range.
        assert (cad[seen] == 254).mean() > 0.97


def test_a_second_run_changes_nothing(dataset):
    before = content(dataset)
    report = build(dataset)
    assert (report.fresh, report.pairs) == (0, 3)
    assert content(dataset) == before


def test_more_pairs_are_added_to_the_same_folder(dataset, tmp_path):
    build(tmp_path, pairs=2)
    report = build(tmp_path, pairs=3)
    assert (report.fresh, report.pairs) == (1, 3)
    assert content(tmp_path) == content(dataset)


def test_other_settings_are_refused(dataset):
    before = content(dataset)
    with pytest.raises(ConfigError, match=r"seed was 5, now 6"):
        build(dataset, config=dataclasses.replace(QUICK, seed=6))
    with pytest.raises(ConfigError, match=r"plans"):
        build(dataset, plans=Plans(third=FloorPlan("third", box(0, 0, 2, 2))))
    assert content(dataset) == before


def test_plans_that_can_not_be_explored_are_skipped_and_listed(tmp_path):
    plans = Plans(
        broken=PlanError("broken.json", "is empty"), tiny=FloorPlan("tiny", box(0, 0, 0.2, 0.2))
    )
    report = build(tmp_path, plans, pairs=3)
    assert report.pairs == 3
    assert report.rejected == {"PlanError": 2}
    lines = [json.loads(line) for line in Layout(tmp_path).rejected.read_text().splitlines()]
    reasons = {line["plan_id"]: line["reason"] for line in lines}
    assert reasons["broken"] == "is empty"
    assert "robot" in reasons["tiny"]
    assert not {record.plan_id for record in read_manifest(tmp_path)} & {"broken", "tiny"}


def test_two_workers_give_the_same_bytes_as_one(tmp_path):
    plans = Plans(
        broken=PlanError("broken.json", "is empty"), tiny=FloorPlan("tiny", box(0, 0, 0.2, 0.2))
    )
    build(tmp_path / "one", plans, pairs=3, workers=1)
    build(tmp_path / "two", plans, pairs=3, workers=2)
    assert content(tmp_path / "one") == content(tmp_path / "two")


def test_plans_of_which_none_can_be_explored_are_one_clear_error(tmp_path):
    plans = Plans()
    plans.plans = {plan_id: PlanError(plan_id, "is empty") for plan_id in plans.ids}
    some, most = len(plans.ids) - 1, len(plans.ids)
    plans.plans[plans.ids[0]] = PlanError(plans.ids[0], "is no plan")
    with pytest.raises(SlamgymError, match=rf"no plan gave a pair .*{some} of {most}: is empty"):
        build(tmp_path, plans)
    assert len(Layout(tmp_path).rejected.read_text().splitlines()) == 2


def test_a_bug_in_one_exploration_is_recorded_and_the_run_goes_on(tmp_path, monkeypatch):
    from slamgym.dataset.generate import exploration as module

    def explore(plan, *args):
        if plan.id == "corner":
            raise ZeroDivisionError("division by zero")
        return original(plan, *args)

    original = module.run_episode
    monkeypatch.setattr(module, "run_episode", explore)
    report = build(tmp_path, pairs=1)
    if not report.rejected:  # the first slot was the good plan
        report = build(tmp_path, pairs=2)
    assert report.rejected == {"ZeroDivisionError": 1}
    assert "test_build.py" in Layout(tmp_path).rejected.read_text()


def test_an_unknown_explorer_is_one_clear_error_and_nothing_is_left(tmp_path):
    config = dataclasses.replace(
        QUICK, episode=dataclasses.replace(QUICK.episode, explorer="explore_light")
    )
    with pytest.raises(ConfigError, match=r"did you mean 'explore_lite'"):
        build(tmp_path / "out", config=config)
    assert not (tmp_path / "out").exists()


def test_a_full_disk_is_one_clear_error_and_keeps_what_is_there(tmp_path, monkeypatch):
    from slamgym.dataset.generate import exploration as module

    build(tmp_path, pairs=1)
    before = content(tmp_path)

    def full(folder):
        raise OSError(errno.ENOSPC, "No space left on device", str(folder))

    with monkeypatch.context() as patch:
        patch.setattr(module, "sync_tree", full)
        with pytest.raises(StorageError, match=r"disk is full"):
            build(tmp_path, pairs=2)
    assert content(tmp_path) == before
    assert build(tmp_path, pairs=2).fresh == 1


def test_minutes_limit_the_exploration(dataset):
    assert all(record.robot_seconds <= 12.0 + 1e-9 for record in read_manifest(dataset))


class Elsewhere:
    """An engine whose tasks don't see the driver's files, and whose workers die of one plan."""

    shares_files = False

    def __init__(self, deadly=""):
        self.deadly = deadly

    def run(self, task, items):
        for item in items:
            if isinstance(item, str):  # an explorer to try out
                yield task(item)
                continue
            assert item.staged is None
            yield Lost(item, "a worker process died") if item.plan.id == self.deadly else task(item)


def test_files_that_come_back_as_bytes_are_the_same(dataset, tmp_path, monkeypatch):
    monkeypatch.setattr(
        "slamgym.core.parallel.engine.Execution.open", lambda _: contextlib.nullcontext(Elsewhere())
    )
    build(tmp_path)
    assert content(tmp_path) == content(dataset)


def crashing_explorer(name, context, seed=0):
    """Its native code crashes on the plan ``corner``."""
    if seed == exploration_seed(QUICK.seed, "corner", 0):
        os.kill(os.getpid(), signal.SIGSEGV)
    return make_explorer(name, context, seed)


def test_a_crash_costs_one_exploration_with_one_worker_and_the_next_run_goes_on(tmp_path):
    report = build_dataset(tmp_path, Plans(), QUICK, crashing_explorer, pairs=2, workers=1)
    assert (report.pairs, report.rejected) == (2, {"WorkerLostError": 1})
    assert "a worker process died (SIGSEGV) at each of" in Layout(tmp_path).rejected.read_text()
    again = build_dataset(tmp_path, Plans(), QUICK, crashing_explorer, pairs=2, workers=1)
    assert (again.pairs, again.fresh, again.rejected) == (2, 0, report.rejected)


def test_a_plan_that_kills_its_workers_is_skipped_and_listed(tmp_path, monkeypatch):
    engine = Elsewhere(deadly="corner")
    monkeypatch.setattr(
        "slamgym.core.parallel.engine.Execution.open", lambda _: contextlib.nullcontext(engine)
    )
    assert build(tmp_path, pairs=2).rejected == {"WorkerLostError": 1}
    assert {record.plan_id for record in read_manifest(tmp_path)} == {"rooms"}
    assert "process died" in Layout(tmp_path).rejected.read_text()
