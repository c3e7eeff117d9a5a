"""``manifest.jsonl`` while pairs are being added: always whole, always in the order of the slots.

Rewriting it from the pairs' own files would cost the more, the more there are. So the lines of fresh pairs
are kept until they are merged into the file, whose other lines are copied as they stand.
"""

import heapq
import re
from collections.abc import Callable, Iterator
from operator import itemgetter
from pathlib import Path

from slamgym.core.errors import InputFileError
from slamgym.core.files import byte_lines, replace_file

MOST_FRESH_LINES = 20_000
"""Fresh lines that are kept in memory, 2 kB each."""

_NAME = re.compile(rb'\{"name": "([0-9]{6,8})_')


class ManifestFile:
    """The writer's side of a manifest."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._fresh: dict[int, bytes] = {}
        self._is_stale = False
        self.listed: set[int] = set()
        """Slots of the pairs that the file will list when it is written."""
        try:
            self.listed = {index for index, _ in self._lines()}
        except (
            ValueError,
            InputFileError,
        ):  # it was edited; the pairs' own files say what belongs there
            path.unlink()

    def agree_with(self, committed: set[int], read_line: Callable[[int], bytes]) -> None:
        """List the committed pairs and no others.

        Args:
            committed: The slots of the pairs.
            read_line: Gives the line of one that is not listed yet.
        """
        self._is_stale |= not self.listed <= committed
        self.listed &= committed
        self._fresh = {index: line for index, line in self._fresh.items() if index in committed}
        for index in sorted(committed - self.listed):
            self.add(index, read_line(index))

    def add(self, index: int, line: bytes) -> None:
        """Note the line of a fresh pair."""
        self._fresh[index] = line
        self.listed.add(index)
        if len(self._fresh) >= MOST_FRESH_LINES:
            self.write()

    def write(self) -> None:
        """Merge the fresh lines into the file."""
        if not self._fresh and not self._is_stale and self._path.exists():
            return
        # What is not listed any more, or is to be replaced, is left out.
        kept = (
            entry
            for entry in self._lines()
            if entry[0] in self.listed and entry[0] not in self._fresh
        )
        merged = heapq.merge(kept, sorted(self._fresh.items()), key=itemgetter(0))
        replace_file(self._path, map(itemgetter(1), merged))
        self._fresh.clear()
        self._is_stale = False

    def _lines(self) -> Iterator[tuple[int, bytes]]:
        """The slots and lines of the file.

        Raises:
            ValueError: If a line is no record, or they are out of order.
            InputFileError: If it can't be read, or a line is too long.
        """
        if not self._path.exists():
            return
        last = -1
        for line, _ in byte_lines(self._path):
            index = _index_of(line)
            if index <= last:
                raise ValueError(f"line of slot {index} after that of {last}")
            last = index
            yield index, line


def _index_of(line: bytes) -> int:
    match = _NAME.match(line)
    if match is None or not line.endswith(b"\n"):
        raise ValueError("a line is no record, or not whole")
    return int(match[1])
