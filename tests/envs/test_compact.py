"""The observation presets: what ``compact`` holds, and that all are chosen by name."""

import math

import numpy as np
import pytest

from slamgym.core.errors import ConfigError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, Pose2D, Twist2D
from slamgym.envs import ExploreEnv
from slamgym.envs.compact import (
    BLOCKS,
    MAP_TILE,
    CompactObserver,
    Lattice,
    compact_size,
    pack_tiles,
    write_compact,
)

FRAME = GridFrame(0.05, -8.0, -8.0, 320, 320)
NOTHING = np.full(180, np.inf, dtype=np.float32)


def observe(cells, pose=Pose2D(0.0, 0.0, 0.0), ranges=NOTHING, velocity=Twist2D(0.0, 0.0), frame=FRAME):
    observer = CompactObserver(180, (0.26, 1.82, 3.5), 8.4)
    seen = observer.observe(Lattice.of(cells, frame), ranges, pose, velocity)
    shares, rest = seen[: 2 * BLOCKS**2].reshape(2, BLOCKS, BLOCKS), seen[2 * BLOCKS**2 :]
    return shares[0], shares[1], rest[:60], rest[60:]


def test_blocks_hold_the_shares_of_free_and_occupied_space():
    cells = np.full(FRAME.shape, UNKNOWN, dtype=np.uint8)
    cells[:, 160:] = FREE  # x > 0
    cells[:, 240:] = OCCUPIED  # x > 4
    free, occupied, _, _ = observe(cells, Pose2D(0.0, 0.0, math.pi / 2))  # ahead is +y, so +x is right
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
    cells = np.random.default_rng(0).choice([FREE, UNKNOWN, OCCUPIED], FRAME.shape).astype(np.uint8)
    pose = Pose2D(0.123, -0.456, 0.789)
    part = GridFrame(0.05, -7.0, -7.5, 290, 290)
    inner = np.ascontiguousarray(cells[20 : 20 + 290, 20 : 20 + 290])
    for whole, cut in zip(observe(cells, pose), observe(inner, pose, frame=part), strict=True):
        np.testing.assert_array_equal(whole, cut)


def test_it_doesnt_matter_whether_the_map_is_packed():
    rng, corner, limits = np.random.default_rng(0), (3, -7), np.array([0.26, 1.82, 3.5])
    rows, cols = 200, 240
    cells = np.full((rows, cols), UNKNOWN, dtype=np.uint8)
    tiles = np.zeros((rows // MAP_TILE, cols // MAP_TILE), np.uint32)
    packed = tiles, tiles.astype(np.uint8)
    nothing = np.zeros((0, 0), np.uint32), np.zeros((0, 0), np.uint8)
    kinds = set()
    for _ in range(40):
        row, col, height, width = rng.integers(rows), rng.integers(cols), *rng.integers(1, 90, 2)
        box = int(row), int(col), min(int(row + height), rows), min(int(col + width), cols)
        part = cells[box[0] : box[2], box[1] : box[3]]
        values = [FREE] if rng.random() < 0.7 else [FREE, UNKNOWN, OCCUPIED]
        part[:] = rng.choice(values, part.shape)
        pack_tiles(cells, box, packed)
        pose = np.array([rng.uniform(-1.0, 12.0), rng.uniform(-1.0, 10.0), rng.uniform(-4.0, 4.0)])
        seen = np.empty((3, compact_size(180)), np.float32)
        for k, (view, tables, up) in enumerate(
            (
                (cells, packed, True),
                (cells, nothing, True),
                (np.ascontiguousarray(cells[::-1]), nothing, False),
            )
        ):
            write_compact(
                view, tables, up, corner, 0.05, pose, 8.4, NOTHING, np.zeros(2), limits, seen[k]
            )  # fmt: skip
        np.testing.assert_array_equal(seen[1], seen[0])
        np.testing.assert_array_equal(seen[2], seen[0])
        kinds |= set(packed[1].ravel().tolist())
    assert kinds == {0, 1, 2}


def test_ranges_and_velocity_are_scaled():
    ranges = NOTHING.copy()
    ranges[3], ranges[4], ranges[179] = 1.75, 3.0, -np.inf
    cells = np.full(FRAME.shape, UNKNOWN, dtype=np.uint8)
    _, _, nearest, velocity = observe(cells, ranges=ranges, velocity=Twist2D(0.13, -5.0))
    assert nearest[1] == 0.5  # the nearest of beams 3 to 5
    assert nearest[59] == 0.0
    assert np.all(np.delete(nearest, [1, 59]) == 1.0)
    assert velocity.tolist() == [0.5, -1.0]


@pytest.mark.parametrize("shown", ["egocentric", "global"])
def test_presets_are_chosen_by_name(flat, shown):
    for preset, shape in (("compact", (compact_size(180),)), ("map", None)):
        env = ExploreEnv(flat, localization="ground_truth", observation={"preset": preset, "map": shown})
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
