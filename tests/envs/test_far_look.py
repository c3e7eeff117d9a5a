"""The preset ``compact_far``: what ``compact`` holds, and which way leads to the nearest unknown space."""

import math

import numpy as np
import pytest

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, Pose2D, Twist2D
from slamgym.envs import ExploreEnv
from slamgym.envs.compact import CompactObserver, MapTiles, compact_size
from slamgym.envs.far_look import FAR_SIZE, SECTORS

FRAME = GridFrame(0.05, -12.8, -12.8, 512, 512)
RADIUS = 0.22
NOTHING = np.full(180, np.inf, dtype=np.float32)


def observe(cells, pose, frame=FRAME):
    """The near numbers, those of the directions, the length of the shortest way [m], and where it leaves."""
    observer = CompactObserver(180, (0.26, 1.82, 3.5), 8.4, RADIUS)
    shown = MapTiles.of_grid(cells, frame)
    observer.refresh(shown)
    seen = observer.observe(shown, NOTHING, pose, Twist2D(0.0, 0.0))
    assert seen in observer.space
    near, far = np.split(seen, [compact_size(180)])
    return near, far[:SECTORS], 25.0 * far[SECTORS], far[SECTORS + 1 :]


def corridor(end):
    """Free from x = -10 m to a column, where it is unknown, between walls at y = -1 and 1 m."""
    cells = np.full(FRAME.shape, UNKNOWN, dtype=np.uint8)
    cells[236:277, 52:end] = OCCUPIED
    cells[237:276, 56:end] = FREE
    return cells


@pytest.mark.parametrize("theta", [0.0, 2.0, -1.3])
def test_it_shows_a_border_that_compact_does_not(theta):
    ends_far = corridor(end=256 + 160)  # at x = 8 m
    ends_farther = corridor(end=256 + 200)  # at x = 10 m
    pose = Pose2D(0.0, 0.0, theta)
    near, directions, way, leaves = observe(ends_far, pose)
    farther_near, _, longer, _ = observe(ends_farther, pose)
    np.testing.assert_array_equal(near, farther_near)
    assert way == pytest.approx(8.0, abs=0.5)
    assert longer == pytest.approx(10.0, abs=0.5)
    best = 2.0 * math.pi * np.argmax(directions) / SECTORS
    assert math.cos(best + theta) > 0.9  # towards +x
    assert leaves == pytest.approx([math.cos(theta), -math.sin(theta)], abs=0.15)
    assert directions.max() == 1.0


def test_ways_lead_round_walls():
    cells = np.full(FRAME.shape, OCCUPIED, dtype=np.uint8)
    cells[200:312, 200:312] = FREE  # a room of 5.6 m about the origin
    cells[196:200, 200:312] = UNKNOWN  # unknown behind its upper wall,
    cells[200:204, 200:312] = OCCUPIED
    cells[200:204, 290:310] = FREE  # which has a door at the right
    _, directions, way, leaves = observe(cells, Pose2D(-2.0, 1.5, math.pi / 2))
    ahead = directions[0]
    right = directions[3 * SECTORS // 4]
    assert way > 4.0  # 1.1 m through the wall
    assert right > 0.8 > ahead
    assert leaves[1] < -0.8


@pytest.mark.parametrize(("gap", "fits"), [(0.40, False), (0.65, True)])
def test_ways_lead_through_gaps_that_the_robot_fits_through(gap, fits):
    cells = np.full(FRAME.shape, OCCUPIED, dtype=np.uint8)
    cells[200:312, 200:312] = FREE
    cells[200:312, 256:260] = OCCUPIED  # a wall across, with a gap
    half = round(0.5 * gap / 0.05)
    cells[256 - half : 256 + half + round(gap / 0.05) % 2, 256:260] = FREE
    cells[200:312, 312:316] = UNKNOWN  # beyond the other half
    _, directions, way, _ = observe(cells, Pose2D(-1.5, 1.5, 0.0))
    assert (way < 25.0) == directions.any() == fits


def test_without_a_border_nothing_is_to_be_done():
    cells = np.full(FRAME.shape, OCCUPIED, dtype=np.uint8)
    cells[200:312, 200:312] = FREE
    _, directions, way, leaves = observe(cells, Pose2D(0.0, 0.0, 0.0))
    assert not directions.any()
    assert not leaves.any()
    assert way == 25.0


def test_it_doesnt_matter_which_part_of_the_map_is_given():
    cells = corridor(end=400)
    pose = Pose2D(0.123, -0.456, 0.789)
    part = GridFrame(0.05, -12.8 + 0.05 * 41, -12.8 + 0.05 * 201, 410, 98)
    inner = np.ascontiguousarray(cells[512 - 201 - 98 : 512 - 201, 41 : 41 + 410])
    for whole, cut in zip(observe(cells, pose), observe(inner, pose, part), strict=True):
        np.testing.assert_array_equal(whole, cut)


@pytest.mark.parametrize("shown", ["egocentric", "global"])
def test_it_is_looked_at_anew_where_the_map_is_published(flat, shown):
    env = ExploreEnv(
        flat, localization="ground_truth", observation={"preset": "compact_far", "map": shown}
    )
    twin = ExploreEnv(
        flat, localization="ground_truth", observation={"preset": "compact", "map": shown}
    )
    observation, _ = env.reset(seed=0)
    plain, _ = twin.reset(seed=0)
    assert observation.shape == (compact_size(180) + FAR_SIZE,)
    for _ in range(25):
        assert observation in env.observation_space
        np.testing.assert_array_equal(observation[: len(plain)], plain)
        observation, *_ = env.step((1.0, 0.3))
        plain, *_ = twin.step((1.0, 0.3))
