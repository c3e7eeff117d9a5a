import numpy as np
import pytest

from slamgym.core.errors import ConfigError
from slamgym.core.geometry import between, compose
from slamgym.core.types import LaserGeometry, LaserScan, Pose2D, Trajectory
from slamgym.interop import Log, LogRecord
from slamgym.metrics import absolute_trajectory_error
from slamgym.sim.raycast import cast_rays
from slamgym.slam import SlamConfig, make_mapper
from slamgym.slam.config import PoseGraphConfig
from slamgym.slam.graph.recovery import POOR_FIT
from slamgym.slam.replay import replay


def box(x0, y0, x1, y1):
    return [(x0, y0, x1, y0), (x1, y0, x1, y1), (x1, y1, x0, y1), (x0, y1, x0, y0)]


# A corridor 2 m wide round a core, with niches and pillars by which its sides can be distinguished.
PILLARS = [
    (5, 0, 5.6, 0.4), (8.6, 1.5, 9.0, 2), (12, 1.6, 12.5, 2), (15.2, 0, 15.4, 0.6), (19.5, 6, 20, 7.5),
    (18, 4, 18.4, 4.5), (19.6, 9.7, 20, 10), (8, 13.4, 9.5, 14), (14, 12, 14.4, 12.3), (11.5, 13.6, 12, 14),
    (4.8, 12, 5.2, 12.5), (0, 4, 0.4, 4.5), (1.7, 8, 2, 9.0), (0, 6.1, 0.5, 6.3), (0, 10.4, 0.3, 11.1),
]  # fmt: skip
WALLS = [(0, 0, 20, 14), (2, 2, 18, 12)]
SEGMENTS = np.array(
    [side for corners in WALLS + PILLARS for side in box(*corners)], dtype=np.float64
)
GEOMETRY = LaserGeometry(181, -np.pi / 2, np.pi / 180, 0.1, 8.0, Pose2D(0.0, 0.0, 0.0))
CORNERS = [(1, 1), (19, 1), (19, 13), (1, 13)]


def true_path(rounds=2, step=0.2, turn=0.2):
    """Round the corridor, turning on the spot at the corners."""
    poses = [Pose2D(1.0, 1.0, 0.0)]
    for side in range(4 * rounds):
        x0, y0 = CORNERS[side % 4]
        x1, y1 = CORNERS[(side + 1) % 4]
        length, heading = np.hypot(x1 - x0, y1 - y0), side % 4 * np.pi / 2
        ux, uy = (x1 - x0) / length, (y1 - y0) / length
        poses += [
            Pose2D(x0 + s * ux, y0 + s * uy, heading) for s in np.arange(step, length + 1e-9, step)
        ]
        turns = np.linspace(0, np.pi / 2, int(np.pi / 2 / turn) + 1)[1:]
        poses += [Pose2D(x1, y1, heading + t) for t in turns]
    return poses


@pytest.fixture(scope="module")
def drive():
    return noisy_drive(0)


def noisy_drive(seed: int) -> tuple[Log, Trajectory]:
    """A log with biased, noisy odometry and noisy ranges, and the truth."""
    rng = np.random.default_rng(seed)
    truth, records = true_path(), []
    odometry = Pose2D(0.0, 0.0, 0.0)
    for k, pose in enumerate(truth):
        if k:
            d = between(truth[k - 1], pose)
            noisy = Pose2D(
                1.03 * d.x, d.y, d.theta * 1.02 + 0.008 * d.x + 0.005 * rng.standard_normal()
            )
            odometry = compose(odometry, noisy)
        ranges = np.empty(GEOMETRY.num_beams)
        cast_rays(*pose, GEOMETRY.angle_min, GEOMETRY.angle_increment, SEGMENTS, 8.0, ranges)
        ranges += 0.01 * rng.standard_normal(len(ranges))
        records.append(
            LogRecord(0.2 * k, odometry, LaserScan(0.2 * k, ranges.astype(np.float32), GEOMETRY))
        )
    stamps = 0.2 * np.arange(len(truth))
    return Log("drive", records, GEOMETRY), Trajectory(stamps, np.array(truth))


def run(log, on_scan=None, **settings):
    usual = {
        "max_usable_range": 8.0,
        "temporal_update": None,
        "linear_update": 0.2,
        "angular_update": 0.15,
    }
    config = SlamConfig(**{**usual, **settings})
    return replay(log, config, np.random.default_rng(0), on_scan)


@pytest.fixture(scope="module")
def closed(drive):
    """The drive, its loops closed."""
    return run(drive[0], mode="pose_graph")


def test_two_rounds_of_a_corridor_are_closed(drive, closed):
    log, truth = drive
    dead = absolute_trajectory_error(
        run(log, mode="dead_reckoning").trajectory, truth
    ).translation.rmse
    result = closed
    error = absolute_trajectory_error(result.trajectory, truth).translation.rmse
    # Once a search has closed the loop, the scans are aligned with the old submaps as they are with the new ones.
    assert result.extra["loop_closures"] > 0
    assert error < 0.02
    assert dead > 1.0


def test_a_corridor_stays_straight_where_the_laser_is_mounted_askew():
    """Half a degree: true odometry along an axis that isn't the laser's would bend the path; it was 0.04 m off."""
    rng = np.random.default_rng(0)
    geometry = GEOMETRY._replace(range_max=20.0)
    lefts = np.cumsum(rng.uniform(3.0, 8.0, 20))
    boxes = [(x, -1.0 + 1.7 * (k % 2), x + 0.4, -0.7 + 1.7 * (k % 2)) for k, x in enumerate(lefts)]
    walls = [side for corners in [(-2.0, -1.0, 82.0, 1.0), *boxes] for side in box(*corners)]
    segments = np.array(walls, dtype=np.float64)
    truth = np.column_stack([np.arange(80.0), np.zeros(80), np.zeros(80)])
    records = []
    for k, pose in enumerate(truth):
        ranges = np.empty(geometry.num_beams)
        first = geometry.angle_min + np.radians(0.5)
        cast_rays(*pose, first, geometry.angle_increment, segments, 20.0, ranges)
        ranges += 0.01 * rng.standard_normal(len(ranges))
        scan = LaserScan(0.5 * k, ranges.astype(np.float32), geometry)
        records.append(LogRecord(0.5 * k, Pose2D(*pose), scan))
    log = Log("askew", records, geometry)
    path = run(log, mode="pose_graph", max_usable_range=20.0).trajectory
    error = absolute_trajectory_error(path, Trajectory(path.stamps, truth))
    assert error.translation.rmse < 0.015


def test_without_loops_the_error_is_larger(drive):
    log, truth = drive
    # Seeing two metres, the robot often meets nothing but the bare walls beside it.
    loose = run(
        log, mode="pose_graph", max_usable_range=2.0, pose_graph=PoseGraphConfig(loop_length=1e9)
    )
    assert loose.extra["loop_closures"] == 0
    closed = run(log, mode="pose_graph", max_usable_range=2.0)
    errors = [
        absolute_trajectory_error(r.trajectory, truth).translation.rmse for r in (loose, closed)
    ]
    assert errors[1] < 0.5 * errors[0]


def test_equal_logs_give_equal_maps(drive):
    log, _ = drive
    short = Log("short", log.records[:100], GEOMETRY)
    a, b = run(short, mode="pose_graph"), run(short, mode="pose_graph")
    assert (a.trajectory.poses == b.trajectory.poses).all()
    assert (a.grid.cells == b.grid.cells).all()


def test_who_looks_at_the_map_meanwhile_changes_nothing(drive, closed):
    looked = run(drive[0], on_scan=lambda _, mapper, __: mapper.occupancy_grid(), mode="pose_graph")
    assert looked.extra["loop_closures"] > 0  # so that scans were moved after they had been drawn
    assert (looked.trajectory.poses == closed.trajectory.poses).all()
    assert (looked.grid.cells == closed.grid.cells).all()


def test_a_mapper_tells_its_path_its_uncertainty_and_its_memory(drive):
    log, truth = drive
    config = SlamConfig.for_log(8.05, GEOMETRY.num_beams)
    mapper = make_mapper(config, GEOMETRY, Pose2D(*truth.poses[0]), np.random.default_rng(0))
    sizes, spreads = [], []
    for record in log.records[:90]:
        if mapper.update(record.odometry, record.scan):
            sizes.append(mapper.stats.memory_bytes)
            spreads.append(np.trace(mapper.covariance[:2, :2]))
            assert np.linalg.eigvalsh(mapper.covariance).min() > -1e-12
            assert mapper.trajectory().poses[-1] == pytest.approx(mapper.pose)
    path = mapper.trajectory()
    assert len(path) == mapper.stats.processed == len(sizes)
    assert (np.diff(path.stamps) > 0.0).all()
    assert sizes[-1] > 1.5 * sizes[0]
    assert spreads[0] == 0.0
    assert spreads[-1] > spreads[len(spreads) // 3] > 0.0
    # It says of itself how far off it is, to within a few of its deviations.
    error = np.hypot(*(path.poses[-1] - truth.poses[89])[:2])
    assert error < 5.0 * np.sqrt(spreads[-1])
    mapper.finish()
    assert len(mapper.trajectory()) == len(path)
    assert mapper.pose == pytest.approx(mapper.trajectory().poses[-1])


def test_the_map_follows_the_corrected_path(closed):
    grid = closed.grid
    width, height = np.array(grid.cells.shape[::-1]) * grid.frame.resolution
    # The building is 20 x 14 m; what is cut off or doubled would change the extent of its walls.
    assert width == pytest.approx(20.0, abs=0.4)
    assert height == pytest.approx(14.0, abs=0.4)


def test_scans_that_see_nothing_leave_the_odometry_standing():
    empty = np.full(181, np.inf, np.float32)
    records = [
        LogRecord(0.2 * k, Pose2D(0.3 * k, 0.0, 0.0), LaserScan(0.2 * k, empty, GEOMETRY))
        for k in range(10)
    ]
    result = run(Log("empty", records, GEOMETRY), mode="pose_graph")
    assert result.trajectory.poses[-1] == pytest.approx((2.7, 0.0, 0.0), abs=1e-6)


def test_settings_that_make_no_sense_are_refused():
    with pytest.raises(ConfigError, match="loop_length"):
        PoseGraphConfig(loop_length=-1.0)


def lying(log: Log, kind: str) -> Log:
    """The log with odometry that lies for a while, in the middle of the first round."""
    records, odometry, last = [], log.records[0].odometry, log.records[0].odometry
    for k, record in enumerate(log.records):
        moved = between(last, record.odometry)
        last = record.odometry
        if 60 <= k < 80 and kind == "scale":
            moved = Pose2D(1.5 * moved.x, 1.5 * moved.y, 1.5 * moved.theta)
        if k == 70 and kind == "slip":
            moved = Pose2D(moved.x, moved.y, moved.theta + np.radians(30.0))
        if k == 70 and kind == "reset":
            moved = compose(moved, Pose2D(4.0, -4.0, 0.0))
        odometry = compose(odometry, moved)
        if kind == "lost" and 70 <= k < 75:
            continue
        records.append(LogRecord(record.stamp, odometry, record.scan))
    return Log(f"drive, {kind}", records, log.geometry)


@pytest.mark.parametrize("kind", ["scale", "slip", "lost", "reset"])
def test_odometry_that_lies_for_a_while_is_survived(kind: str):
    """In the middle one of three drives: one in twenty slides along its corridor, and says that it is broken."""
    errors = []
    for seed in range(3):
        log, truth = noisy_drive(seed)
        result = run(lying(log, kind), mode="pose_graph")
        error = absolute_trajectory_error(result.trajectory, truth).translation.rmse
        errors.append(error)
        assert error < 0.03 or result.stats.broken
    assert np.median(errors) < 0.015
    assert result.stats.spans() == []


def test_a_scan_that_fits_poorly_says_nothing_of_the_wheels(drive):
    """It lies where the wheels say: that the wheels are right doesn't follow from it."""
    log, _ = drive
    start = Pose2D(*log.records[0].odometry)
    config = SlamConfig(mode="pose_graph", temporal_update=0.1)
    mapper = make_mapper(config, log.geometry, start, np.random.default_rng(0))
    for record in log.records[:30]:
        mapper.update(record.odometry, record.scan)
    assert mapper._graph._nodes["bound"][-1].all()
    record = log.records[30]
    ranges = np.random.default_rng(0).uniform(0.5, 8.0, log.geometry.num_beams).astype(np.float32)
    ranges[::4] = record.scan.ranges[::4]
    mapper.update(record.odometry, LaserScan(record.stamp, ranges, log.geometry))
    assert mapper._scans["fits"][-1] < POOR_FIT
    assert not mapper._graph._nodes["bound"][-1].any()
