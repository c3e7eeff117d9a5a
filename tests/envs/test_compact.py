"""The observation presets: what ``compact`` holds, and that all are chosen by name."""

import math

import numpy as np
import pytest

from slamgym.core.errors import ConfigError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, Pose2D, Twist2D
from slamgym.envs import ExploreEnv
from slamgym.envs.compact import BLOCKS, CompactObserver, MapTiles, compact_size

FRAME = GridFrame(0.05, -8.0, -8.0, 320, 320)
NOTHING = np.full(180, np.inf, dtype=np.float32)


def observe(
    cells, pose=Pose2D(0.0, 0.0, 0.0), ranges=NOTHING, velocity=Twist2D(0.0, 0.0), frame=FRAME
):
    observer = CompactObserver(180, (0.26, 1.82, 3.5), 8.4)
    seen = observer.observe(MapTiles.of_grid(cells, frame), ranges, pose, velocity)
    shares, ranges_seen, velocity_seen = np.split(seen, [2 * BLOCKS**2, 2 * BLOCKS**2 + 60])
    free, occupied = shares.reshape(2, BLOCKS, BLOCKS)
    return free, occupied, ranges_seen, velocity_seen


def test_blocks_hold_the_shares_of_free_and_occupied_space():
    cells = np.full(FRAME.shape, UNKNOWN, dtype=np.uint8)
    cells[:, 160:] = FREE  # x > 0
    cells[:, 240:] = OCCUPIED  # x > 4
    ahead_is_y = Pose2D(0.0, 0.0, math.pi / 2)
    free, occupied, _, _ = observe(cells, ahead_is_y)  # +x is right
    assert np.allclose(free[:, :10], 0.0)
    assert np.allclose(free[:, 11:20], 1.0)
    assert np.allclose(occupied[:, 20], 0.5, atol=0.26)  # from 3.8 to 4.2 m
    assert np.allclose(free[:, 20] + occupied[:, 20], 1.0)
    ahead, _, _, _ = observe(cells, Pose2D(0.0, 0.0, 0.0))
    assert np.allclose(ahead[11:], 0.0)
    assert np.allclose(ahead[1:10], 1.0)


def test_what_lies_beyond_the_map_is_unknown():
    cells = np.full(FRAME.shape, FREE, dtype=np.uint8)
    free, occupied, _, _ = observe(cells, Pose2D(8.0, 0.0, 0.0))
    assert not free[:9].any()
    assert not occupied.any()
    assert free[12:].all()


def test_it_doesnt_matter_which_part_of_the_map_is_given():
    rng = np.random.default_rng(0)
    cells = rng.choice([FREE, UNKNOWN, OCCUPIED], FRAME.shape).astype(np.uint8)
    pose = Pose2D(0.123, -0.456, 0.789)
    part = GridFrame(0.05, -7.0, -7.5, 290, 290)
    inner = np.ascontiguousarray(cells[20 : 20 + 290, 20 : 20 + 290])
    for whole, cut in zip(observe(cells, pose), observe(inner, pose, frame=part), strict=True):
        np.testing.assert_array_equal(whole, cut)


def read_points(cells, corner, pose):
    """The cells at all points of the crop, shape (84, 84): in its middle is the robot, ahead is up."""
    pitch = 8.4 / (84 * 0.05)
    down, right = pitch * (np.indices((84, 84)) - 41.5)
    sin = np.sin(pose.theta)
    cos = np.cos(pose.theta)
    row = np.floor(pose.y / 0.05 - down * sin - right * cos).astype(int) - corner[0]
    col = np.floor(pose.x / 0.05 - down * cos + right * sin).astype(int) - corner[1]
    margin = 400
    padded = np.pad(cells, margin, constant_values=UNKNOWN)
    return padded[row + margin, col + margin]


def test_blocks_show_the_cells_at_their_points():
    rng = np.random.default_rng(0)
    cells = np.full((200, 240), UNKNOWN, dtype=np.uint8)
    tiles = MapTiles(cells, (4, -8), 0.05, (0, 0, *cells.shape))
    observer = CompactObserver(180, (0.26, 1.82, 3.5), 8.4)
    for _ in range(40):
        row, col = rng.integers(cells.shape)
        height, width = rng.integers(1, 90, 2)
        part = cells[row : row + height, col : col + width]
        values = [FREE] if rng.random() < 0.7 else [FREE, UNKNOWN, OCCUPIED]
        part[:] = rng.choice(values, part.shape)
        pose = Pose2D(rng.uniform(-1.0, 12.0), rng.uniform(-1.0, 10.0), rng.uniform(-4.0, 4.0))
        seen = observer.observe(tiles, NOTHING, pose, Twist2D(0.0, 0.0))
        read = read_points(cells, tiles.corner, pose)
        for value, shown in zip((FREE, OCCUPIED), seen[:882].reshape(2, 21, 21), strict=True):
            shares = (read == value).reshape(21, 4, 21, 4).mean(axis=(1, 3))
            assert np.mean(shares != shown) < 0.01  # points on a border between cells


def test_ranges_and_velocity_are_scaled():
    ranges = NOTHING.copy()
    ranges[3] = 1.75
    ranges[4] = 3.0
    ranges[179] = -np.inf
    cells = np.full(FRAME.shape, UNKNOWN, dtype=np.uint8)
    _, _, nearest, velocity = observe(cells, ranges=ranges, velocity=Twist2D(0.13, -5.0))
    assert nearest[1] == 0.5  # the nearest of beams 3 to 5
    assert nearest[59] == 0.0
    assert np.all(np.delete(nearest, [1, 59]) == 1.0)
    assert velocity.tolist() == [0.5, -1.0]


@pytest.mark.parametrize("shown", ["egocentric", "global"])
def test_presets_are_chosen_by_name(flat, shown):
    for preset, shape in (("compact", (compact_size(180),)), ("map", None)):
        env = ExploreEnv(
            flat, localization="ground_truth", observation={"preset": preset, "map": shown}
        )
        observation, _ = env.reset(seed=0)
        for _ in range(5):
            assert observation in env.observation_space
            assert shape is None or observation.shape == shape
            observation, *_ = env.step((1.0, 0.3))
    with pytest.raises(ConfigError, match="compact"):
        ExploreEnv(flat, observation={"preset": "compct"})


def test_explorers_need_the_dictionary(flat):
    env = ExploreEnv(flat, observation={"preset": "compact", "map": "global"})
    with pytest.raises(ConfigError, match="dict"):
        env.explorer_context()
