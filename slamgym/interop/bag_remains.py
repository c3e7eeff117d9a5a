"""What is whole of a ROS bag whose recording was cut off, by a power cut say, as a bag that the library reads.

A recorder writes its index last, so the library finds none. What was written before is in order: of an MCAP file
(https://mcap.dev/spec) records and chunks, of a ROS 1 bag (https://wiki.ros.org/Bags/Format/2.0) chunks with their own
indices, of a database the rows of a table.
"""

import contextlib
import io
import os
import shutil
import sqlite3
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from slamgym.core.errors import InputFileError
from slamgym.core.files import open_regular
from slamgym.core.limits import FILE_BYTES
from slamgym.interop.bag_expansion import CHUNK_HEAD, CHUNK_OPCODE
from slamgym.interop.bag_topics import BAG_SUFFIXES

Expand = Callable[[str, bytes], bytes]
"""Expands data by the name of a compression, within the limits."""

MCAP_MAGIC = b"\x89MCAP0\r\n"
MCAP_DATA = range(0x03, 0x0F)
"""Codes of the records that hold data."""
MCAP_END = struct.pack("<BQI", 0x0F, 4, 0) + struct.pack("<BQQQI", 0x02, 20, 0, 0, 0) + MCAP_MAGIC
"""End of the data, and a footer without a summary: the library looks through the file then."""
ROS1_MAGIC = b"#ROSBAG V2.0\n"
BAG_HEADER, INDEX, CHUNK, CHUNK_INFO, CONNECTION = 3, 4, 5, 6, 7
"""Codes of a ROS 1 bag's records."""
TABLES = {
    "topics": "id, name, type, serialization_format, offered_qos_profiles",
    "messages": "id, topic_id, timestamp, data",
}
"""Tables of a rosbag2's database, and their columns."""


class Remains(NamedTuple):
    """A bag of what is whole of another."""

    path: Path
    kept: int  # bytes; of a database those of the messages
    total: int  # bytes


def whole_part(bag: Path, folder: Path, expand: Expand) -> Remains | None:
    """Write what is whole of a bag into a folder; None where there is nothing, or the bag is of another kind.

    Args:
        bag: A ``.bag``, ``.mcap`` or ``.db3`` file, or a folder with one of them.
        folder: An empty one.
        expand: For the chunks of ROS 1 bags.

    Raises:
        InputFileError: If it expands beyond the limits.
    """
    files = sorted(bag.iterdir()) if bag.is_dir() else [bag]
    storages = [file for file in files if file.suffix in BAG_SUFFIXES]
    if len(storages) != 1:
        return None
    (storage,) = storages
    copy = folder / f"whole{storage.suffix}"
    total = storage.stat().st_size
    if storage.suffix == ".db3":
        kept = _copy_rows(storage, copy)
    else:
        copy_records = _copy_mcap if storage.suffix == ".mcap" else _copy_ros1
        with open_regular(storage) as source, copy.open("wb") as target:
            kept = copy_records(source, target, expand)
    return Remains(copy, min(kept, total), total) if kept else None


def _copy_mcap(source: BinaryIO, target: BinaryIO, expand: Expand) -> int:
    """Copy the whole records of an MCAP file, and end it; returns their bytes, 0 if there are none."""
    total = os.fstat(source.fileno()).st_size
    if source.read(8) != MCAP_MAGIC:
        return 0
    ends = [8]
    rest = b""
    while len(head := source.read(9)) == 9:
        code, size = struct.unpack("<BQ", head)
        if code == CHUNK_OPCODE:
            found = _rest_of_chunk(source.read(min(size, FILE_BYTES.value)), size, expand)
            if found is not None:
                rest = found
                break
        is_first = len(ends) == 1 and code == 0x01
        after = ends[-1] + 9 + size
        if (
            code == 0 and len(ends) > 1
        ):  # the disk has zeros here, maybe from within the record before
            ends.pop()
        if after > total or not (is_first or code in MCAP_DATA):
            break
        ends.append(after)
        source.seek(after)
    _copy_bytes(source, target, ends[-1])
    target.write(rest + MCAP_END)
    return ends[-1] + len(rest) if len(ends) > 2 or rest else 0


def _rest_of_chunk(record: bytes, size: int, expand: Expand) -> bytes | None:
    """The whole records of a chunk that isn't whole, none of a compressed one; None if it is whole.

    Args:
        record: The chunk, as far as it is there.
        size: Bytes that it should have.
        expand: For what is in it.
    """
    length = int.from_bytes(record[28:32], "little")
    compression = record[32 : 32 + length].decode(errors="replace")
    try:
        content = expand(compression, record[CHUNK_HEAD + length :])
    except InputFileError:
        raise
    except Exception:  # noqa: BLE001 - data that aren't whole make a decoder stumble anywhere
        return b""
    crc = int.from_bytes(record[24:28], "little")
    if len(record) == size and crc in (0, zlib.crc32(content)):
        return None
    if compression:
        return b""
    ends = [0, 0]
    while len(head := content[ends[-1] : ends[-1] + 9]) == 9:
        code, inner = struct.unpack("<BQ", head)
        after = ends[-1] + 9 + inner
        if code not in MCAP_DATA or after > len(content):
            break
        ends.append(after)
    return content[: ends[-2]]  # the last may hold zeros


def _copy_bytes(source: BinaryIO, target: BinaryIO, count: int) -> None:
    source.seek(0)
    shutil.copyfileobj(source, target)
    target.truncate(count)
    target.seek(count)


class _Record(NamedTuple):
    """A record of a ROS 1 bag."""

    fields: dict[bytes, bytes]
    data: bytes
    raw: bytes

    @property
    def code(self) -> int:
        """What it is; -1 if it doesn't say it."""
        return int.from_bytes(self.fields.get(b"op", b""), "little") if b"op" in self.fields else -1


class _Chunk(NamedTuple):
    """A chunk with its index."""

    place: int  # in the file
    times: list[tuple[int, int]]  # [s], [ns] of its messages
    counts: dict[bytes, int]  # messages of each connection


def _copy_ros1(source: BinaryIO, target: BinaryIO, expand: Expand) -> int:
    """Copy the whole chunks of a ROS 1 bag, and index them; returns their bytes, 0 if there are none."""
    if source.read(len(ROS1_MAGIC)) != ROS1_MAGIC:
        return 0
    end = first = len(ROS1_MAGIC)
    header = b""
    chunks: list[_Chunk] = []
    connections: dict[bytes, bytes] = {}
    for place, record in _records(source):
        if record.code == BAG_HEADER:
            header = record.raw
        elif record.code == CHUNK:
            compression = record.fields[b"compression"].decode(errors="replace")
            try:
                connections |= _connections(expand(compression, record.data))
            except InputFileError:
                raise
            except Exception:  # noqa: BLE001 - as in an MCAP file
                break
            chunks.append(_Chunk(place, [], {}))
        elif record.code == INDEX and chunks:
            number = record.fields[b"conn"]
            chunks[-1].counts[number] = len(record.data) // 12
            chunks[-1].times.extend(
                tuple(time[:2]) for time in struct.iter_unpack("<III", record.data)
            )
        else:  # the file's own index, or nothing more
            break
        end = place + len(record.raw)
    indexed = [chunk for chunk in chunks if chunk.counts]
    if not header or not indexed or not connections:
        return 0
    _copy_bytes(source, target, end)
    for raw in connections.values():
        target.write(raw)
    for chunk in indexed:
        target.write(_chunk_info(chunk))
    for name, value in (
        (b"index_pos=", struct.pack("<Q", end)),
        (b"conn_count=", struct.pack("<I", len(connections))),
        (b"chunk_count=", struct.pack("<I", len(indexed))),
    ):
        at = header.index(name) + len(name)
        header = header[:at] + value + header[at + len(value) :]
    target.seek(first)
    target.write(header)
    return end


def _records(stream: BinaryIO) -> Iterator[tuple[int, _Record]]:
    """Place and content of each whole record from here on."""
    while True:
        place = stream.tell()
        head = _sized(stream)
        data = None if head is None else _sized(stream)
        if head is None or data is None or not head:
            return
        after = stream.tell()
        raw = struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data
        yield place, _Record(dict(_fields(head)), data, raw)
        stream.seek(after)


def _sized(stream: BinaryIO) -> bytes | None:
    """Bytes behind their number; None where they aren't whole."""
    head = stream.read(4)
    if len(head) < 4:
        return None
    size = int.from_bytes(head, "little")
    data = stream.read(min(size, FILE_BYTES.value))
    return data if len(data) == size else None


def _fields(head: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Names and values of a record's head, as far as they are whole."""
    at = 0
    while at + 4 <= len(head):
        size = int.from_bytes(head[at : at + 4], "little")
        name, _, value = head[at + 4 : at + 4 + size].partition(b"=")
        yield name, value
        at += 4 + size


def _connections(content: bytes) -> dict[bytes, bytes]:
    """The connections that a chunk declares, by their numbers."""
    return {
        record.fields[b"conn"]: record.raw
        for _, record in _records(io.BytesIO(content))
        if record.code == CONNECTION
    }


def _chunk_info(chunk: _Chunk) -> bytes:
    """The record that says what is in a chunk."""
    fields = [
        b"op=" + bytes([CHUNK_INFO]),
        b"ver=" + struct.pack("<I", 1),
        b"chunk_pos=" + struct.pack("<Q", chunk.place),
        b"start_time=" + struct.pack("<II", *min(chunk.times)),
        b"end_time=" + struct.pack("<II", *max(chunk.times)),
        b"count=" + struct.pack("<I", len(chunk.counts)),
    ]
    head = b"".join(struct.pack("<I", len(field)) + field for field in fields)
    data = b"".join(number + struct.pack("<I", count) for number, count in chunk.counts.items())
    return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data


def _copy_rows(source: Path, target: Path) -> int:
    """Copy the rows of a rosbag2's database until one can't be read; returns the bytes of its messages."""
    kept = 0
    with (
        contextlib.closing(
            sqlite3.connect(f"{source.resolve().as_uri()}?immutable=1", uri=True)
        ) as old,
        contextlib.closing(sqlite3.connect(target)) as new,
    ):
        old.execute("PRAGMA writable_schema=ON")  # else a file that is too short isn't opened
        for table, columns in TABLES.items():
            new.execute(f"CREATE TABLE {table} ({columns})")
            marks = ", ".join("?" for _ in columns.split(","))
            with contextlib.suppress(sqlite3.DatabaseError):
                for row in old.execute(f"SELECT {columns} FROM {table} ORDER BY rowid"):
                    new.execute(f"INSERT INTO {table} VALUES ({marks})", row)
                    kept += len(row[-1] or b"") if table == "messages" else 0
        new.commit()
    return kept
