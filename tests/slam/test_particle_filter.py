"""The particle filter: its map, its path, its honesty with perfect sensors."""

import itertools
import math

import numpy as np
import pytest

from slamgym.core.errors import ConfigError, SlamgymError
from slamgym.core.geometry import between, compose
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, LaserGeometry, LaserScan, Pose2D
from slamgym.sim.raycast import cast_rays
from slamgym.slam import SlamConfig, make_mapper
from slamgym.slam.hit_count_kernels import BeamTable
from slamgym.slam.hit_counts import HitCountMap

# Two rooms and a door between them.
WALLS = np.array(
    [
        (-3, -2, 5, -2),
        (5, -2, 5, 2.5),
        (5, 2.5, -3, 2.5),
        (-3, 2.5, -3, -2),
        (1, -2, 1, 0),
        (1, 0.9, 1, 2.5),
    ],
    dtype=np.float64,
)
GEOMETRY = LaserGeometry(180, -np.pi / 2, np.pi / 179, 0.12, 3.5, Pose2D(-0.064, 0.0, 0.0))


def scan_at(pose, stamp, rng=None, sigma=0.0):
    sensor = compose(pose, GEOMETRY.mount)
    ranges = np.empty(GEOMETRY.num_beams)
    cast_rays(*sensor, GEOMETRY.angle_min, GEOMETRY.angle_increment, WALLS, 3.5, ranges)
    if rng is not None:
        ranges += sigma * rng.standard_normal(len(ranges))
    return LaserScan(stamp, ranges.astype(np.float32), GEOMETRY)


def drive(steps=160):
    """True poses of a robot that circles in the left room, goes through the door and comes back."""
    poses = [Pose2D(-1.0, 0.4, 0.0)]
    for k in range(steps):
        turn = 0.1 if k < 63 else (0.0 if k < 110 else 0.06)
        poses.append(compose(poses[-1], Pose2D(0.05, 0.0, turn)))
    return poses


def noisy_odometry(poses, rng, level):
    odometry = [poses[0]]
    for before, after in itertools.pairwise(poses):
        step = between(before, after)
        noise = (
            level
            * rng.standard_normal(3)
            * [abs(step.x), abs(step.x), abs(step.x) + abs(step.theta)]
        )
        odometry.append(
            compose(
                odometry[-1], Pose2D(step.x + noise[0], step.y + noise[1], step.theta + noise[2])
            )
        )
    return odometry


def run(config, *, sigma=0.0, odometry_noise=0.0, seed=0, visit=None):
    rng = np.random.default_rng(seed)
    poses = drive()
    odometry = noisy_odometry(poses, rng, odometry_noise)
    mapper = make_mapper(config, GEOMETRY, poses[0], np.random.default_rng(seed))
    for k, (pose, measured) in enumerate(zip(poses, odometry, strict=True)):
        mapper.update(measured, scan_at(pose, 0.2 * k, rng, sigma))
        if visit is not None:
            visit(mapper, pose)
    return mapper, poses


def position_error(mapper, pose):
    return math.hypot(mapper.pose.x - pose.x, mapper.pose.y - pose.y)


@pytest.mark.parametrize("mode", ["ground_truth", "dead_reckoning"])
def test_known_poses_are_believed_exactly(mode):
    mapper, poses = run(SlamConfig(mode=mode))
    assert position_error(mapper, poses[-1]) < 1e-9


def test_the_filter_corrects_bad_odometry():
    filtered, poses = run(SlamConfig("rbpf", particles=8), sigma=0.01, odometry_noise=0.5)
    reckoned, _ = run(SlamConfig(mode="dead_reckoning"), sigma=0.01, odometry_noise=0.5)
    assert position_error(filtered, poses[-1]) < 0.1
    assert position_error(filtered, poses[-1]) < 0.5 * position_error(reckoned, poses[-1])


def test_the_published_map_equals_a_full_redraw_of_the_best_path():
    config = SlamConfig("rbpf", particles=12, resample_threshold=0.95)
    grids = []
    mapper, _ = run(
        config,
        sigma=0.02,
        odometry_noise=0.5,
        visit=lambda mapper, _: grids.append(mapper.occupancy_grid()),
    )
    assert mapper.stats.resamplings > 3  # so that the drawn lineage did change
    redrawn = HitCountMap(BeamTable.of(GEOMETRY, config), config)
    redrawn.draw(mapper.trajectory().poses, mapper._tree["ranges"])
    expected = redrawn.occupancy_grid()
    assert grids[-1].frame == expected.frame
    np.testing.assert_array_equal(grids[-1].cells, expected.cells)


def test_the_map_shows_the_walls_and_leaves_the_rest_unknown():
    mapper, poses = run(SlamConfig(mode="ground_truth"))
    grid = mapper.occupancy_grid()
    assert set(np.unique(grid.cells)) == {OCCUPIED, UNKNOWN, FREE}
    rows, cols = np.nonzero(grid.cells == OCCUPIED)
    x, y = grid.frame.to_point(rows, cols)
    vertical = np.min([np.abs(x + 3), np.abs(x - 5), np.abs(x - 1)], axis=0)
    horizontal = np.min([np.abs(y + 2), np.abs(y - 2.5)], axis=0)
    # A cell that holds a point of a wall has its centre at most half a diagonal away.
    assert np.all(np.minimum(vertical, horizontal) <= 0.5 * math.sqrt(2) * 0.05 + 1e-9)
    row, col = grid.frame.to_cell(poses[-1].x, poses[-1].y)
    assert grid.cells[row, col] == FREE


def test_render_copies_the_lattice_and_is_unknown_outside():
    mapper, _ = run(SlamConfig(mode="ground_truth"))
    grid = mapper.occupancy_grid()
    frame = GridFrame(
        0.05,
        grid.frame.origin_x - 0.5,
        grid.frame.origin_y - 0.25,
        grid.frame.height_px + 15,
        grid.frame.width_px + 12,
    )
    picture = mapper.render(frame)
    np.testing.assert_array_equal(picture[10:-5, 10:-2], grid.cells)
    assert np.all(picture[:10] == UNKNOWN)
    assert np.all(picture[:, :10] == UNKNOWN)


def test_equal_seeds_give_equal_paths_and_others_do_not():
    paths = [
        run(SlamConfig("rbpf", particles=8), sigma=0.01, odometry_noise=0.3, seed=seed)[0]
        .trajectory()
        .poses
        for seed in (1, 1, 2)
    ]
    np.testing.assert_array_equal(paths[0], paths[1])
    assert not np.array_equal(paths[0], paths[2])


def test_scans_are_processed_by_distance_turn_and_time():
    def processed(poses, period, **settings):
        config = SlamConfig(
            **{"mode": "dead_reckoning", "temporal_update": None, "linear_update": 1.0, **settings}
        )
        mapper = make_mapper(config, GEOMETRY, poses[0], np.random.default_rng(0))
        scan = scan_at(Pose2D(0, 0, 0), 0.0)
        return [
            mapper.update(pose, LaserScan(period * k, scan.ranges, GEOMETRY))
            for k, pose in enumerate(poses)
        ]

    straight = [Pose2D(0.3 * k, 0.0, 0.0) for k in range(9)]
    assert processed(straight, 0.2) == [True, False, False, False, True, False, False, False, True]
    turning = [Pose2D(0.0, 0.0, 0.15 * k) for k in range(5)]
    assert processed(turning, 0.2, angular_update=0.2) == [True, False, True, False, True]
    still = [Pose2D(0.0, 0.0, 0.0)] * 7
    assert processed(still, 0.2, temporal_update=0.5) == [
        True,
        False,
        False,
        True,
        False,
        False,
        True,
    ]


@pytest.mark.parametrize("faulty", [np.nan, -np.inf])
def test_faulty_beams_change_nothing(faulty):
    clean = scan_at(Pose2D(0, 0, 0), 0.0)
    ranges = clean.ranges.copy()
    ranges[40:60] = faulty
    mapper = make_mapper(
        SlamConfig("rbpf", particles=1), GEOMETRY, Pose2D(0, 0, 0), np.random.default_rng(0)
    )
    mapper.update(Pose2D(0, 0, 0), LaserScan(0.0, ranges, GEOMETRY))
    other = make_mapper(
        SlamConfig("rbpf", particles=1), GEOMETRY, Pose2D(0, 0, 0), np.random.default_rng(0)
    )
    other.update(Pose2D(0, 0, 0), clean)
    frame = GridFrame(0.05, -5.0, -5.0, 200, 200)
    seen, all_seen = mapper.render(frame) != UNKNOWN, other.render(frame) != UNKNOWN
    assert np.all(all_seen[seen])
    assert seen.sum() < all_seen.sum()


def test_missing_returns_clear_open_space_but_nothing_behind_the_returns_beside_them():
    scan = scan_at(Pose2D(0, 0, 0), 0.0)
    frame = GridFrame(0.05, -8.0, -8.0, 320, 320)

    def seen(ranges, **settings):
        mapper = make_mapper(
            SlamConfig(mode="ground_truth", **settings),
            GEOMETRY,
            Pose2D(0, 0, 0),
            np.random.default_rng(0),
        )
        mapper.update(Pose2D(0, 0, 0), LaserScan(0.0, ranges, GEOMETRY))
        return mapper.render(frame) == FREE

    def without(first, end):
        ranges = scan.ranges.copy()
        ranges[first:end] = np.inf
        return ranges

    count = len(scan.ranges)
    # A pane in the wall: free up to the wall, and nothing behind it.
    gap = count // 2
    pane = seen(without(gap - 5, gap + 5))
    assert not np.any(pane & ~seen(scan.ranges))
    assert pane.sum() > seen(without(gap - 5, gap + 5), no_return="ignore").sum()
    # Nothing at all is in reach: open space.
    nothing = seen(without(0, count))
    angle = GEOMETRY.angle_increment * (count - 1)
    # At the rim rays lie further apart than cells.
    assert nothing.sum() * 0.05**2 == pytest.approx(0.5 * angle * 3.45**2, rel=0.15)
    assert not seen(without(0, count), no_return="ignore").any()


def test_an_unknown_mode_is_refused_with_a_suggestion():
    with pytest.raises(ConfigError, match="did you mean 'rbpf'"):
        make_mapper(SlamConfig(mode="rbfp"), GEOMETRY, Pose2D(0, 0, 0), np.random.default_rng(0))


def test_too_large_a_map_is_one_clear_error():
    mapper = make_mapper(
        SlamConfig(mode="ground_truth", memory_limit_mb=1.0),
        GEOMETRY,
        Pose2D(0, 0, 0),
        np.random.default_rng(0),
    )
    scan = scan_at(Pose2D(0, 0, 0), 0.0)
    mapper.update(Pose2D(0, 0, 0), scan)
    with pytest.raises(SlamgymError, match="memory_limit_mb"):
        mapper.update(Pose2D(500.0, 500.0, 0.0), LaserScan(1.0, scan.ranges, GEOMETRY))


def test_a_single_particle_draws_no_noise_and_the_covariance_is_the_spread_of_many():
    (path, _), (other, _) = (
        run(SlamConfig("rbpf", particles=1), odometry_noise=0.3, seed=0) for _ in range(2)
    )
    mapper, _ = run(SlamConfig("rbpf", particles=8), odometry_noise=0.3)
    assert not path.covariance.any()
    np.testing.assert_array_equal(path.trajectory().poses, other.trajectory().poses)
    np.testing.assert_allclose(mapper.covariance, mapper.covariance.T, atol=1e-12)
    assert np.linalg.eigvalsh(mapper.covariance).min() > 0.0
    deviation = math.sqrt(np.trace(mapper.covariance[:2, :2]))
    assert 0.001 < deviation < 0.1


def test_the_particle_that_explains_its_path_best_is_known_after_a_resampling_too():
    start = Pose2D(0.0, 0.0, 0.0)
    mapper = make_mapper(SlamConfig("rbpf", particles=4), GEOMETRY, start, np.random.default_rng(0))
    mapper.update(start, scan_at(start, 0.0))
    mapper._poses[:, 0] = [0.0, 0.1, 0.2, 0.3]
    mapper._path_log_weights[:] = [-9.0, -5.0, -7.0, -1.0]
    mapper._log_weights[:] = [-1e9, 0.0, 0.0, -1e9]  # the best of all dies, and the worst
    mapper._resample()
    assert mapper._poses[mapper.best_particle, 0] == pytest.approx(0.1)


def test_the_effective_number_of_particles_lies_between_one_and_all():
    mapper, _ = run(SlamConfig("rbpf", particles=8), sigma=0.01, odometry_noise=0.3)
    assert 1.0 <= mapper.stats.n_eff[-1] <= 8.0
