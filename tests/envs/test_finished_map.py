"""The mode ``map``: a robot that is given a finished map, and what ``info`` says of doubt."""

import dataclasses

import numpy as np
import pytest

from slamgym.core.errors import InputFileError
from slamgym.core.types import FREE
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.interop import write_ros_map

START = {"localization": {"start": "known"}}


def drive(env, steps, seed=2):
    """Ahead and round; the infos."""
    env.reset(seed=seed)
    infos = []
    for step in range(steps):
        action = [0.2, 0.3] if step % 40 < 25 else [0.0, 1.0]
        infos.append(env.step(np.array(action, dtype=np.float32))[4])
    return infos


def test_a_robot_with_a_drawing_of_the_plan_keeps_its_place(flat):
    env = ExploreEnv(flat, actions="physical", slam={"mode": "map", **START}, odometry="high")
    infos = drive(env, 150)
    assert max(info["pose_error"] for info in infos[20:]) < 0.15
    assert not infos[-1]["is_doubtful"]
    assert env.simulation.mapper.belief.state == "localised"
    grid = env.simulation.mapper.occupancy_grid()
    assert (grid.cells == FREE).sum() > 500, "it draws what it sees"


def test_without_a_start_the_place_is_in_doubt_first(flat):
    env = ExploreEnv(flat, actions="physical", localization="map")
    infos = drive(env, 100)
    assert infos[0]["is_doubtful"]
    assert infos[0]["doubtful_scans"] > 0
    assert {"searching", "ambiguous", "localised"} >= set(env.simulation.mapper.report()["states"])


def test_the_map_may_come_from_a_file(flat, tmp_path):
    write_ros_map(tmp_path, flat.raster(0.05))
    config = dataclasses.replace(ExploreConfig(), finished_map=str(tmp_path / "map.yaml"))
    env = ExploreEnv(flat, config, actions="physical", slam={"mode": "map", **START})
    assert drive(env, 60)[-1]["pose_error"] < 0.15
    missing = ExploreEnv(flat, localization="map", finished_map=str(tmp_path / "other.yaml"))
    with pytest.raises(InputFileError, match=r"other\.yaml"):
        missing.reset(seed=1)


def test_a_seed_decides_everything(flat):
    poses = []
    for _ in range(2):
        env = ExploreEnv(flat, actions="physical", localization="map")
        drive(env, 40)
        poses.append(env.simulation.believed_pose)
    assert poses[0] == poses[1]


def test_other_modes_say_doubt_in_info(flat):
    env = ExploreEnv(flat, actions="physical")
    assert all(info["is_doubtful"] in (False, True) for info in drive(env, 10))
