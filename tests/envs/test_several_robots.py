"""Several robots explore one building, each with its own sensors, noise and map."""

import math

import numpy as np
import pytest

from slamgym.core.errors import ConfigError
from slamgym.envs.batch.exploration import Explorations
from slamgym.envs.config import resolve_config
from slamgym.envs.plan_cache import PlanCache, ResetOptions
from slamgym.envs.rewards import Reward
from slamgym.sim.contact import SKIN

SETTINGS = {"localization": "ground_truth", "observation": {"preset": "compact"}}


def explorations(plan, count, team_size, threads=1, **settings):
    config = resolve_config(None, {**SETTINGS, **settings})
    return Explorations(
        config,
        count,
        PlanCache(plan, config.robot, config.lidar.surfaces),
        Reward(config.reward, None),
        threads=threads,
        prefers_kernels=True,
        team_size=team_size,
    )


def begin(robots, seed=0, starts=None):
    count = len(robots.fleet)
    generators = [np.random.default_rng([seed, k]) for k in range(count)]
    wanted = ResetOptions.read({"start": starts} if starts else None)
    robots.begin(np.ones(count, dtype=np.bool_), generators, wanted)


def test_a_robot_sees_the_other_and_is_seen(hall):
    robots = explorations(hall, 2, 2, lidar="exact")
    begin(robots, starts=[(0.6, 1.5, 0.0), (2.0, 1.5, math.pi)])
    ahead = robots.fleet.scans.true[:, robots.fleet.scans.true.shape[1] // 2]
    radius = robots.fleet.config.robot.radius
    # The laser looks from 0.064 m behind the middle; faces lie up to 4 mm within the circle.
    expected = 1.4 + 0.064 - radius
    assert ahead == pytest.approx([expected] * 2, abs=0.005)
    robots.step(np.array([[0.0, 0.0], [0.26, 0.0]]))
    nearer = robots.fleet.scans.true[0, len(robots.fleet.scans.true[0]) // 2]
    assert 0.03 < expected - nearer < 0.06, "the scan follows the other robot"


def test_robots_that_drive_into_each_other_touch(hall):
    robots = explorations(hall, 2, 2)
    begin(robots, starts=[(0.8, 1.5, 0.0), (2.2, 1.5, math.pi)])
    for _ in range(25):
        record = robots.step(np.array([[0.26, 0.0]] * 2)).record
    assert record.contact.all()
    assert robots.fleet.robots.collisions.tolist() == [1, 1]
    assert (robots.assessment._read(robots.assessment._step, "clearance", None) < 2.0 * SKIN).all()
    places = robots.fleet.robots.pose[:, :2]
    radius = robots.fleet.config.robot.radius
    assert 2.0 * radius <= math.dist(*places) <= 2.0 * (radius + SKIN)


def test_a_pushed_robot_moves_and_its_wheels_do_not_know(hall):
    robots = explorations(hall, 2, 2, odometry="ideal", localization="dead_reckoning")
    begin(robots, starts=[(0.5, 1.5, 0.0), (1.2, 1.5, math.pi / 2)])
    robots.step(np.zeros((2, 2)))
    for _ in range(20):
        robots.step(np.array([[0.26, 0.0], [0.0, 0.0]]))
    assert robots.fleet.robots.pose[1, 0] > 1.4
    believed = robots.beliefs.maps.believed[1]
    # An ideal odometry measures the body; a real one rolls.
    assert believed[0] == pytest.approx(robots.fleet.robots.pose[1, 0] - 1.2)
    assert robots.fleet.robots.drive[1, 5:7].tolist() == [0.0, 0.0]


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"lidar": {"sweep": 0.1}, "clutter": {"furniture": 1.0, "people": 2, "changes": 30.0}},
        {"localization": "dead_reckoning", "observation": {"preset": "dict"}, "odometry": "high"},
    ],
)
def test_the_same_seed_gives_the_same_with_any_number_of_threads(flat, settings):
    runs = []
    for threads in (1, 2, 2):
        robots = explorations(flat, 4, 2, threads, **settings)
        begin(robots, seed=3)
        commands = np.random.default_rng(1)
        for _ in range(60):
            outcome = robots.step(commands.uniform((0.0, -1.0), (0.26, 1.0), (4, 2)))
        runs.append(
            [
                robots.fleet.robots.pose.copy(),
                robots.fleet.scans.ranges.copy(),
                robots.beliefs.maps.believed.copy(),
                outcome.rewards,
            ]
        )
    for run in runs[1:]:
        for one, other in zip(runs[0], run, strict=True):
            np.testing.assert_array_equal(one, other)
    pose = runs[0][0]
    assert not np.allclose(pose[0], pose[2]), "each building has draws of its own"


def test_robots_begin_together_and_apart(flat):
    robots = explorations(flat, 6, 3)
    begin(robots)
    assert robots.fleet.building_of_robot.tolist() == [0, 0, 0, 1, 1, 1]
    for first in (0, 3):
        places = robots.fleet.robots.start[first : first + 3, :2]
        distances = np.hypot(*(places[:, None] - places).T)[np.triu_indices(3, 1)]
        assert distances.min() >= 2.0 * robots.fleet.config.robot.radius
    generators = [np.random.default_rng(k) for k in range(6)]
    with pytest.raises(ValueError, match="begin together"):
        robots.begin(np.arange(6) > 1, generators, ResetOptions())


@pytest.mark.parametrize(
    ("starts", "message"),
    [([(0.6, 1.5, 0.0)], "2 poses"), ([(0.6, 1.5, 0.0), (0.9, 1.5, 0.0)], "another robot")],
)
def test_starts_that_do_not_fit_are_refused(hall, starts, message):
    with pytest.raises(ConfigError, match=message):
        begin(explorations(hall, 2, 2), starts=starts)
