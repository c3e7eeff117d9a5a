"""The map node maps as the mapper that it runs, bit for bit, and nothing that is done to it loses a map."""

import errno
import gzip
import math
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")

from ros_stand_ins import Transforms, odometry, pose_on_map, scan, transform

from slamgym.core.errors import ConfigError, InputFileError, SlamgymError
from slamgym.core.files import StorageError
from slamgym.core.geometry import compose
from slamgym.core.types import FREE, OCCUPIED, LaserScan, Pose2D
from slamgym.envs import ExploreEnv
from slamgym.interop import read_ros_map, read_tum
from slamgym.interop.logs import open_log
from slamgym.interop.ros_messages import pose_of
from slamgym.ros2 import mapping
from slamgym.ros2.mapping import TRANSFORM_AHEAD, MapNode
from slamgym.ros2.parameters import MapParameters
from slamgym.ros2.run_files import LOG
from slamgym.sim import Lidar, LidarConfig
from slamgym.slam import SlamConfig, make_mapper

INSTANTANEOUS = LidarConfig(sweep=0.0)
LASER = Lidar(INSTANTANEOUS).geometry
BEGIN = 10.0


class Drive:
    """What a robot in a home sensed, as messages, and where it was."""

    def __init__(self, steps):
        env = ExploreEnv(
            "bundled",
            localization="dead_reckoning",
            actions="physical",
            record=True,
            lidar=INSTANTANEOUS,
        )
        env.reset(seed=4, options={"plan": "home_000007"})
        for step in range(steps):
            env.step(np.array([0.2, 0.6 * math.sin(0.1 * step)]))
        log, start = env.log, env.log.true_poses[0]
        self.stamps = [BEGIN + 0.2 * step for step in range(steps + 1)]
        self.odometry = [Pose2D(*pose) for pose in log.odometry.tolist()]
        self.truth = [
            Pose2D(x - start[0], y - start[1], turn) for x, y, turn in log.true_poses.tolist()
        ]
        self.ranges = [
            np.where(row < LASER.range_min, np.nan, row).astype(np.float32) for row in log.ranges
        ]

    def messages(self, since=0.0):
        """Each step's odometry and scan."""
        for stamp, pose, ranges in zip(self.stamps, self.odometry, self.ranges, strict=True):
            yield odometry(stamp + since, pose), scan(stamp + since, ranges, LASER)


@pytest.fixture(scope="module")
def drive():
    return Drive(60)


def begin(desk, **parameters):
    parameters["out"] = Path(parameters.get("out", "mapped"))
    return desk.make(MapNode, MapParameters(**parameters), lambda config: config)


def feed(desk, node, drive, since=0.0, steps=None):
    for odom, seen in list(drive.messages(since))[:steps]:
        desk.hand(node, "/odom", odom)
        desk.hand(node, "/scan", seen)


def mapped_directly(drive):
    """The mapper of the node, fed as a library user does; and its poses."""
    mapper, poses = None, []
    for (odom, _), stamp, ranges in zip(drive.messages(), drive.stamps, drive.ranges, strict=True):
        pose = pose_of(odom.pose.pose, "odometry")
        if mapper is None:
            config = SlamConfig.for_log(LASER.range_max, LASER.num_beams)
            mapper = make_mapper(config, LASER, pose, np.random.default_rng(0))
        mapper.update(pose, LaserScan(stamp, ranges, LASER))
        poses.append(mapper.pose)
        if len(poses) == 1:
            mapper.occupancy_grid()  # as the node does: what is drawn at once isn't drawn again
    return mapper, poses


def pose_in(message):
    return pose_of(message.pose.pose, "pose")


def lines(capfd):
    return capfd.readouterr().err.splitlines()


# --- mapping ---


def test_it_maps_as_the_mapper_alone(desk, drive):
    mapper, poses = mapped_directly(drive)
    node = begin(desk, map_interval=1e9)
    feed(desk, node, drive)
    assert desk.call(node, "save").success
    grid, same = read_ros_map("mapped/map.yaml"), mapper.occupancy_grid()
    np.testing.assert_array_equal(grid.cells, same.cells)
    assert grid.frame == pytest.approx(same.frame)
    path, expected = read_tum("mapped/trajectory.tum"), mapper.trajectory()
    np.testing.assert_allclose(path.poses, expected.poses, atol=1e-6)
    sent = desk.sent["/pose"]
    assert len(sent) == len(poses)
    for message, pose, stamp in zip(sent, poses, drive.stamps, strict=True):
        assert math.dist(pose_in(message)[:2], pose[:2]) == 0.0
        assert pose_in(message).theta == pytest.approx(pose.theta, abs=1e-12)
        assert message.header.frame_id == "map"
        assert message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec == pytest.approx(
            stamp
        )
    covariance = np.reshape(sent[-1].pose.covariance, (6, 6))
    np.testing.assert_array_equal(covariance[np.ix_((0, 1, 5), (0, 1, 5))], mapper.covariance)


def test_maps_come_at_their_interval_and_are_the_mapper_s(desk, drive):
    node = begin(desk, map_interval=3.0)
    feed(desk, node, drive)
    stamps = [one.header.stamp.sec + 1e-9 * one.header.stamp.nanosec for one in desk.sent["/map"]]
    assert stamps[0] == BEGIN
    assert min(np.diff(stamps)) >= 3.0 - 1e-6
    assert 3 <= len(stamps) <= 5
    message = desk.sent["/map"][-1]
    data = np.reshape(message.data, (message.info.height, message.info.width))[::-1]
    assert set(np.unique(data)) == {-1, 0, 100}
    assert message.info.resolution == pytest.approx(0.05)


def test_the_transform_and_the_odometry_together_are_the_pose(desk, drive):
    node = begin(desk)
    for number, (odom, seen) in enumerate(list(drive.messages())[:20]):
        desk.hand(node, "/odom", odom)
        desk.hand(node, "/scan", seen)
        desk.tick(node)
        (place,) = desk.sent["/tf"][-1].transforms
        assert (place.header.frame_id, place.child_frame_id) == ("map", "odom")
        stamp = place.header.stamp.sec + 1e-9 * place.header.stamp.nanosec
        assert stamp == pytest.approx(drive.stamps[number] + TRANSFORM_AHEAD)
        turn = 2.0 * math.atan2(place.transform.rotation.z, place.transform.rotation.w)
        moved = Pose2D(place.transform.translation.x, place.transform.translation.y, turn)
        found, believed = compose(moved, drive.odometry[number]), pose_in(desk.sent["/pose"][-1])
        assert math.dist(found[:2], believed[:2]) < 1e-9
        assert abs(math.remainder(found.theta - believed.theta, math.tau)) < 1e-9


def test_transforms_serve_as_the_odometry_does(desk, drive):
    by_topic, by_transforms = begin(desk, out="topic"), begin(desk, out="transforms")
    feed(desk, by_topic, drive, steps=20)
    poses = [pose_in(one) for one in desk.sent["/pose"]]
    fixed = transform(0.0, "base_footprint", "base_scan", LASER.mount)
    desk.hand(by_transforms, "/tf_static", Transforms([fixed]))
    for (_, seen), stamp, pose in list(
        zip(drive.messages(), drive.stamps, drive.odometry, strict=True)
    )[:20]:
        desk.hand(by_transforms, "/scan", seen)
        desk.hand(
            by_transforms, "/tf", Transforms([transform(stamp, "odom", "base_footprint", pose)])
        )
        # What it publishes itself comes back to it.
        for transforms in desk.sent["/tf"]:
            desk.hand(by_transforms, "/tf", transforms)
        desk.sent["/tf"].clear()
    again = [pose_in(one) for one in desk.sent["/pose"][20:]]
    np.testing.assert_allclose(np.array(again), np.array(poses), atol=1e-9)


def test_the_laser_alone_gives_map_path_and_odometry(desk, drive):
    node = begin(desk, odometry="laser")
    for _, seen in drive.messages():
        desk.hand(node, "/scan", seen)
    start, end = drive.truth[0], drive.truth[-1]
    went, found = math.dist(start[:2], end[:2]), math.hypot(*pose_in(desk.sent["/pose"][-1])[:2])
    assert found == pytest.approx(went, abs=0.15)
    frames = {
        (one.header.frame_id, one.child_frame_id)
        for sent in desk.sent["/tf"]
        for one in sent.transforms
    }
    assert ("odom", "base_footprint") in frames


def test_diagnostics_say_how_sure_it_is(desk, drive):
    node = begin(desk)
    desk.tick(node)
    assert not desk.sent["/diagnostics"]
    feed(desk, node, drive, steps=10)
    desk.tick(node)
    (status,) = desk.sent["/diagnostics"][-1].status
    values = {one.key: one.value for one in status.values}
    assert values["scans"] == "10"
    assert values["dropped"] == "0"
    assert status.message.partition(":")[0] in {"sure", "in doubt"}


def test_a_laser_that_is_mirrored_on_the_way_is_said_and_puts_the_pose_in_doubt(desk, drive, capfd):
    node = begin(desk)
    feed(desk, node, drive, steps=30)
    assert not [line for line in lines(capfd) if "laser" in line and "mount" not in line]
    for odom, stamp, ranges in zip(drive.odometry, drive.stamps, drive.ranges, strict=True):
        if stamp > drive.stamps[29]:
            desk.hand(node, "/odom", odometry(stamp, odom))
            desk.hand(node, "/scan", scan(stamp, ranges[::-1], LASER))
    desk.tick(node)
    (said,) = [line for line in lines(capfd) if "laser changed" in line]
    assert "left and right change places, 6 s after the start" in said
    (status,) = desk.sent["/diagnostics"][-1].status
    assert status.message.startswith("in doubt: laser changed")
    desk.call(node, "reset")
    feed(desk, node, drive, since=100.0, steps=10)
    desk.tick(node)
    assert desk.sent["/diagnostics"][-1].status[0].message == "sure"


# --- files and services ---


def test_the_log_can_be_mapped_again(desk, drive):
    node = begin(desk)
    desk.hand(node, "/odom", odometry(9.0, drive.odometry[0]))
    desk.hand(node, "/odom", odometry(9.8, drive.odometry[0]))
    desk.hand(
        node, "/scan", scan(9.5, np.full(LASER.num_beams, np.nan), LASER)
    )  # says nothing; isn't logged
    feed(desk, node, drive)
    node.close()
    log = open_log(f"mapped/{LOG}")
    assert len(log.records) == len(drive.stamps)
    assert log.geometry.num_beams == LASER.num_beams
    assert log.geometry.range_max == pytest.approx(LASER.range_max)
    for record, stamp, pose, ranges in zip(
        log.records, drive.stamps, drive.odometry, drive.ranges, strict=True
    ):
        assert record.stamp == pytest.approx(stamp)
        assert record.odometry == pytest.approx(pose, abs=1e-6)
        np.testing.assert_allclose(record.scan.ranges, ranges, atol=6e-4)


def test_save_before_the_first_scan_says_so(desk):
    node = begin(desk)
    response = desk.call(node, "save")
    assert not response.success
    assert "no scan has come" in response.message
    node.close()


def test_save_says_where_and_draw_begins_a_drawing(desk, drive, monkeypatch):
    drawn = []
    monkeypatch.setattr(mapping, "draw_saved_map", drawn.append)
    node = begin(desk)
    feed(desk, node, drive, steps=5)
    assert "mapped/map.yaml" in desk.call(node, "save").message
    assert "drawing" in desk.call(node, "draw").message
    assert [str(one) for one in drawn] == ["mapped"]


def test_a_pause_leaves_scans_out(desk, drive):
    node = begin(desk)
    feed(desk, node, drive, steps=5)
    assert desk.call(node, "pause", data=True).success
    feed(desk, node, drive, since=2.0, steps=5)
    assert len(desk.sent["/pose"]) == 5
    assert desk.call(node, "pause", data=False).message == "mapping"
    feed(desk, node, drive, since=4.0, steps=5)
    assert len(desk.sent["/pose"]) == 10


def test_services_go_by_the_names_of_slam_toolbox_too(desk, drive):
    node = begin(desk)
    feed(desk, node, drive, steps=5)
    for name in ("save_map", "serialize_map"):
        assert "mapped/map.yaml" in desk.call(node, name).message
    assert "paused" in desk.call(node, "pause_new_measurements").message
    feed(desk, node, drive, since=2.0, steps=5)
    assert len(desk.sent["/pose"]) == 5
    assert desk.call(node, "pause_new_measurements").message == "mapping"


def test_a_reset_puts_the_map_aside(desk, drive):
    node = begin(desk)
    assert "no map yet" in desk.call(node, "reset").message
    feed(desk, node, drive, steps=20)
    for number in (1, 2):
        assert f"run{number}" in desk.call(node, "reset").message
        assert read_ros_map(f"mapped/run{number}/map.yaml").cells.size
        assert len(open_log(f"mapped/run{number}/{LOG}").records) == 20 // number
        feed(desk, node, drive, since=100.0 * number, steps=10)
    node.close()
    assert len(open_log(f"mapped/{LOG}").records) == 10


def test_a_clock_that_jumps_back_begins_again(desk, drive, capfd):
    node = begin(desk)
    feed(desk, node, drive, since=50.0, steps=20)
    feed(desk, node, drive, steps=20)
    assert sum("clock jumped back by" in line for line in lines(capfd)) == 1
    assert len(open_log(f"mapped/run1/{LOG}").records) == 20
    poses = np.array([pose_in(one) for one in desk.sent["/pose"]])
    np.testing.assert_array_equal(poses[:20], poses[20:])
    assert desk.sent["/map"][-1].header.stamp.sec < 50


def test_fixed_transforms_outlive_a_reset(desk, drive, capfd):
    node = begin(desk)
    fixed = transform(0.0, "base_footprint", "base_scan", Pose2D(0.3, 0.0, 0.0))
    desk.hand(node, "/tf_static", Transforms([fixed]))
    feed(desk, node, drive, steps=3)
    desk.call(node, "reset")
    feed(desk, node, drive, since=2.0, steps=3)
    assert not [line for line in lines(capfd) if "laser_mount" in line]


def test_scans_that_are_pending_at_a_reset_belong_to_no_map(desk, drive):
    node = begin(desk)
    feed(desk, node, drive, steps=3)
    with node.worker.lock:
        for odom, seen in list(drive.messages(2.0))[:3]:
            for topic, message in (("/odom", odom), ("/scan", seen)):
                next(end for end in desk.answers[node] if end.topic == topic).callback(message)
        node._reset()
    desk.settle(node)
    assert len(desk.sent["/pose"]) == 3


def test_two_mappers_share_no_folder(desk):
    begin(desk)
    with pytest.raises(StorageError, match="another run is writing to this folder"):
        begin(desk)


def test_a_folder_that_is_a_file_is_refused_at_once(desk, tmp_path):
    (tmp_path / "taken").write_text("")
    with pytest.raises(StorageError, match="choose another"):
        begin(desk, out="taken")


def test_a_full_disk_ends_the_log_and_not_the_map(desk, drive, monkeypatch, capfd):
    node = begin(desk)
    feed(desk, node, drive, steps=3)

    def refuse(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(gzip.GzipFile, "write", refuse)
        patch.setattr("slamgym.ros2.map_run.carmen_lines", lambda *_: ["", "x" * 100_000])
        feed(desk, node, drive, since=1.0, steps=3)
        response = desk.call(node, "save")
    feed(desk, node, drive, since=2.0, steps=3)
    assert response.success
    assert sum("the log ends here" in line and "disk is full" in line for line in lines(capfd)) == 1
    assert len(desk.sent["/pose"]) == 9
    assert node.worker.error is None


def test_a_close_that_cannot_save_says_so_in_a_sentence(desk, drive, monkeypatch):
    node = begin(desk)
    feed(desk, node, drive, steps=3)

    def refuse(*_):
        raise StorageError("mapped", "can't be written (the disk is full; free some space)")

    monkeypatch.setattr("slamgym.ros2.map_run.write_ros_map", refuse)
    assert not desk.call(node, "save").success
    assert not desk.call(node, "reset").success
    feed(desk, node, drive, since=2.0, steps=3)
    assert len(desk.sent["/pose"]) == 6  # it goes on with the old map
    with pytest.raises(SlamgymError, match="disk is full"):
        node.close()


# --- a finished map ---


@pytest.fixture(scope="module")
def finished(drive, tmp_path_factory):
    """The home's map as the mapper made it."""
    from slamgym.interop import write_ros_map

    mapper, _ = mapped_directly(drive)
    return str(write_ros_map(tmp_path_factory.mktemp("finished"), mapper.occupancy_grid()))


def test_it_localises_from_a_given_pose(desk, drive, finished):
    node = begin(desk, map=finished)
    shown = desk.sent["/map"]
    assert len(shown) == 1
    assert {FREE, OCCUPIED} <= set(np.unique(read_ros_map(finished).cells))
    start = pose_on_map(9.0, drive.odometry[0])
    desk.hand(node, "/initialpose", start)
    feed(desk, node, drive)
    assert len(shown) == 1  # nothing is mapped
    believed = pose_in(desk.sent["/pose"][-1])
    assert math.dist(believed[:2], drive.truth[-1][:2]) < 0.2
    assert "the map stays" in desk.call(node, "reset").message
    desk.hand(node, "/initialpose", start)
    feed(desk, node, drive, since=60.0)
    believed = pose_in(desk.sent["/pose"][-1])
    assert math.dist(believed[:2], drive.truth[-1][:2]) < 0.2


def test_without_a_given_pose_it_finds_itself_or_says_it_is_in_doubt(desk, drive, finished):
    node = begin(desk, map=finished)
    feed(desk, node, drive)
    desk.tick(node)
    believed = pose_in(desk.sent["/pose"][-1])
    close = math.dist(believed[:2], drive.truth[-1][:2]) < 0.3
    assert close or desk.sent["/diagnostics"][-1].status[0].message.startswith("in doubt")


def test_a_pose_of_another_frame_begins_nothing(desk, drive, finished, capfd):
    node = begin(desk, map=finished)
    desk.hand(node, "/initialpose", pose_on_map(9.0, drive.odometry[0], frame="odom"))
    assert any("'odom'" in line for line in lines(capfd))


def test_a_map_that_cannot_be_read_is_refused(desk):
    with pytest.raises(InputFileError, match=r"nowhere\.yaml"):
        begin(desk, map="nowhere.yaml")


def test_wrong_settings_of_the_mapper_end_it_in_a_sentence(desk, drive):
    def configure(_):
        raise ConfigError("slam.resolution must be above 0")

    node = desk.make(MapNode, MapParameters(), configure)
    odom, seen = next(drive.messages())
    for topic, message in (("/odom", odom), ("/scan", seen)):
        next(end for end in desk.answers[node] if end.topic == topic).callback(message)
    desk.settle(node)
    assert isinstance(node.worker.error, ConfigError)
