"""A part of a dataset that one of several independent runs makes."""

import re
from dataclasses import dataclass
from pathlib import Path

from slamgym.core.errors import ConfigError

FOLDER = re.compile(r"shard-([0-9]{5,7})-of-([0-9]{5,7})")
"""Names of the shards' folders."""


@dataclass(frozen=True)
class Shard:
    """Shard ``number`` of ``count``: the slots whose index leaves the remainder ``number``.

    Neighbouring slots go to different shards, so that all have the same mix of plans and sources.
    """

    number: int
    count: int

    def __post_init__(self) -> None:
        if not 0 <= self.number < self.count:
            raise ConfigError(
                f"--shard {self.number}/{self.count}: of {self.count} shards the first is 0/{self.count} "
                f"and the last is {self.count - 1}/{self.count}"
            )

    @classmethod
    def parse(cls, text: str) -> "Shard":
        """Read ``i/n``.

        Raises:
            ConfigError: If the text is something else, or ``i`` is not between 0 and ``n - 1``.
        """
        match = re.fullmatch(r"([0-9]{1,7})/([0-9]{1,7})", text.strip())
        if match is None:
            raise ConfigError(f"--shard must look like 3/10 (the fourth of ten), not {text!r}")
        return cls(int(match[1]), int(match[2]))

    @property
    def folder_name(self) -> str:
        """Name of the shard's folder."""
        return f"shard-{self.number:05d}-of-{self.count:05d}"

    def owns(self, index: int) -> bool:
        """Whether a slot is the shard's."""
        return index % self.count == self.number

    def share_of(self, pairs: int) -> int:
        """How many of the first ``pairs`` slots are the shard's."""
        return len(range(self.number, pairs, self.count))


WHOLE = Shard(0, 1)
"""Of a dataset that is not divided."""


def is_shard_name(name: str) -> bool:
    """Whether a folder of this name holds a shard."""
    return FOLDER.fullmatch(name) is not None


def shard_folders(root: Path) -> list[Path]:
    """The shards' folders below a root, by name."""
    if not root.is_dir():
        return []
    return sorted(path for path in root.iterdir() if is_shard_name(path.name) and path.is_dir())
