"""Compressed bags that expand beyond the limits are refused soon."""

import bz2
import contextlib
import hashlib
import sqlite3
import struct
import sys
import tracemalloc

import lz4.frame
import numpy as np
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from slamgym.core.errors import InputFileError
from slamgym.interop import BagChoices, open_log
from slamgym.interop.rosbag import _read, import_rosbags

pytest.importorskip("rosbags")

BOMB = 32 << 20
"""Bytes of zeros that expand from a few kB or, with lz4, a hundred."""
MOST_MEMORY = 36 << 20
"""What lz4 may expand to, 200 bytes for each; the library took twice the bomb."""
TYPES = get_typestore(Stores.ROS2_HUMBLE)


def record(head, data):
    fields = b"".join(struct.pack("<I", len(field)) + field for field in head)
    return struct.pack("<I", len(fields)) + fields + struct.pack("<I", len(data)) + data


FLOAT = b"float32 x"
TIME = struct.pack("<II", 1, 0)


def ros1_bomb(path, compression, content, definition=FLOAT, md5="", times=1):
    """A ROS 1 bag of one chunk whose index names a message in it, once or more often."""
    number = b"conn=" + struct.pack("<I", 0)
    kind = [
        b"topic=/scan",
        b"type=sensor_msgs/LaserScan",
        b"md5sum=" + (md5 or hashlib.md5(definition).hexdigest()).encode(),
        b"message_definition=" + definition,
    ]
    connection_data = b"".join(struct.pack("<I", len(field)) + field for field in kind)
    connection = record([b"op=\x07", number, b"topic=/scan"], connection_data)
    size = b"size=" + struct.pack("<I", BOMB)
    chunk = record([b"op=\x05", b"compression=" + compression, size], content)
    index_head = [
        b"op=\x04",
        b"ver=" + struct.pack("<I", 1),
        number,
        b"count=" + struct.pack("<I", times),
    ]
    index = record(index_head, (TIME + struct.pack("<I", 0)) * times)
    magic = b"#ROSBAG V2.0\n"
    place = len(magic) + 4096
    info = [b"op=\x06", b"ver=" + struct.pack("<I", 1), b"chunk_pos=" + struct.pack("<Q", place)]
    info += [b"start_time=" + TIME, b"end_time=" + TIME, b"count=" + struct.pack("<I", 1)]
    chunk_info = record(info, struct.pack("<II", 0, 1))
    counts = [b"conn_count=" + struct.pack("<I", 1), b"chunk_count=" + struct.pack("<I", 1)]
    at = b"index_pos=" + struct.pack("<Q", place + len(chunk) + len(index))
    head = record([b"op=\x03", at, *counts], b"")
    head = head[:-4] + struct.pack("<I", 4096 - len(head)) + b" " * (4096 - len(head))
    path.write_bytes(magic + head + chunk + index + connection + chunk_info)


def rosbag2(folder, mode, plugin=StoragePlugin.SQLITE3, size=BOMB):
    """A rosbag2 of one scan of very many equal ranges."""
    writer = Writer(folder, version=8, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        kind = "sensor_msgs/msg/LaserScan"
        connection = writer.add_connection("/scan", kind, typestore=TYPES)
        stamp = TYPES.types["builtin_interfaces/msg/Time"](1, 0)
        header = TYPES.types["std_msgs/msg/Header"](stamp, "laser")
        ranges = np.zeros(size // 4, np.float32)
        scan = TYPES.types[kind](header, -1.0, 1.0, 0.1, 0.0, 0.1, 0.1, 8.0, ranges, ranges[:0])
        writer.write(connection, 10**9, TYPES.serialize_cdr(scan, kind))
    return folder


def nested_definition(depth):
    """A scan of two messages of two messages each, and so on, of which the last holds nothing; and its MD5 sum."""
    text = b""
    inner = hashlib.md5(b"")
    for level in reversed(range(depth)):
        text = b"\n" + b"=" * 80 + b"\nMSG: a/A%d\n" % (level + 1) + text
        text = b"a/A%d x\na/A%d y\n" % (level + 1, level + 1) + text
        digest = inner.hexdigest().encode()
        inner = hashlib.md5(digest + b" x\n" + digest + b" y")
    return text, inner.hexdigest()


def database(path, content):
    """A rosbag2 database of one message, whose content is computed."""
    with contextlib.closing(sqlite3.connect(path)) as bag:
        bag.executescript(f"""
            CREATE TABLE topics(id INTEGER, name TEXT, type TEXT, serialization_format TEXT,
                offered_qos_profiles TEXT);
            CREATE TABLE messages(id INTEGER, topic_id INTEGER, timestamp INTEGER, data BLOB AS ({content}));
            INSERT INTO topics VALUES(1, '/scan', 'sensor_msgs/msg/LaserScan', 'cdr', '');
            INSERT INTO messages VALUES(1, 1, 1);
        """)


def refused(path, match="bytes for each compressed one, above the limit of 200"):
    tracemalloc.start()
    with pytest.raises(InputFileError, match=match):
        _read((path, BagChoices()))  # in this process, whose memory is traced
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return most


@pytest.mark.parametrize("compression", [b"bz2", b"lz4"])
def test_chunks_of_ros1_that_expand_too_much_are_refused(tmp_path, compression):
    compress = bz2.compress if compression == b"bz2" else lz4.frame.compress
    import_rosbags()
    path = tmp_path / "bomb.bag"
    ros1_bomb(path, compression, compress(bytes(BOMB)))
    assert path.stat().st_size < 200_000
    assert refused(path) < MOST_MEMORY


@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE])
def test_rosbag2_that_expands_too_much_is_refused(tmp_path, monkeypatch, mode):
    monkeypatch.setenv("TMPDIR", str(tmp_path / "none"))  # nothing is expanded to disk
    folder = rosbag2(tmp_path / "bomb", mode)
    assert refused(folder) < MOST_MEMORY


@pytest.mark.parametrize("is_indexed", [True, False])
def test_chunks_of_mcap_that_expand_too_much_are_refused(tmp_path, is_indexed):
    folder = rosbag2(tmp_path / "bomb", CompressionMode.STORAGE, StoragePlugin.MCAP)
    (path,) = folder.glob("*.mcap")
    if not is_indexed:
        content = bytearray(path.read_bytes())
        content[-28:-20] = bytes(8)  # where the summary starts
        path.write_bytes(content)
    assert refused(path) < MOST_MEMORY


def test_the_whole_bag_stays_below_the_limit_of_files(tmp_path, monkeypatch):
    monkeypatch.setenv("SLAMGYM_MAX_FILE_BYTES", "1000000")
    folder = rosbag2(tmp_path / "bag", CompressionMode.FILE, size=3 << 20)
    refused(folder, "bytes, above the limit of 1,000,000")


def test_definitions_within_definitions_end_with_the_time_of_the_reader(tmp_path, monkeypatch):
    """A bag of 6 kB whose one message, of no bytes, is a tree of 2^40 messages."""
    monkeypatch.setenv("SLAMGYM_MAX_READER_SECONDS", "1")
    text, md5 = nested_definition(40)
    message = record([b"op=\x02", b"conn=" + bytes(4), b"time=" + TIME], b"")
    ros1_bomb(tmp_path / "a.bag", b"none", message, text, md5)
    assert (tmp_path / "a.bag").stat().st_size < 16_000
    with pytest.raises(InputFileError, match=r"a\.bag: .*takes it more than 1 s or"):
        open_log(tmp_path / "a.bag")


@pytest.mark.skipif(sys.platform != "linux", reason="bounds memory as Linux counts it")
def test_messages_that_a_database_computes_stay_within_the_memory_of_the_reader(
    tmp_path, monkeypatch
):
    monkeypatch.setenv("SLAMGYM_MAX_READER_BYTES", "200000000")
    database(tmp_path / "a.db3", "zeroblob(900000000)")
    with pytest.raises(InputFileError, match=r"a\.db3: .*(bytes of memory|memory)"):
        open_log(tmp_path / "a.db3")


@pytest.mark.skipif(sys.platform != "linux", reason="bounds memory as Linux counts it")
def test_an_index_that_names_a_message_again_and_again_is_refused(tmp_path, monkeypatch):
    """A bag of 1 MB that claims 100,000 scans of 36 kB each."""
    monkeypatch.setenv("SLAMGYM_MAX_READER_BYTES", "200000000")
    store = get_typestore(Stores.ROS1_NOETIC)
    kind = "sensor_msgs/msg/LaserScan"
    stamp = store.types["builtin_interfaces/msg/Time"](1, 0)
    header = store.types["std_msgs/msg/Header"](0, stamp, "laser")
    ranges = np.ones(9_000, np.float32)
    scan = store.types[kind](header, -1.0, 1.0, 0.1, 0.0, 0.1, 0.1, 8.0, ranges, ranges[:0])
    message = record(
        [b"op=\x02", b"conn=" + bytes(4), b"time=" + TIME], store.serialize_ros1(scan, kind)
    )
    text, md5 = store.generate_msgdef(kind)
    ros1_bomb(tmp_path / "a.bag", b"none", message, text.encode(), md5, 100_000)
    with pytest.raises(InputFileError, match=r"a\.bag: .*bytes of memory"):
        open_log(tmp_path / "a.bag")


@pytest.mark.parametrize(
    ("mode", "plugin"),
    [
        (CompressionMode.FILE, StoragePlugin.SQLITE3),
        (CompressionMode.MESSAGE, StoragePlugin.SQLITE3),
        (CompressionMode.STORAGE, StoragePlugin.MCAP),
    ],
)
def test_good_compressed_bags_are_read(tmp_path, mode, plugin):
    folder = rosbag2(tmp_path / "bag", mode, plugin, size=2000)
    assert open_log(folder).records[0].scan.ranges.shape == (500,)
