"""Compressed bags, expanded within the limits: ``rosbags`` expands a file, a chunk or a message at once, of any size.

The sizes that a bag declares are the writer's word, so what is expanded is counted piece by piece.
"""

import bz2
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

from slamgym.core.files import open_regular
from slamgym.core.limits import EXPANSION, EXPANSION_FROM, FILE_BYTES
from slamgym.core.streams import check_expansion

CHUNK_OPCODE = 0x06
"""Of a chunk among the records of an MCAP file (https://mcap.dev/spec)."""
CHUNK_HEAD = 40
"""Bytes of a chunk before its data, without the name of its compression."""


class Expansion:
    """Counts what the compressed parts of a bag expand to.

    Args:
        where: The bag, for errors.
        rosbags: The library.
    """

    def __init__(self, where: Path, rosbags: Any) -> None:
        import lz4.frame

        self._where = where
        self._compressed = 0  # bytes
        self._expanded = 0  # bytes that they became
        self._zstd = rosbags.rosbag2.reader.zstd
        self._names = {make: name for name, make in rosbags.rosbag1.reader.decompressors.items()}
        self._makers: dict[str, Callable[[], Any]] = {
            "bz2": bz2.BZ2Decompressor,
            "lz4": lz4.frame.LZ4FrameDecompressor,
            "zstd": self._zstd.ZstdDecompressor,
        }

    def check(self, path: Path) -> None:
        """Measure what the library expands as soon as it opens a bag.

        Raises:
            InputFileError: If it is too large.
        """
        if path.is_dir():
            for storage in sorted(path.glob("*.zstd")):
                check_expansion(storage, self._zstd.open)
        elif path.suffix == ".mcap":
            with open_regular(path) as file:
                for compression, data in _mcap_chunks(file):
                    self._measure(compression, data)

    def messages(self, reader: Any, connections: list[Any]) -> Iterator[tuple[Any, int, bytes]]:
        """Connection, time [ns] and content of each message of some connections.

        Args:
            reader: An open reader of the library, for any kind of bag.
            connections: Of it.

        Raises:
            InputFileError: If the bag expands beyond the limits.
        """
        storages = [getattr(each, "storage", each) for each in reader.readers]
        are_compressed = [self._guard(storage) for storage in storages]
        for connection, stamp_ns, data in reader.messages(connections=connections):
            content = self.expanded("zstd", data) if any(are_compressed) else data
            yield connection, stamp_ns, content

    def _guard(self, storage: Any) -> bool:
        """Let a bag expand no more than is allowed; true if its messages are compressed, which are left as they are."""
        if hasattr(storage, "chunk_infos"):  # ROS 1
            for place, chunk in storage.chunks.items():
                name = self._names[chunk.decompressor]
                if name in self._makers:
                    expand = partial(self.expanded, name)
                    storage.chunks[place] = chunk._replace(decompressor=expand)
            return False
        for part in getattr(storage, "storages", [storage]):
            for chunk in getattr(part, "chunks", ()):
                part.bio.seek(chunk.chunk_start_offset + 9 + CHUNK_HEAD + len(chunk.compression))
                self._measure(chunk.compression, part.bio.read(chunk.compressed_size))
        if storage.metadata.compression_mode != "message":
            return False
        storage.metadata = storage.metadata._replace(compression_mode=None)
        return True

    def expanded(self, compression: str, data: bytes) -> bytes:
        """The content of a chunk or message, compressed or not.

        Raises:
            InputFileError: If the bag expands beyond the limits.
        """
        if compression not in self._makers:
            return data
        return b"".join(self._pieces(compression, data))

    def _measure(self, compression: str, data: bytes) -> None:
        if compression in self._makers:
            for _ in self._pieces(compression, data):
                pass

    def _pieces(self, compression: str, data: bytes) -> Iterator[bytes]:
        self._compressed += len(data)
        while data:  # several streams may follow each other
            decompressor = self._makers[compression]()
            while not decompressor.eof:
                piece = decompressor.decompress(data, EXPANSION_FROM)
                data = b""
                self._count(len(piece))
                yield piece
                if decompressor.needs_input and not decompressor.eof:
                    raise EOFError("the compressed data end too soon")
            data = decompressor.unused_data or b""

    def _count(self, expanded: int) -> None:
        self._expanded += expanded
        FILE_BYTES.check(self._where, self._expanded)
        if self._expanded > EXPANSION_FROM:
            EXPANSION.check(self._where, self._expanded // max(self._compressed, 1))


def _mcap_chunks(file: BinaryIO) -> Iterator[tuple[str, bytes]]:
    """Compression and data of all chunks among the records of an MCAP file, as far as it is whole."""
    file.seek(8)
    while len(head := file.read(9)) == 9:
        size = int.from_bytes(head[1:], "little")
        if head[0] != CHUNK_OPCODE:
            file.seek(min(size, FILE_BYTES.value), 1)
            continue
        record = file.read(min(size, FILE_BYTES.value))
        length = int.from_bytes(record[28:32], "little")
        compression = record[32 : 32 + length].decode(errors="replace")
        yield compression, record[CHUNK_HEAD + length :]
