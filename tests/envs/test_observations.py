"""Observations: the crop's geometry, and that the truth stays out of them."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.cad import FloorPlan
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN
from slamgym.envs import ExploreEnv
from slamgym.envs.observations import cut_crop

SIZE = 121
RESOLUTION = 0.05
HALF = 0.5 * SIZE * RESOLUTION


def crop_of(
    cells, x=0.0, y=0.0, theta=0.0, size=41, resolution=RESOLUTION, samples=1, corner=0, known=None
):
    out = np.empty((size, size), dtype=np.uint8)
    known = known or (0, 0, *cells.shape)
    tiles = np.ascontiguousarray(cells[::-1]), (corner, corner), RESOLUTION, known
    pose = np.array([x + HALF, y + HALF, theta])
    cut_crop(tiles, pose, resolution / (samples * RESOLUTION), samples, out)
    return out


@pytest.mark.parametrize(
    ("quarter_turns", "theta"), [(1, 0.0), (0, math.pi / 2), (-1, math.pi), (2, -math.pi / 2)]
)
def test_ahead_is_up_in_the_crop(quarter_turns, theta):
    """A robot that looks north sees the map as it is; one that looks east sees it turned left."""
    rng = np.random.default_rng(0)
    cells = rng.choice([FREE, UNKNOWN, OCCUPIED], (SIZE, SIZE)).astype(np.uint8)
    middle = slice(SIZE // 2 - 20, SIZE // 2 + 21)
    expected = np.rot90(cells[middle, middle], quarter_turns)
    assert np.array_equal(crop_of(cells, theta=theta), expected)


@given(
    st.floats(-0.8, 0.8),
    st.floats(-0.8, 0.8),
    st.floats(-math.pi, math.pi),
    st.floats(0.2, 0.9),
    st.floats(-1, 1),
)
@settings(max_examples=60)
def test_a_landmark_appears_where_it_is_seen(x, y, theta, ahead, left):
    cells = np.full((SIZE, SIZE), UNKNOWN, dtype=np.uint8)
    mark_x = x + ahead * math.cos(theta) - left * math.sin(theta)
    mark_y = y + ahead * math.sin(theta) + left * math.cos(theta)
    row = SIZE - 1 - math.floor((mark_y + HALF) / RESOLUTION)
    col = math.floor((mark_x + HALF) / RESOLUTION)
    cells[row, col] = OCCUPIED
    rows, cols = np.nonzero(crop_of(cells, x, y, theta, size=60, samples=2) == OCCUPIED)
    # Centres of the crop's cells, ahead and to the left [m]; the landmark's own cell is 0.05 m wide.
    seen_ahead = (29.5 - rows) * RESOLUTION
    seen_left = (29.5 - cols) * RESOLUTION
    distance = np.hypot(seen_ahead - ahead, seen_left - left)
    assert distance.max() <= 1.5 * RESOLUTION * math.sqrt(2.0)


def test_a_coarse_crop_keeps_obstacles():
    cells = np.full((SIZE, SIZE), FREE, dtype=np.uint8)
    cells[::8, ::8] = OCCUPIED
    cells[4::8, 4::8] = UNKNOWN
    # Half a cell off, so that the samples lie in the middle of cells.
    half = 0.5 * RESOLUTION
    coarse = crop_of(cells, half, half, size=20, resolution=4 * RESOLUTION, samples=4)
    assert set(np.unique(coarse)) == {OCCUPIED, FREE}
    assert np.count_nonzero(coarse == OCCUPIED) == 100  # one of four coarse cells holds a point


@given(
    st.floats(-3.5, 3.5),
    st.floats(-3.5, 3.5),
    st.floats(-math.pi, math.pi),
    st.integers(0, 2**32 - 1),
)
@settings(max_examples=60)
def test_a_crop_is_the_same_wherever_the_map_is_looked_at(x, y, theta, seed):
    """Only what is known must be read; the borders of the map and of what is known are met to the cell."""
    rng = np.random.default_rng(seed)
    top, left = rng.integers(1, 60, 2)
    end, right = rng.integers(61, SIZE, 2)
    shown = np.full((SIZE, SIZE), UNKNOWN, dtype=np.uint8)
    shown[top:end, left:right] = rng.choice([FREE, OCCUPIED], (end - top, right - left))
    known = SIZE - int(end), int(left), SIZE - int(top), int(right)
    grid = {"size": 42, "resolution": 2 * RESOLUTION, "samples": 2}
    crop = crop_of(shown, x, y, theta, **grid, known=known)
    wide = np.pad(shown, 200, constant_values=UNKNOWN)
    assert np.array_equal(crop, crop_of(shown, x, y, theta, **grid))
    assert np.array_equal(crop, crop_of(wide, x, y, theta, **grid, corner=-200))


def test_outside_of_the_map_is_unknown():
    cells = np.full((SIZE, SIZE), FREE, dtype=np.uint8)
    assert (crop_of(cells, x=50.0) == UNKNOWN).all()


def observations(env: ExploreEnv, start: tuple, steps: int = 25) -> list:
    trace = [env.reset(seed=9, options={"start": start})[0]]
    for i in range(steps):
        turn = 0.4 if i % 10 < 5 else -0.4
        trace.append(env.step((0.3, turn))[0])
    return trace


# Laser level "gazebo": materials are drawn from the geometry of the whole building.
@pytest.mark.parametrize("view", ["egocentric", "global"])
@pytest.mark.parametrize("mode", ["rbpf", "ground_truth"])
def test_what_was_not_sensed_does_not_show(view: str, mode: str):
    """Two buildings that differ only behind a wall give the very same observations."""
    hall = shapely.box(0, 0, 6, 4)
    door = shapely.box(5.9, 1, 6.3, 2)
    small = shapely.box(6.2, 0, 9, 4)
    large = shapely.box(6.2, -2, 11, 5)
    plans = [
        FloorPlan(str(i), shapely.union_all([hall, door, room]))
        for i, room in enumerate((small, large))
    ]
    traces = [
        observations(
            ExploreEnv(
                plan,
                localization=mode,
                lidar="gazebo",
                observation={"map": view, "map_size": 24.0},
                slam={"particles": 4},
            ),
            (1.0, 2.0, 1.5),
        )
        for plan in plans
    ]
    for first, second in zip(*traces, strict=True):
        for key in first:
            assert np.array_equal(first[key], second[key]), key


@pytest.mark.parametrize("mode", ["rbpf", "ground_truth"])
def test_the_place_of_the_plan_in_the_world_does_not_show(mode: str, flat: FloorPlan):
    """Shifting the whole building changes nothing that the robot observes, but for rounding."""
    shift = (1024.0, -2048.0)
    moved = FloorPlan(flat.id, shapely.affinity.translate(flat.free_space, *shift))
    # Few steps: rounding of 1e-13 m may flip a cell's border and, in the end, a particle's fate.
    here, there = (
        observations(
            ExploreEnv(plan, localization=mode, lidar="gazebo", slam={"particles": 4}),
            (2.0 + dx, 2.0 + dy, 0.3),
            steps=10,
        )
        for plan, (dx, dy) in ((flat, (0.0, 0.0)), (moved, shift))
    )
    for first, second in zip(here, there, strict=True):
        for key in ("scan", "pose", "velocity", "time"):
            assert first[key] == pytest.approx(second[key], abs=1e-4), key
        assert np.mean(first["map"] != second["map"]) < 0.002


def test_pose_is_the_belief_in_the_map_frame(flat: FloorPlan):
    env = ExploreEnv(flat, odometry="high", localization="dead_reckoning")
    observation = observations(env, (2.0, 2.0, 0.3))[-1]
    assert observation["pose"] == pytest.approx(env.simulation.believed_pose, abs=1e-6)
    assert observation["pose"] == pytest.approx(env.simulation.odometry_pose, abs=1e-6)
    assert not np.allclose(
        observation["pose"][:2] + np.array([2.0, 2.0]), env.simulation.true_pose[:2], atol=1e-3
    )


def test_no_return_reads_as_the_range_and_too_near_as_zero():
    corridor = FloorPlan("corridor", shapely.box(0, 0, 30, 2))
    env = ExploreEnv(corridor, lidar="exact", robot={"radius": 0.05})
    observation, _ = env.reset(options={"start": (1.0, 1.0, 0.0)})
    assert observation["scan"][90] == np.float32(3.5)
    observation, _ = env.reset(options={"start": (29.9, 1.0, 0.0)})
    env2 = ExploreEnv(
        corridor,
        lidar={"mount": (0.0, 0.0, 0.0), "range_min": 0.12},
        robot={"radius": 0.05},
        odometry="ideal",
    )
    observation, _ = env2.reset(seed=0, options={"start": (29.93, 1.0, 0.0)})
    assert np.median(observation["scan"][80:100]) == 0.0
    assert observation in env2.observation_space


def test_velocity_is_what_the_wheels_measured(hall: FloorPlan):
    env = ExploreEnv(hall, odometry="ideal")
    env.reset(seed=0, options={"start": (1.0, 1.5, 0.0)})
    for _ in range(4):
        observation = env.step((0.5, 0.0))[0]
    assert observation["velocity"] == pytest.approx((0.13, 0.0), abs=1e-6)
    for _ in range(4):
        observation = env.step((0.0, -0.5))[0]
    assert observation["velocity"] == pytest.approx((0.0, -0.91), abs=1e-6)
