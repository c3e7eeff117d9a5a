"""Faults put into the odometry of a simulated drive, and what the check makes of them."""

import dataclasses
import functools

import numpy as np
import pytest
from room_drive import GEOMETRY, TIMES, good_drive, scan_at, times, true_poses, with_steps

from slamgym.core.geometry import between, wrap_angle
from slamgym.core.types import Pose2D, Trajectory
from slamgym.interop import Log, LogRecord
from slamgym.interop.odometry import retimed, without_jumps
from slamgym.interop.records import interpolated
from slamgym.metrics.trajectory import relative_poses
from slamgym.slam.laser_odometry import PairMotions, with_laser_odometry
from slamgym.slam.odometry_check import (
    MATCH_ERRORS,
    WHEEL_ERROR,
    WHEEL_ERROR_SHARE,
    _deviations,
    check_odometry,
    measure_pairs,
    odometry_shares,
)

check = functools.partial(check_odometry, estimate_scan_time=False)
"""Of the odometry alone: the time of scans takes longer than all else."""


@pytest.fixture(scope="module")
def drive():
    return good_drive()


def test_a_good_log_has_no_finding(drive):
    checked = check_odometry(drive)
    assert list(checked.findings) == []
    assert checked.has_odometry
    assert [record.odometry for record in checked] == [record.odometry for record in drive]
    turns, ways, direction = odometry_shares(measure_pairs(drive))
    assert (turns, ways, direction) == pytest.approx((0.98, 1.02, 0.0), abs=0.04)


def test_pairs_in_a_bare_corridor_say_nothing_of_the_wheels_distances():
    """There each scan fits the one before where it was, and little information along says so."""
    count = 60
    in_corridor = np.arange(count) % 3 > 0
    motion = np.tile((1.0, 0.05, 0.1), (count, 1))
    laser = motion.copy()
    laser[in_corridor, 0] = 0.2
    information = np.tile(np.diag([5e4, 5e4, 5e4]), (count, 1, 1))
    information[in_corridor, 0, 0] = 300.0
    scans = np.column_stack([np.arange(count), np.arange(count) + 1])
    pairs = PairMotions(scans, 1.0 * scans, laser, information, np.ones(count), motion)
    assert odometry_shares(pairs) == pytest.approx((1.0, 1.0, 0.0), abs=1e-9)


@pytest.mark.parametrize("late", [0.1, 0.3, 0.5, -0.2])
def test_late_stamps_are_set_right(drive, late):
    wrong = retimed(drive, -late)
    checked = check(wrong)
    assert [finding.kind for finding in checked.findings] == ["clock"]
    assert f"0.{abs(late):.1f}"[2:4] in checked.findings[0].sentence
    assert ("early" in checked.findings[0].sentence) == (late < 0)
    inner = slice(10, -10)
    poses, found, before = (
        np.array([record.odometry[:2] for record in log])[inner] for log in (drive, checked, wrong)
    )
    assert np.abs(found - poses).max() < 0.3 * np.abs(before - poses).max()
    assert not check(wrong, estimate_offset=False).findings or late != 0.1


def test_a_clock_is_judged_alike_wherever_the_heading_wraps():
    """A robot that swings to and fro: of its headings hardly any lie on one side of pi."""
    rng = np.random.default_rng(0)
    stamps = TIMES[:250]
    headings = np.pi + 0.9 * np.sin(0.8 * stamps + 0.5 * np.sin(0.3 * stamps))
    poses = np.column_stack([np.full((250, 2), (1.0, 3.4)), headings])
    late = np.interp(stamps - 0.3, stamps, headings)
    for frame in (0.0, np.pi):
        records = [
            LogRecord(
                stamp, Pose2D(0.0, 0.0, float(wrap_angle(told - frame))), scan_at(pose, stamp, rng)
            )
            for stamp, told, pose in zip(stamps.tolist(), late, poses, strict=True)
        ]
        (finding,) = check(Log("swings", records, GEOMETRY)).findings
        assert finding.kind == "clock"
        assert "0.3" in finding.sentence or "0.2" in finding.sentence
        assert "late" in finding.sentence


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (times(0, 0, 0), "measures no turns and no distances"),
        (times(1, 1, 0), "measures no turns:"),
        (times(0, 0, 1), "measures no distances:"),
        (times(1, 1, -1), "turns left where the laser turns right"),
        (times(1, -1, -1), "turns left where the laser turns right"),
        (times(-1, -1, 1), "180 degrees beside the laser"),
    ],
)
def test_odometry_that_lies_throughout_is_left_out(drive, change, words):
    checked = check(with_steps(drive, change))
    assert [finding.kind for finding in checked.findings] == ["odometry"]
    assert words in checked.findings[0].sentence
    assert "--odometry-topic" in checked.findings[0].sentence
    assert not checked.has_odometry
    assert {record.odometry for record in checked} == {Pose2D(0.0, 0.0, 0.0)}
    assert check(checked) is checked


@pytest.mark.parametrize(
    ("change", "what"), [(times(1.5, 1.5, 1), "distances"), (times(1, 1, 1.5), "turns")]
)
def test_a_wrong_scale_is_divided_out(drive, change, what):
    checked = check(with_steps(drive, change))
    assert [finding.kind for finding in checked.findings] == ["scale"]
    assert f"of the laser's {what}" in checked.findings[0].sentence
    assert odometry_shares(measure_pairs(checked))[:2] == pytest.approx((1.0, 1.0), abs=0.06)
    assert checked.has_odometry


@pytest.mark.parametrize("change", [times(0, 0, 0, 40.0, 60.0), times(-1, -1, 1, 40.0, 60.0)])
def test_a_stretch_that_lies_is_named(drive, change):
    checked = check(with_steps(drive, change))
    assert [finding.kind for finding in checked.findings] == ["contradicted"]
    assert checked.has_odometry
    inside = sum(end - begin for begin, end in checked.distrusted)
    assert 16.0 < inside <= 21.0
    assert checked.distrusted[0][0] >= 39.0
    assert checked.distrusted[-1][1] <= 61.0


@pytest.mark.parametrize("seed", range(3))
def test_a_deviation_is_counted_in_those_of_wheels_and_matches_together(seed):
    rng = np.random.default_rng(seed)
    odometry, error = rng.normal(0.0, 0.3, (2, 3))
    shape = rng.normal(0.0, 0.004, (3, 3))
    of_match = shape @ shape.T + 1e-6 * np.eye(3)
    pair = PairMotions(
        scans=np.array([[0, 1]]),
        stamps=np.array([[0.0, 0.3]]),
        laser=(odometry + error)[None],
        information=np.linalg.inv(of_match)[None],
        fits=np.ones(1),
        odometry=odometry[None],
    )
    wheels = np.array([[np.hypot(*odometry[:2]), abs(odometry[2])]])
    spread = WHEEL_ERROR + WHEEL_ERROR_SHARE * wheels[0, [0, 0, 1]]
    both = np.diag(spread**2) + MATCH_ERRORS**2 * of_match  # a standard deviation's factor
    expected = np.sqrt(error @ np.linalg.inv(both) @ error)
    assert _deviations(pair, wheels) == pytest.approx([expected], rel=1e-6)


def test_a_robot_at_rest_is_no_fault():
    rng = np.random.default_rng(1)
    pose = Pose2D(1.0, 1.0, 0.0)
    records = [LogRecord(stamp, pose, scan_at(pose, stamp, rng)) for stamp in TIMES[:60].tolist()]
    checked = check(Log("rest", records, GEOMETRY))
    assert list(checked.findings) == []
    assert checked.has_odometry


def test_a_reset_costs_one_step():
    odometry = Trajectory(TIMES, true_poses(TIMES))
    reset = odometry.poses.copy()
    reset[250:] = relative_poses(
        np.repeat(odometry.poses[250:251], 250, axis=0), odometry.poses[250:]
    )
    poses, findings = without_jumps(Trajectory(TIMES, reset))
    assert [finding.kind for finding in findings] == ["jump"]
    steps, true_steps = (relative_poses(p[:-1], p[1:]) for p in (poses, odometry.poses))
    kept = np.arange(len(steps)) != 249
    assert steps[kept] == pytest.approx(true_steps[kept], abs=1e-9)
    assert steps[249] == pytest.approx(np.zeros(3), abs=1e-9)
    assert without_jumps(odometry)[1] == ()


def test_retiming_moves_the_odometry_under_the_scans(drive):
    track = drive.track
    shifted = retimed(drive, 0.1)
    expected = interpolated(Trajectory(track.stamps, track.poses), TIMES + 0.1)
    assert np.array([record.odometry for record in shifted]) == pytest.approx(expected, abs=1e-9)
    assert shifted.track.poses[shifted.track.scans] == pytest.approx(expected, abs=1e-9)
    assert (np.diff(shifted.track.stamps) >= 0.0).all()


def test_the_laser_alone_follows_the_robot(drive):
    short = dataclasses.replace(drive, records=drive.records[:100], has_odometry=False)
    found = with_laser_odometry(short)
    poses = np.array([record.odometry for record in found])
    steps, true_steps = (relative_poses(p[:-1], p[1:]) for p in (poses, true_poses(TIMES[:100])))
    assert np.abs(steps - true_steps).max() < 0.02
    moved, way = between(*(Pose2D(*poses[k]) for k in (0, -1))), true_poses(TIMES[[0, 99]])
    assert moved == pytest.approx(between(Pose2D(*way[0]), Pose2D(*way[1])), abs=0.1)


def test_the_laser_takes_over_where_the_odometry_is_not_trusted(drive):
    checked = check(with_steps(drive, times(0, 0, 0, 40.0, 60.0)))
    poses = np.array([record.odometry for record in with_laser_odometry(checked)])
    steps, true_steps = (relative_poses(p[:-1], p[1:]) for p in (poses, true_poses(TIMES)))
    assert np.abs(steps - true_steps)[:, :2].max() < 0.05
