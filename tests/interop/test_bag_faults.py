"""Bags of real robots: other frames, several lasers, no odometry, rotations and limits that were never set."""

import dataclasses
import math

import numpy as np
import pytest

from slamgym.core.errors import InputFileError
from slamgym.core.types import LaserGeometry, Pose2D
from slamgym.interop import BagChoices, open_log
from slamgym.interop.ranges import range_limit
from slamgym.interop.rosbag import import_rosbags
from slamgym.interop.rosbag_writer import TOPICS, _Bag

pytest.importorskip("rosbags")

GEOMETRY = LaserGeometry(40, -math.pi, math.pi / 20, 0.1, 8.0)
STAMPS = [1.6e9 + 0.2 * k for k in range(30)]
POSES = [Pose2D(0.05 * k, 0.01 * k, 0.02 * k) for k in range(30)]
TRANSFORMS = ((("odom", "base"), POSES),)


def ranges_at(k):
    return np.random.default_rng(k).uniform(0.5, 7.5, GEOMETRY.num_beams).astype(np.float32)


@dataclasses.dataclass
class Robot:
    """What a robot publishes."""

    scans: tuple = ("/scan",)
    laser_frame: str = "laser"
    base_frame: str = "base"
    odometry: tuple = ()  # topics
    turned: bool = True  # False leaves the rotations of the odometry unset
    late: float = 0.0
    transforms: tuple = ()  # (parent, child), poses
    range_max: float = 8.0
    no_return: float = math.inf

    def write(self, path):
        rosbags = import_rosbags()
        with rosbags.rosbag2.Writer(path, version=8) as writer:
            bag = _Bag(
                writer, rosbags.typesys.get_typestore(rosbags.typesys.Stores.ROS2_HUMBLE), 0.0
            )
            bag.write_transform(
                "/tf_static", STAMPS[0], (self.base_frame, self.laser_frame), Pose2D(0.1, 0, 0)
            )
            for k, stamp in enumerate(STAMPS):
                for topic in self.odometry:
                    x, y, theta = POSES[k]
                    turn = (
                        {"z": math.sin(theta / 2), "w": math.cos(theta / 2)} if self.turned else {}
                    )
                    pose = {
                        "pose": {"position": {"x": x, "y": y}, "orientation": turn},
                        "covariance": np.zeros(36),
                    }
                    odometry = {
                        "header": bag.header(stamp + self.late, "odom"),
                        "child_frame_id": self.base_frame,
                        "pose": pose,
                        "twist": {"covariance": np.zeros(36)},
                    }
                    bag.write(topic, stamp, odometry)
                for frames, poses in self.transforms:
                    bag.write_transform("/tf", stamp, frames, poses[k])
                for topic in self.scans:
                    ranges = ranges_at(k)
                    ranges[::4] = self.no_return
                    scan = {
                        "header": bag.header(stamp, self.laser_frame),
                        "ranges": ranges,
                        "angle_min": GEOMETRY.angle_min,
                        "angle_increment": GEOMETRY.angle_increment,
                        "range_min": GEOMETRY.range_min,
                        "range_max": self.range_max,
                        "intensities": np.zeros(0, np.float32),
                    }
                    bag.write(topic, stamp, scan)
        return path


@pytest.fixture
def read(tmp_path, monkeypatch):
    """Reads what a robot has written."""
    for topic in ("/front", "/rear", "/robot2/scan"):
        monkeypatch.setitem(TOPICS, topic, TOPICS["/scan"])
    for topic in ("/robot1/odom", "/robot2/odom"):
        monkeypatch.setitem(TOPICS, topic, TOPICS["/odom"])
    return lambda robot, **choices: open_log(robot.write(tmp_path / "bag"), BagChoices(**choices))


def kinds(log):
    return [finding.kind for finding in log.findings]


def test_a_good_bag_has_no_finding(read):
    log = read(Robot(odometry=("/odom",)))
    assert kinds(log) == []
    assert log.has_odometry
    assert log.sources["odometry from"] == "/odom, 5.0 Hz"
    assert [r.odometry for r in log] == [pytest.approx(pose) for pose in POSES]


@pytest.mark.parametrize("frame", ["odom_combined", "robot1/odom", "odometry"])
def test_the_only_frame_that_the_laser_moves_in_is_found(read, frame):
    turning = (
        (("base", "gripper"), POSES[::-1]),
        ((frame, "base"), POSES),
        (("map", frame), POSES),
    )
    log = read(Robot(transforms=turning))
    assert kinds(log) == []
    assert log.records[20].odometry == pytest.approx(POSES[20])
    assert log.sources["odometry from"].startswith(f"tf, base in {frame}")


def test_of_several_frames_an_option_chooses(read, tmp_path):
    robot = Robot(transforms=((("wheels", "base"), POSES), (("visual", "wheels"), POSES[::-1])))
    with pytest.raises(InputFileError, match="visual, wheels; choose by --odometry-frame"):
        read(robot)
    log = open_log(tmp_path / "bag", BagChoices(odometry_frame="wheels"))
    assert log.records[20].odometry == pytest.approx(POSES[20])
    with pytest.raises(InputFileError, match="--odometry-frame may be: visual, wheels"):
        open_log(tmp_path / "bag", BagChoices(odometry_frame="odom"))


def test_of_two_lasers_the_used_one_is_said(read, tmp_path):
    log = read(Robot(scans=("/front", "/rear"), odometry=("/odom",)))
    assert kinds(log) == ["lasers"]
    assert "/rear is used, not /front (--scan-topic chooses)" in log.findings[0].sentence
    assert kinds(open_log(tmp_path / "bag", BagChoices(scan_topic="/front"))) == []


def test_the_odometry_of_the_same_robot_is_taken(read):
    log = read(Robot(scans=("/robot2/scan",), odometry=("/robot1/odom", "/robot2/odom")))
    assert log.sources["odometry from"].startswith("/robot2/odom")


def test_without_odometry_the_scans_are_read(read, tmp_path):
    log = read(Robot())
    assert kinds(log) == ["odometry"]
    assert "the laser alone is used" in log.findings[0].sentence
    assert len(log) == 30
    assert not log.has_odometry
    assert {record.odometry for record in log} == {Pose2D(0.0, 0.0, 0.0)}
    assert log.geometry.mount == pytest.approx((0.1, 0.0, 0.0))


def test_odometry_can_be_left_out(read):
    log = read(Robot(odometry=("/odom",), transforms=TRANSFORMS), odometry_topic="none")
    assert kinds(log) == []
    assert not log.has_odometry


def test_rotations_that_were_never_set_are_named(read):
    log = read(Robot(odometry=("/odom",), turned=False))
    assert "30 x pose on /odom with a quaternion of zeros" in log.findings[0].sentence
    assert not log.has_odometry


def test_tf_helps_where_the_odometry_has_no_rotations(read):
    log = read(Robot(odometry=("/odom",), turned=False, transforms=TRANSFORMS))
    assert kinds(log) == []
    assert log.records[20].odometry == pytest.approx(POSES[20])
    assert (
        log.warnings.counts["pose on /odom with a quaternion of zeros, which is no rotation"] == 30
    )


def test_clocks_that_differ_are_said(read, tmp_path):
    log = read(Robot(odometry=("/odom",), late=3600.0))
    assert "the clocks of odometry and scans differ by 3600.0 s" in log.findings[0].sentence
    assert not log.has_odometry
    right = open_log(tmp_path / "bag", BagChoices(time_offset=3600.0))
    assert kinds(right) == []
    assert right.records[20].odometry == pytest.approx(POSES[20])


@pytest.mark.parametrize("limit", [0.0, math.inf, math.nan, 3.4e38, -1.0, 0.3])
def test_impossible_limits_are_inferred(read, tmp_path, limit):
    log = read(Robot(odometry=("/odom",), range_max=limit))
    assert kinds(log) == ["range_max"]
    assert "--range-max" in log.findings[0].sentence
    longest = max(ranges_at(k)[1:].max() for k in range(30))
    assert log.geometry.range_max == pytest.approx(longest, abs=0.05)
    assert np.isfinite(log.records[0].scan.ranges[1:4]).all()
    chosen = open_log(tmp_path / "bag", BagChoices(range_max=4.0))
    assert kinds(chosen) == []
    assert np.isinf(chosen.records[0].scan.ranges[ranges_at(0) > 4.0]).all()


@pytest.mark.parametrize("limit", [8.0, 12.0, 0.0])
def test_a_number_that_stands_for_no_return_is_found(read, limit):
    log = read(Robot(odometry=("/odom",), range_max=limit, no_return=7.999))
    assert kinds(log) == ["range_max" if limit == 0.0 else "no return"]
    assert log.geometry.range_max == pytest.approx(7.999, abs=1e-6)
    assert np.isinf(log.records[3].scan.ranges[::4]).all()
    assert np.isfinite(log.records[3].scan.ranges[1::4]).all()


def test_damaged_numbers_that_signal_themselves_are_passed_over_in_silence():
    damaged = np.array([0x7F80_0001], np.uint32).view(np.float32)
    scan = np.append(np.linspace(1.0, 3.0, 20, dtype=np.float32), damaged)
    assert range_limit([scan], 3.5, None) == (3.5, ())
