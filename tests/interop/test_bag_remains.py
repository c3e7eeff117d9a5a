"""Of a bag that was cut off what is whole is read, and how much is said; where nothing is, the repair is named."""

import contextlib
import math

import numpy as np
import pytest

pytest.importorskip("rosbags")

from hypothesis import given, settings
from hypothesis import strategies as st
from interop.test_bag_expansion import rosbag2
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from slamgym.core.errors import InputFileError
from slamgym.core.types import LaserGeometry, LaserScan, Pose2D
from slamgym.interop import Log, LogRecord, open_log
from slamgym.interop.bag_remains import whole_part
from slamgym.interop.rosbag import BagChoices, _read, import_rosbags
from slamgym.interop.rosbag_writer import write_rosbag2

SCANS = 400
GEOMETRY = LaserGeometry(90, -math.pi, math.pi / 45, 0.1, 8.0)
SIGNS = {
    ".mcap": "mcap recover FILE",
    ".bag": "rosbag reindex FILE",
    ".db3": "sqlite3 FILE .recover",
}


def drive():
    rng = np.random.default_rng(0)
    records = []
    for number in range(SCANS):
        stamp = 1.6e9 + 0.2 * number
        ranges = rng.uniform(0.5, 7.5, GEOMETRY.num_beams).astype(np.float32)
        pose = Pose2D(0.02 * number, 0.0, 0.0)
        records.append(LogRecord(stamp, pose, LaserScan(stamp, ranges, GEOMETRY)))
    return Log("drive", records, GEOMETRY)


def write_ros1(path, log, compression):
    """A ROS 1 bag with many chunks."""
    rosbags = import_rosbags()
    types = rosbags.typesys
    store = types.get_typestore(types.Stores.ROS1_NOETIC)
    kind = "sensor_msgs/msg/LaserScan"
    writer = rosbags.rosbag1.Writer(path)
    writer.chunk_threshold = 8_000
    if compression:
        writer.set_compression(writer.CompressionFormat[compression])
    with writer:
        connection = writer.add_connection("/scan", kind, typestore=store)
        for number, record in enumerate(log):
            nanoseconds = round(record.stamp * 1e9)
            stamp = store.types["builtin_interfaces/msg/Time"](*divmod(nanoseconds, 10**9))
            header = store.types["std_msgs/msg/Header"](number, stamp, "laser")
            fields = (GEOMETRY.angle_min, -GEOMETRY.angle_min, GEOMETRY.angle_increment, 0.0, 0.2)
            ranges = record.scan.ranges
            scan = store.types[kind](header, *fields, 0.1, 8.0, ranges, ranges[:0])
            writer.write(connection, nanoseconds, store.serialize_ros1(scan, kind))


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Whole bags of one drive, by their kind."""
    folder = tmp_path_factory.mktemp("bags")
    log = drive()
    for storage in ("mcap", "sqlite3"):
        write_rosbag2(folder / storage, log.records, log.geometry, storage=storage)
    for compression in ("", "BZ2", "LZ4"):
        write_ros1(folder / f"ros1{compression}.bag", log, compression)
    (mcap,) = (folder / "mcap").glob("*.mcap")
    (database,) = (folder / "sqlite3").glob("*.db3")
    ros1 = {name: folder / f"{name}.bag" for name in ("ros1", "ros1BZ2", "ros1LZ4")}
    return {"mcap": mcap, "sqlite3": database, **ros1}


KINDS = ("mcap", "sqlite3", "ros1", "ros1BZ2", "ros1LZ4")


def cut(bag, folder, share, tail=b""):
    content = bag.read_bytes()
    path = folder / f"cut{bag.suffix}"
    path.write_bytes(content[: int(share * len(content))] + tail)
    return path


@pytest.mark.parametrize("tail", [b"", bytes(5000)], ids=["ends", "zeros"])
@pytest.mark.parametrize("share", [0.5, 0.9])
@pytest.mark.parametrize("kind", KINDS)
def test_what_is_whole_is_read_and_how_much_is_said(bags, tmp_path, kind, share, tail):
    if kind == "sqlite3":
        tail = b""  # a page of zeros is one without rows
    log = _read((cut(bags[kind], tmp_path, share, tail), BagChoices()))
    (finding,) = [one for one in log.findings if one.kind == "cut off"]
    assert f"{len(log)} scans in {log.duration:.0f} s" in finding.sentence
    # A chunk, and a page of a database, is lost in which the cut is; indices at the end take a part of the file, too.
    assert 0.75 * share * SCANS < len(log) <= SCANS
    for record, written in zip(log, drive(), strict=False):
        assert record.stamp == pytest.approx(written.stamp)
        np.testing.assert_array_equal(record.scan.ranges, written.scan.ranges)


@pytest.mark.parametrize("kind", KINDS)
def test_whole_bags_have_no_such_finding(bags, kind):
    log = _read((bags[kind], BagChoices()))
    assert len(log) == SCANS
    assert not [one for one in log.findings if one.kind == "cut off"]


@pytest.mark.parametrize("kind", KINDS)
def test_where_nothing_is_whole_the_repair_is_named(bags, tmp_path, kind):
    path = cut(bags[kind], tmp_path, 0.0, bags[kind].read_bytes()[:100])
    with pytest.raises(InputFileError, match=f"cut off: {SIGNS[path.suffix]}"):
        _read((path, BagChoices()))


@settings(max_examples=40)
@given(st.sampled_from(KINDS), st.floats(0.0, 1.0))
def test_wherever_it_is_cut_there_is_a_log_or_one_sentence(bags, tmp_path_factory, kind, share):
    path = cut(bags[kind], tmp_path_factory.mktemp("cut"), share)
    stamps = []
    with contextlib.suppress(InputFileError):
        stamps = [record.stamp for record in _read((path, BagChoices()))]
    assert stamps == pytest.approx([record.stamp for record in drive().records[: len(stamps)]])


def test_a_folder_that_was_cut_off_before_its_metadata_is_read_by_the_command_too(bags, tmp_path):
    folder = tmp_path / "bag"
    folder.mkdir()
    cut(bags["mcap"], folder, 0.7)
    log = open_log(folder)
    assert log.findings[0].kind == "cut off"
    assert log.source == str(folder)


@pytest.mark.parametrize("tail", [b"", bytes(5000)], ids=["ends", "zeros"])
def test_a_compressed_chunk_is_read_if_it_is_whole(tmp_path, tail):
    folder = rosbag2(tmp_path / "bag", CompressionMode.STORAGE, StoragePlugin.MCAP, size=2000)
    (mcap,) = folder.glob("*.mcap")
    content = mcap.read_bytes()
    path = tmp_path / "cut.mcap"
    path.write_bytes(content[:-200] + tail)
    assert _read((path, BagChoices())).records[0].scan.ranges.shape == (500,)
    path.write_bytes(content[: content.index(b"zstd") + 300] + tail)
    with pytest.raises(InputFileError, match="cut off: mcap recover FILE"):
        _read((path, BagChoices()))


def test_other_files_have_no_remains(tmp_path):
    for name in ("a.bag", "a.mcap"):
        (tmp_path / name).write_bytes(b"something else " * 1000)
        assert whole_part(tmp_path / name, tmp_path, lambda _, data: data) is None
    assert whole_part(tmp_path, tmp_path, lambda _, data: data) is None  # two
    (tmp_path / "a.txt").write_text("")
    assert whole_part(tmp_path / "a.txt", tmp_path, lambda _, data: data) is None
