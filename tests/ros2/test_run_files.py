"""A mapper that is killed and started again with the same folder loses nothing, and goes on where it is told to."""

import math
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from ros_stand_ins import pose_on_map
from test_map_node import Drive, begin, feed, mapped_directly, pose_in

from slamgym.core.errors import ConfigError
from slamgym.interop import read_ros_map, read_tum, write_ros_map
from slamgym.interop.logs import open_log
from slamgym.ros2.mapping import SAVE_INTERVAL
from slamgym.ros2.parameters import MapParameters
from slamgym.ros2.run_files import LOG


@pytest.fixture(scope="module")
def drive():
    return Drive(60)


def part(drive, first, last):
    """Some steps of a drive."""
    some = Drive.__new__(Drive)
    for name in ("stamps", "odometry", "truth", "ranges"):
        setattr(some, name, getattr(drive, name)[first:last])
    return some


def kill(desk, node):
    """End a node as SIGKILL does: nothing is closed, and the lock is free."""
    with node.worker.lock:
        node.worker.is_over = True
    node._files.close()


def minute_passes(desk, node):
    desk.later += SAVE_INTERVAL + 1.0
    desk.tick(node)


def test_map_path_and_log_are_saved_every_minute(desk, drive):
    node = begin(desk)
    desk.tick(node)
    assert not Path("mapped/map.yaml").exists()
    feed(desk, node, part(drive, 0, 20))
    desk.tick(node)
    assert not Path("mapped/map.yaml").exists()
    minute_passes(desk, node)
    assert read_ros_map("mapped/map.yaml").cells.size
    assert len(read_tum("mapped/trajectory.tum")) > 1
    assert len(open_log(f"mapped/{LOG}").records) == 20
    kill(desk, node)


def test_what_a_killed_mapper_left_is_put_aside(desk, drive, capfd):
    for number in range(3):
        node = begin(desk)
        feed(desk, node, part(drive, 0, 10 + number))
        minute_passes(desk, node)
        kill(desk, node)
    last = begin(desk)
    assert f"what was in mapped is in {Path('mapped/run3')}" in capfd.readouterr().err
    for number in range(3):
        folder = Path(f"mapped/run{number + 1}")
        assert len(open_log(folder / LOG).records) == 10 + number
        assert read_ros_map(folder / "map.yaml").cells.size
    assert not Path("mapped/map.yaml").exists()
    kill(desk, last)


def test_a_log_that_ends_in_the_middle_is_gone_on_with(desk, drive, capfd):
    first = begin(desk)
    feed(desk, first, part(drive, 0, 30))
    minute_passes(desk, first)
    feed(desk, first, part(drive, 30, 33))  # after the last saving: lost
    kill(desk, first)
    second = begin(desk, continue_=True)
    feed(desk, second, part(drive, 33, None))
    assert f"goes on from the 30 scans of {Path('mapped/run1')}" in capfd.readouterr().err
    mapper, poses = mapped_directly(drive)
    assert math.dist(pose_in(desk.sent["/pose"][-1])[:2], poses[-1][:2]) < 0.05
    second.close()
    assert len(open_log(f"mapped/{LOG}").records) == len(drive.stamps) - 3
    known, whole = read_ros_map("mapped/map.yaml"), mapper.occupancy_grid()
    assert (known.cells != 205).sum() == pytest.approx((whole.cells != 205).sum(), rel=0.1)
    assert open_log(f"mapped/run1/{LOG}").records  # nothing was taken from there


@pytest.mark.parametrize("fault", ["odometry", "clock", "log"])
def test_where_it_cannot_go_on_it_says_so_and_begins_anew(desk, drive, capfd, fault):
    first = begin(desk)
    feed(desk, first, part(drive, 0, 20), since=100.0)
    minute_passes(desk, first)
    kill(desk, first)
    if fault == "log":
        Path(f"mapped/{LOG}").write_bytes(b"")
    second = begin(desk, continue_=True)
    rest = part(drive, 20, 30)
    if fault == "odometry":
        rest.odometry = [pose._replace(x=pose.x + 500.0) for pose in rest.odometry]
    feed(desk, second, rest, since=-5.0 if fault == "clock" else 100.0)
    assert "the map begins anew" in capfd.readouterr().err
    assert len(desk.sent["/pose"]) == 30
    second.close()
    assert len(open_log(f"mapped/{LOG}").records) == 10
    assert Path("mapped/run1/map.yaml").exists()


def test_by_the_laser_alone_it_goes_on_from_the_last_place(desk, drive):
    first = begin(desk, odometry="laser")
    feed(desk, first, part(drive, 0, 30))
    minute_passes(desk, first)
    last = pose_in(desk.sent["/pose"][-1])
    kill(desk, first)
    second = begin(desk, odometry="laser", continue_=True)
    feed(desk, second, part(drive, 30, 32))
    assert math.dist(pose_in(desk.sent["/pose"][-2])[:2], last[:2]) < 0.15
    kill(desk, second)


def test_a_finished_map_in_the_same_folder_stays_as_it_is(desk, drive):
    mapper, _ = mapped_directly(drive)
    Path("mapped").mkdir()
    known = str(write_ros_map(Path("mapped"), mapper.occupancy_grid()))
    before = [Path(f"mapped/map.{end}").read_bytes() for end in ("yaml", "pgm")]
    for number in range(2):
        node = begin(desk, map=known)
        desk.hand(node, "/initialpose", pose_on_map(9.0, drive.odometry[0]))
        feed(desk, node, part(drive, 0, 10))
        node.close()
        assert [Path(f"mapped/map.{end}").read_bytes() for end in ("yaml", "pgm")] == before
        assert len(open_log(f"mapped/{LOG}").records) == 10
        assert Path("mapped/run1").exists() == (number > 0)


def test_to_go_on_and_to_localise_exclude_each_other():
    with pytest.raises(ConfigError, match="--continue goes on with mapping"):
        MapParameters(map="house.yaml", continue_=True)


def test_it_is_a_ros_parameter_too(desk):
    node = begin(desk)
    assert node.get_parameter("continue").value is False
