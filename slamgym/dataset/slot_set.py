"""A set of slots that stays small however many there are."""

from collections.abc import Iterable, Iterator


class SlotSet:
    """A set of slot indices, one byte each: a million pairs take a megabyte, as names a hundred."""

    def __init__(self, indices: Iterable[int] = ()) -> None:
        self._flags = bytearray()
        self._count = 0
        for index in indices:
            self.add(index)

    def add(self, index: int) -> None:
        """Put an index in."""
        if index >= len(self._flags):
            self._flags.extend(bytes(max(index + 1 - len(self._flags), len(self._flags))))
        self._count += not self._flags[index]
        self._flags[index] = 1

    def discard(self, index: int) -> None:
        """Take an index out, if it is in."""
        if index in self:
            self._flags[index] = 0
            self._count -= 1

    def __contains__(self, index: int) -> bool:
        return index < len(self._flags) and self._flags[index] == 1

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[int]:
        """The indices in ascending order."""
        index = self._flags.find(1)
        while index >= 0:
            yield index
            index = self._flags.find(1, index + 1)
