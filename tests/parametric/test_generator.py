"""Maps along a path by the simulation's own parts: they are the simulation's where nothing is left to chance."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from slamgym.agents.registry import make_explorer
from slamgym.core.errors import ConfigError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, Pose2D, Trajectory, Twist2D
from slamgym.envs import ExploreConfig
from slamgym.envs.episode import EpisodeConfig, run_episode
from slamgym.parametric.generator import graph_error, map_along_path
from slamgym.parametric.tours import plan_trajectory
from slamgym.sim import (
    ClutterConfig,
    LidarConfig,
    RobotConfig,
    World,
    lidar_level,
    make_clutter,
    odometry_level,
)
from slamgym.sim.surfaces import SurfaceConfig
from slamgym.slam import SlamConfig

EXACT = ExploreConfig(
    lidar=lidar_level("exact"), slam=SlamConfig(mode="ground_truth", resolution=0.1)
)
MODES = ("pose_graph", "rbpf", "dead_reckoning")


def in_mode(mode: str, **changes) -> ExploreConfig:
    return replace(ExploreConfig(), slam=SlamConfig(mode=mode, resolution=0.1), **changes)


def test_an_exploration_with_known_poses_is_drawn_again_cell_by_cell(flat) -> None:
    episode = run_episode(flat, 3, EpisodeConfig("nearest", minutes=0.5, env=EXACT), make_explorer)
    path = Trajectory(
        episode.truth.stamps, episode.truth.poses + np.array([*episode.start[:2], 0.0])
    )
    again = map_along_path(flat, path, EXACT, np.random.default_rng(0)).grid
    known = again.cells != UNKNOWN
    rows = np.flatnonzero(known.any(axis=1))
    cols = np.flatnonzero(known.any(axis=0))
    cells = again.cells[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    assert cells.shape == episode.slam_map.cells.shape
    # Headings are drawn to a rounding error's exactness, which carries single end points over a border.
    assert (cells != episode.slam_map.cells).mean() < 0.002


@pytest.mark.parametrize("sweep", [0.0, 0.1, 0.2])
def test_without_errors_walls_are_only_where_walls_are(flat, tour, sweep) -> None:
    """Also of a laser that takes its time: each beam is drawn where the robot was then."""
    exact = replace(EXACT, lidar=lidar_level("exact", LidarConfig(sweep=sweep)))
    result = map_along_path(flat, tour, exact, np.random.default_rng(0))
    last_beams = (result.true.stamps + sweep) / exact.control_step
    np.testing.assert_allclose(last_beams, np.round(last_beams), atol=1e-6)
    np.testing.assert_allclose(result.field, 0.0, atol=1e-5)
    walls = cv2.dilate((result.cad.cells == OCCUPIED).astype(np.uint8), np.ones((3, 3)))
    assert walls[result.grid.cells == OCCUPIED].all()
    assert (result.grid.cells == FREE).sum() > 1000


@pytest.mark.parametrize("mode", MODES)
def test_a_seed_decides_everything(flat, tour, mode) -> None:
    maps = [map_along_path(flat, tour, in_mode(mode), np.random.default_rng(s)) for s in (1, 1, 2)]
    assert maps[0].grid.cells.tobytes() == maps[1].grid.cells.tobytes()
    assert maps[0].field.tobytes() == maps[1].field.tobytes() != maps[2].field.tobytes()
    assert maps[0].field.shape == (2, *maps[0].grid.cells.shape)
    assert len(maps[0].true) == len(maps[0].believed) == len(maps[0].odometry) > 20
    assert maps[0].seen[maps[0].cad.cells == FREE].mean() > 0.8


def test_mappers_err_less_than_their_odometry(flat, tour) -> None:
    def error(mode: str) -> float:
        env = in_mode(mode, odometry=odometry_level("high"))
        results = [
            map_along_path(flat, tour, env, np.random.default_rng(seed)) for seed in range(4)
        ]
        gaps = [np.abs(each.believed.poses - each.true.poses)[:, :2].mean() for each in results]
        return float(np.mean(gaps))

    assert error("pose_graph") < 0.5 * error("dead_reckoning")
    # The filter errs half as much again for a laser that takes its time: it has no other mend than the odometry's.
    assert error("rbpf") < 0.75 * error("dead_reckoning")


def test_a_graph_errs_alike_where_it_comes_again_and_not_at_its_start() -> None:
    there = np.column_stack([np.linspace(0.0, 8.0, 50), np.zeros(50), np.zeros(50)])
    errors = [
        graph_error(np.vstack([there, there[::-1]]), np.random.default_rng(s)) for s in range(20)
    ]
    assert all((error[0] == 0.0).all() for error in errors)
    first, second = (np.array([error[index, :2] for error in errors]) for index in (49, 50))
    assert np.abs(first - second).mean() < 0.1 * np.abs(first).mean()


def test_a_map_holds_all_that_was_drawn(flat, tour) -> None:
    # Glass lets beams out of the building: the picture ends where they do, not with the plan.
    glass = LidarConfig(range_max=8.0, surfaces=SurfaceConfig(glazing=0.3))
    env = replace(ExploreConfig(), lidar=glass, slam=SlamConfig(max_usable_range=7.9))
    result = map_along_path(flat, tour, env, np.random.default_rng(1))
    known = result.grid.cells != UNKNOWN
    assert result.cad.cells.shape == known.shape
    beyond = known & (
        cv2.dilate((result.cad.cells == FREE).astype(np.uint8), np.ones((31, 31))) == 0
    )
    assert beyond.sum() > 50


def test_furniture_is_seen_and_paths_lead_round_it(flat) -> None:
    clutter = make_clutter(flat, np.random.default_rng(0), ClutterConfig(furniture=1.0, people=1))
    assert clutter.passages is not None
    path = plan_trajectory(flat, np.random.default_rng(1), clutter=clutter)
    rows, cols = clutter.passages.frame.to_cell(*path.poses[:, :2].T)
    assert clutter.passages.clearance[::-1][rows, cols].min() > 0.2
    empty, full = (
        map_along_path(flat, path, EXACT, np.random.default_rng(0), each).grid.cells
        for each in (None, clutter)
    )
    assert (full == OCCUPIED).sum() > 1.1 * (empty == OCCUPIED).sum()


def test_a_carried_robot_rolls_as_a_driven_one_while_people_walk(flat) -> None:
    clutter = make_clutter(flat, np.random.default_rng(0), ClutterConfig(people=1))
    driven, carried = (World(flat, RobotConfig(), clutter=clutter) for _ in range(2))
    driven.reset(Pose2D(1.0, 1.0, 0.3))
    carried.carry(driven.pose, 0.0)
    for _ in range(10):
        motion = driven.step(Twist2D(0.2, 0.4), 0.2)
        again = carried.carry(motion.pose, 0.2)
        np.testing.assert_allclose(again.wheels, motion.wheels, atol=1e-4)
        np.testing.assert_allclose(again.increment, motion.increment, atol=1e-12)
    np.testing.assert_allclose(carried.segments(), driven.segments())


def test_a_path_through_a_wall_is_refused(flat, tour) -> None:
    through = Trajectory(tour.stamps, tour.poses.copy())
    through.poses[len(tour) // 2, :2] = [3.05, 1.0]
    with pytest.raises(ConfigError, match="lies in a wall"):
        map_along_path(flat, through, ExploreConfig(), np.random.default_rng(0))
