"""Scans of any driver as scans of one geometry."""

import math

import numpy as np
import pytest
from ros_stand_ins import LASER, Transforms, odometry, scan, transform

from slamgym.core.types import Pose2D
from slamgym.interop.records import BrokenMessageError
from slamgym.ros2.frames import RobotFrames
from slamgym.ros2.laser import LaserReader
from slamgym.ros2.parameters import FrameNames

RANGES = np.linspace(0.5, 3.0, LASER.num_beams, dtype=np.float32)


NAMES = FrameNames()


class Reading:
    """A reader and its warnings."""

    def __init__(self, *transforms, names=NAMES):
        self.frames, self.warnings = RobotFrames(names, lambda *_: None), {}
        self.frames.take_transforms(Transforms(transforms), static=True)
        self.reader = LaserReader(self.frames, names, self.warnings.setdefault)

    def __call__(self, message):
        return self.reader.read(message, 1.0, None)


def test_a_usual_scan_is_read_as_it_is():
    read = Reading(transform(0.0, "base_footprint", "base_scan", Pose2D(0.1, 0.2, 0.3)))
    found = read(scan(1.0, RANGES))
    np.testing.assert_array_equal(found.ranges, RANGES)
    assert found.geometry.num_beams == LASER.num_beams
    assert found.geometry.angle_min == pytest.approx(LASER.angle_min)
    assert found.geometry.mount == pytest.approx((0.1, 0.2, 0.3))
    assert not read.warnings


def test_without_a_transform_the_parameter_says_where_the_laser_is():
    read = Reading()
    assert read(scan(1.0, RANGES)).geometry.mount == LASER.mount
    assert "base_scan" in read.warnings["mount"]
    assert "base_frame" in read.warnings["mount"]


def test_a_laser_upside_down_sees_the_room_as_one_that_is_upright():
    upright, flipped = (
        Reading(
            transform(0.0, "base_footprint", "base_scan", Pose2D(0.1, 0.0, 0.4), flipped=turned)
        )
        for turned in (False, True)
    )
    one, other = upright(scan(1.0, RANGES)), flipped(scan(1.0, RANGES[::-1]))
    np.testing.assert_array_equal(one.ranges, other.ranges)
    np.testing.assert_allclose(one.geometry.angles, other.geometry.angles, atol=1e-6)
    assert one.geometry.mount == pytest.approx(other.geometry.mount)


def test_beams_in_clockwise_order_are_turned_round():
    clockwise = scan(
        1.0, RANGES[::-1], angle_min=-LASER.angle_min, angle_increment=-LASER.angle_increment
    )
    one, other = Reading()(scan(1.0, RANGES)), Reading()(clockwise)
    np.testing.assert_array_equal(one.ranges, other.ranges)


def test_what_means_nothing_and_what_means_no_return():
    ranges = RANGES.copy()
    ranges[:6] = math.nan, 0.0, -1.0, 0.01, math.inf, LASER.range_max
    found = Reading()(scan(1.0, ranges)).ranges
    assert np.isnan(found[:4]).all()
    assert np.isposinf(found[4:6]).all()
    np.testing.assert_array_equal(found[6:], RANGES[6:])


def test_a_scan_of_nothing_but_nan_is_a_scan():
    read = Reading()
    assert np.isnan(read(scan(1.0, np.full(90, math.nan))).ranges).all()
    np.testing.assert_array_equal(read(scan(1.2, RANGES)).ranges, RANGES)


@pytest.mark.parametrize("beams", [85, 95])
def test_a_beam_more_or_less_is_usual(beams):
    read = Reading()
    read(scan(1.0, RANGES))
    found = read(scan(1.2, np.full(beams, 2.0)))
    assert len(found.ranges) == LASER.num_beams
    assert np.nansum(found.ranges == 2.0) == min(beams, LASER.num_beams)
    assert set(read.warnings) == {"mount"}


@pytest.mark.parametrize("beams", [45, 180])
def test_another_number_of_beams_is_said(beams):
    read = Reading()
    read(scan(1.0, RANGES))
    found = read(scan(1.2, np.full(beams, 2.0), angle_increment=math.pi / (beams - 1)))
    assert len(found.ranges) == LASER.num_beams
    assert f"{beams} beams" in read.warnings["beams"]
    assert "reset" in read.warnings["beams"]


@pytest.mark.parametrize("declared", [0.0, -1.0, math.nan, math.inf, 1e9])
def test_an_impossible_largest_range_is_replaced_by_what_is_measured(declared):
    read = Reading()
    found = read(scan(1.0, RANGES, range_max=declared))
    assert 3.0 < found.geometry.range_max < 100.0
    np.testing.assert_array_equal(found.ranges, RANGES)
    assert "range_max" in read.warnings


@pytest.mark.parametrize(
    "fault",
    [
        {"ranges": []},
        {"angle_increment": 0.0},
        {"angle_increment": math.nan},
        {"angle_min": math.inf},
        {"range_min": math.nan},
    ],
    ids=str,
)
def test_no_laser_sends_this(fault):
    read = Reading()
    with pytest.raises(BrokenMessageError, match="scan left out because of"):
        read(scan(1.0, **{"ranges": RANGES, **fault}))
    assert len(read(scan(1.2, RANGES)).ranges) == LASER.num_beams  # and the next one is taken


SWEEPING = LASER.taking(0.1)


def test_a_scan_that_takes_its_time_brings_the_motion_until_its_last_beam():
    read = Reading()
    for stamp in (0.9, 1.0, 1.1, 1.2):
        turned = 0.5 * (stamp - 1.0)
        read.frames.take_odometry(odometry(stamp, Pose2D(0.2 * (stamp - 1.0), 0.0, turned)))
    message = scan(1.0, RANGES, SWEEPING)
    found = read.reader.read(message, 1.0, Pose2D(0.0, 0.0, 0.0))
    assert found.geometry.scan_time == pytest.approx(0.1)
    assert found.motion == pytest.approx((0.02, 0.0, 0.05))
    # What isn't known yet is taken to go on so.
    later = read.reader.read(scan(1.15, RANGES, SWEEPING), 1.15, Pose2D(0.03, 0.0, 0.075))
    assert later.motion.theta == pytest.approx(0.05)
    assert not set(read.warnings) - {"mount"}


def test_the_beams_of_a_laser_upside_down_come_in_the_other_order():
    turned = transform(0.0, "base_footprint", "base_scan", Pose2D(0.1, 0.0, 0.4), flipped=True)
    assert Reading(turned)(scan(1.0, RANGES, SWEEPING)).geometry.time_increment < 0.0


@pytest.mark.parametrize(
    ("increment", "said"), [(-0.001, "backwards"), (math.nan, "numbers"), (153333.0, "longer")]
)
def test_times_of_beams_that_cannot_be_are_said_and_left_out(increment, said):
    read = Reading()
    found = read(scan(1.0, RANGES, time_increment=increment))
    assert found.geometry.scan_time == 0.0
    assert said in read.warnings["beam times"]


@pytest.mark.parametrize("seconds", [0.0, 0.15])
def test_the_parameter_says_how_long_a_scan_takes(seconds):
    read = Reading(names=FrameNames(scan_time=seconds))
    assert read(scan(1.0, RANGES, SWEEPING)).geometry.scan_time == pytest.approx(seconds)
