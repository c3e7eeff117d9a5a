import shutil
import struct

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from slamgym.commands.cli import TABLE
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.geometry import compose
from slamgym.core.types import GridFrame, OccupancyGrid, Pose2D, Trajectory
from slamgym.interop import BagChoices, open_log, read_rosbag, write_rosbag2
from slamgym.interop.rosbag import _read
from slamgym.interop.rosbag_writer import BagTracks
from slamgym.interop.transforms import TransformTree, planar, rigid_transform


def export_log(argv):
    return TABLE.run("slamgym", ["export-log", *map(str, argv)])


pytest.importorskip("rosbags")

GRID = OccupancyGrid(np.array([[0, 205, 254]], np.uint8), GridFrame(0.05, -1.0, 2.0, 1, 3))


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_log_survives_rosbag2(tmp_path, records, geometry, storage):
    write_rosbag2(tmp_path / "bag", records, geometry, grid=GRID, storage=storage)
    log = open_log(tmp_path / "bag")
    assert log.warnings.sentences() == []
    assert log.geometry.angles == pytest.approx(geometry.angles, abs=1e-6)
    assert log.geometry.mount == pytest.approx(geometry.mount)
    assert len(log) == len(records)
    for ours, theirs in zip(records, log, strict=True):
        assert theirs.stamp == pytest.approx(ours.stamp)
        assert theirs.odometry == pytest.approx(ours.odometry, abs=1e-9)
        seen = ours.scan.ranges > 0.0
        assert (theirs.scan.ranges[seen] == ours.scan.ranges[seen]).all()
        assert np.isnan(theirs.scan.ranges[~seen]).all()


def test_a_single_storage_file_opens_too(tmp_path, records, geometry):
    write_rosbag2(tmp_path / "bag", records, geometry, storage="mcap")
    assert len(open_log(tmp_path / "bag" / "bag.mcap")) == len(records)


def test_the_map_is_published_with_row_zero_at_the_bottom(tmp_path, records, geometry):
    from rosbags.highlevel import AnyReader

    write_rosbag2(tmp_path / "bag", records, geometry, grid=GRID)
    with AnyReader([tmp_path / "bag"]) as reader:
        topics = set(reader.topics)
        connection = next(c for c in reader.connections if c.topic == "/map")
        _, _, raw = next(reader.messages([connection]))
        message = reader.deserialize(raw, connection.msgtype)
    assert topics == {"/scan", "/odom", "/tf", "/tf_static", "/clock", "/map"}
    assert message.data.tolist() == [100, -1, 0]
    assert (message.info.origin.position.x, message.info.origin.position.y) == (-1.0, 2.0)


def messages_of(bag):
    """Topic, time of writing [s] and message of everything in a bag."""
    from rosbags.highlevel import AnyReader

    with AnyReader([bag]) as reader:
        return [
            (c.topic, t * 1e-9, reader.deserialize(raw, c.msgtype))
            for c, t, raw in reader.messages()
        ]


def test_a_bag_has_speeds_truth_clock_and_a_whole_tree_of_frames(tmp_path, records, geometry):
    stamps = np.array([record.stamp for record in records])
    circle = np.column_stack(
        [np.sin(stamps - 100), 1 - np.cos(stamps - 100), stamps - 100]
    )  # 1 m/s, 1 rad/s
    driven = [r._replace(odometry=Pose2D(*pose)) for r, pose in zip(records, circle, strict=True)]
    shifted = Trajectory(stamps[[0, -1]], circle[[0, -1]])
    tracks = BagTracks(Trajectory(stamps, circle + np.array([5.0, 0.0, 0.0])), shifted)
    write_rosbag2(tmp_path / "bag", driven, geometry, tracks=tracks, first_stamp=1.7e9)
    found = messages_of(tmp_path / "bag")
    assert found[0][1] == 1.7e9
    odometry = [message for topic, _, message in found if topic == "/odom"]
    assert odometry[0].twist.twist.linear.x == 0.0
    assert odometry[5].twist.twist.linear.x == pytest.approx(1.0, rel=1e-6)
    assert odometry[5].twist.twist.angular.z == pytest.approx(1.0)
    assert (np.diag(odometry[5].pose.covariance.reshape(6, 6)) > 0.0).all()
    truth = [message for topic, _, message in found if topic == "/ground_truth"]
    assert truth[3].header.frame_id == "map"
    assert truth[3].pose.pose.position.x == pytest.approx(circle[3, 0] + 5.0)
    clock = [message.clock for topic, _, message in found if topic == "/clock"]
    assert (clock[1].sec, clock[1].nanosec) == (1_700_000_000, 200_000_000)
    frames = {
        (t.header.frame_id, t.child_frame_id)
        for topic, _, m in found
        if "tf" in topic
        for t in m.transforms
    }
    assert frames == {("map", "odom"), ("odom", "base_footprint"), ("base_footprint", "base_scan")}
    scan = next(message for topic, _, message in found if topic == "/scan")
    assert scan.scan_time == pytest.approx(0.2)


def test_map_and_odom_together_give_the_estimate(tmp_path, records, geometry):
    stamps = np.array([record.stamp for record in records])
    estimate = np.column_stack([stamps - 99, 0.1 * stamps, 0.01 * (stamps - 100)])
    write_rosbag2(
        tmp_path / "bag", records, geometry, tracks=BagTracks(None, Trajectory(stamps, estimate))
    )
    trees = [m.transforms[0] for topic, _, m in messages_of(tmp_path / "bag") if topic == "/tf"]
    at = [
        Pose2D(t.transform.translation.x, t.transform.translation.y, 2 * np.arctan2(q.z, q.w))
        for t in trees
        for q in (t.transform.rotation,)
    ]
    assert compose(at[9], at[8]) == pytest.approx(Pose2D(*estimate[4]), abs=1e-6)


def test_an_episode_is_dated_and_localised_on_demand(tmp_path, records, geometry):
    from slamgym.interop import write_tum

    folder = tmp_path / "episode"
    folder.mkdir()
    write_rosbag2(folder / "bag", records, geometry)
    track = Trajectory(np.array([100.0, 102.0]), np.zeros((2, 3)))
    bag = folder / "bag"
    with pytest.raises(InputFileError, match="--localised needs an episode"):
        export_log([str(bag), "--format", "rosbag2", "--localised", "-o", str(tmp_path / "out")])
    write_tum(bag / "truth.tum", track)
    write_tum(bag / "estimate.tum", track)
    assert (
        export_log([str(bag), "--format", "rosbag2", "--localised", "-o", str(tmp_path / "out")])
        == 0
    )
    found = messages_of(tmp_path / "out")
    assert found[0][1] == 1.7e9
    assert {"/ground_truth", "/tf", "/odom"} <= {topic for topic, _, _ in found}


def write_rosbag1(path, records, geometry):
    """A ROS 1 bag whose laser hangs upside down."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(
        get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage")
    )
    types = store.types

    def header(stamp, frame):
        ns = round(stamp * 1e9)
        time = types["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
        return types["std_msgs/msg/Header"](seq=0, stamp=time, frame_id=frame)

    def transform(stamp, parent, child, xyz, quaternion):
        body = types["geometry_msgs/msg/Transform"](
            translation=types["geometry_msgs/msg/Vector3"](*xyz),
            rotation=types["geometry_msgs/msg/Quaternion"](*quaternion),
        )
        stamped = types["geometry_msgs/msg/TransformStamped"](header(stamp, parent), child, body)
        return types["tf2_msgs/msg/TFMessage"]([stamped])

    with Writer(path) as writer:
        scan = writer.add_connection("/base_scan", "sensor_msgs/msg/LaserScan", typestore=store)
        tf = writer.add_connection("/tf", "tf2_msgs/msg/TFMessage", typestore=store)

        def write(connection, stamp, message):
            writer.write(
                connection, round(stamp * 1e9), store.serialize_ros1(message, connection.msgtype)
            )

        first = records[0].stamp
        write(
            tf,
            first,
            transform(first, "/base_link", "/laser", (0.1, 0.0, 0.3), (1.0, 0.0, 0.0, 0.0)),
        )
        for record in records:
            pose = record.odometry
            half = 0.5 * pose.theta
            turned = (0.0, 0.0, np.sin(half), np.cos(half))
            write(
                tf,
                record.stamp,
                transform(record.stamp, "/odom", "/base_link", (*pose[:2], 0.0), turned),
            )
            message = types["sensor_msgs/msg/LaserScan"](
                header(record.stamp, "/laser"), geometry.angle_min, -geometry.angle_min,
                geometry.angle_increment, 0.0, 0.0, geometry.range_min, geometry.range_max,
                record.scan.ranges, np.zeros(0, np.float32),
            )  # fmt: skip
            write(scan, record.stamp, message)


def test_rosbag1_with_tf_alone_and_a_laser_upside_down(tmp_path, records, geometry):
    write_rosbag1(tmp_path / "a.bag", records, geometry)
    log = open_log(tmp_path / "a.bag")
    assert log.geometry.mount == pytest.approx((0.1, 0.0, 0.0), abs=1e-9)
    assert [record.odometry for record in log] == [
        pytest.approx(r.odometry, abs=1e-6) for r in records
    ]
    # Upside down, the beams run the other way round.
    assert log.records[0].scan.ranges[-1] == records[0].scan.ranges[0]


class TestErrors:
    def test_an_unknown_topic_lists_those_there_are(self, tmp_path, records, geometry):
        write_rosbag2(tmp_path / "bag", records, geometry)
        with pytest.raises(InputFileError, match="/scan"):
            read_rosbag(tmp_path / "bag", BagChoices(scan_topic="/laser"))

    def test_an_existing_folder_is_not_overwritten(self, tmp_path, records, geometry):
        with pytest.raises(InputFileError, match="exists already"):
            write_rosbag2(tmp_path, records, geometry)

    def test_a_missing_package_names_the_extra(self, tmp_path, monkeypatch):
        monkeypatch.setitem(__import__("sys").modules, "rosbags.highlevel", None)
        (tmp_path / "a.bag").write_bytes(b"")
        with pytest.raises(ConfigError, match=r"slamgym\[ros\]"):
            _read((tmp_path / "a.bag", BagChoices()))  # in this process, which lacks it

    def test_a_folder_without_a_bag_is_one_error(self, tmp_path):
        with pytest.raises(InputFileError, match="no episode and no ROS bag"):
            open_log(tmp_path)

    @settings(max_examples=25)
    @given(st.sampled_from([".bag", ".mcap", ".db3"]), st.binary(max_size=300))
    def test_junk_is_one_error(self, tmp_path, suffix, content):
        path = tmp_path / f"a{suffix}"
        path.write_bytes(content)
        with pytest.raises(InputFileError, match=r"a\.(bag|mcap|db3)"):
            open_log(path)

    @pytest.mark.parametrize(
        ("broken", "fault"),
        [
            ({"angle_increment": 1e-30}, "impossible beam angles"),
            ({"angle_increment": np.nan}, "impossible beam angles"),
            ({"angle_min": -1e30}, "impossible beam angles"),
            ({"range_min": -1e30}, "impossible range limits"),
        ],
    )
    def test_scans_with_impossible_numbers_are_counted(
        self, tmp_path, records, geometry, broken, fault
    ):
        write_rosbag2(tmp_path / "bag", records, geometry._replace(**broken))
        with pytest.raises(
            InputFileError, match=f"no usable scan: 10 x scan left out because of {fault}"
        ):
            open_log(tmp_path / "bag")

    @pytest.mark.parametrize("x", [np.nan, np.inf, 1e7, -1e300])
    def test_a_pose_that_is_no_place_costs_one_message(self, tmp_path, records, geometry, x):
        records[4] = records[4]._replace(odometry=Pose2D(x, 0.0, 0.0))
        write_rosbag2(tmp_path / "bag", records, geometry)
        log = open_log(tmp_path / "bag")
        assert log.warnings.counts["message on /odom that can't be decoded"] == 1
        assert len(log) == 10
        before, after = records[3].odometry, records[5].odometry
        assert log.records[4].odometry.x == pytest.approx(0.5 * (before.x + after.x))

    @settings(max_examples=15)
    @given(
        st.sampled_from(["sqlite3", "mcap"]),
        st.floats(0.0, 1.0),
        st.binary(min_size=1, max_size=40),
    )
    @example("mcap", 0.536, b"\x00\x00\x00\x00\x01")
    @example("mcap", 0.4, struct.pack("<4f", 1e-30, 1e-30, 1e-30, 1e-30))
    def test_a_damaged_bag_is_an_error_or_a_counted_warning(
        self, tmp_path_factory, records, geometry, storage, place, junk
    ):
        whole = tmp_path_factory.getbasetemp() / f"whole_{storage}" / "bag"
        if not whole.exists():
            write_rosbag2(whole, records, geometry, storage=storage)
        folder = tmp_path_factory.mktemp("damaged") / "bag"
        shutil.copytree(whole, folder)
        file = next(path for path in folder.iterdir() if path.suffix in (".db3", ".mcap"))
        content = bytearray(file.read_bytes())
        at = int(place * (len(content) - 1))
        content[at : at + len(junk)] = junk
        file.write_bytes(content)
        try:
            log = open_log(folder)
        except InputFileError:
            return
        assert len(log) > 0
        geometry = log.geometry
        assert np.isfinite([*geometry.mount, geometry.range_min, geometry.range_max]).all()
        assert np.abs(geometry.angles).max() < 100.0
        assert all(np.isfinite(record.odometry).all() for record in log)


def test_transforms_chain_and_invert():
    tree = TransformTree()
    half = np.sqrt(0.5)
    turned = rigid_transform(np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, half, half]))
    tree.add("base", "tower", 0.0, turned, static=True)
    tree.add(
        "tower",
        "laser",
        0.0,
        rigid_transform(np.array([0.0, 1.0, 0.5]), np.array([0, 0, 0, 1.0])),
        static=True,
    )
    found = tree.lookup("laser", "base")
    assert planar(found) == pytest.approx((0.0, 0.0, np.pi / 2))
    assert tree.lookup("base", "laser") @ found == pytest.approx(np.eye(4))
    assert tree.lookup("laser", "elsewhere") is None


class TestExportCommand:
    def test_an_episode_is_exported_both_ways(self, tmp_path, records, geometry, capsys):
        from slamgym.interop import write_carmen, write_ros_map

        episode = tmp_path / "episode"
        episode.mkdir()
        write_carmen(episode / "scans.log", records, geometry)
        write_ros_map(episode, GRID)
        assert export_log([str(episode), "-o", str(tmp_path / "a.log.gz")]) == 0
        assert export_log([str(episode), "-o", str(tmp_path / "bag"), "--format", "rosbag2"]) == 0
        assert (
            len(open_log(tmp_path / "a.log.gz")) == len(open_log(tmp_path / "bag")) == len(records)
        )
        assert "10 scans" in capsys.readouterr().out
        with pytest.raises(InputFileError, match="exists already"):
            export_log([str(episode), "-o", str(tmp_path / "a.log.gz")])
