"""Put the shards of a dataset together."""

import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slamgym.core.config import changed_settings
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import exclusive_lock, own_folder, read_text, storage_errors, sync_tree
from slamgym.core.progress import Advance, show_progress
from slamgym.dataset.folder import (
    DatasetFolder,
    is_whole,
    open_dataset,
    pair_names,
    read_rejected,
    read_times,
)
from slamgym.dataset.format import SHARD_NAME, SIDES, Layout, read_dataset_config, shard_folders
from slamgym.dataset.record import PairRecord


@dataclass(frozen=True)
class MergeReport:
    """Result of :func:`merge_shards`."""

    shards: int
    """Shards that were there."""
    missing: list[str]
    """Names of shards that should be there and are not."""
    broken: list[str]
    """Pairs of the shards that lack a file or hold a link, and were left out."""
    pairs: int
    """Pairs in the dataset now."""
    fresh: int
    """Pairs that were not in it before."""


def merge_shards(root: Path | str) -> MergeReport:
    """Make one dataset of the shards below a folder, in that folder.

    The files are linked where the file system can, else copied, and the shards are left as they are: a merge
    that is interrupted is simply run again, and so is one to which shards were added. Without shards missing
    and plans that could not be explored, the result is what a run without shards makes.

    Args:
        root: The folder that was given to ``slamgym generate --shard``.

    Raises:
        ConfigError: If there is no shard, or they were made with different settings.
        StorageError: If the folder can't be written, or a run is writing to it or to a shard.
        InputFileError: If a file of a shard is malformed.
    """
    root = Path(root)
    # A run that was killed at once has left a folder without anything in it.
    shards = [folder for folder in shard_folders(root) if Layout(folder).config.is_file()]
    if not shards:
        raise ConfigError(
            f"{root}: holds no shard; give the folder that `slamgym generate --shard` wrote to"
        )
    settings = _common_settings(shards)
    total = sum(1 for shard in shards for _ in pair_names(Layout(shard).episodes))
    with open_dataset(root, settings) as folder:
        before = len(folder.committed)
        broken: list[str] = []
        with show_progress("pairs", 0, total) as advance:
            for shard in shards:
                own_folder(shard)
                with exclusive_lock(Layout(shard).lock):
                    broken += _take_shard(folder, Layout(shard), advance)
        pairs = len(folder.committed)
    return MergeReport(len(shards), _missing_shards(shards), broken, pairs, pairs - before)


def _common_settings(shards: list[Path]) -> dict[str, Any]:
    first = read_dataset_config(shards[0])
    for shard in shards[1:]:
        changes = changed_settings(first, read_dataset_config(shard))
        if changes:
            raise ConfigError(
                f"{shard}: made with other settings than {shards[0].name} ({changes}); remove one"
            )
    return first


def _take_shard(folder: DatasetFolder, shard: Layout, advance: Advance) -> list[str]:
    """Put a shard's pairs into the dataset; returns the names of those that are not whole."""
    broken = []
    times = dict(read_times(shard.timing))
    for index, name in pair_names(shard.episodes):
        if index not in folder.committed:
            if is_whole(shard, name):
                _take_pair(folder, shard, name, times.get(name, {}))
            else:
                broken.append(name)
        advance()
    for index, entry in read_rejected(shard.rejected).items():
        folder.rejected.setdefault(index, entry)
    return broken


def _take_pair(folder: DatasetFolder, shard: Layout, name: str, times: dict[str, Any]) -> None:
    line = shard.episode(name) / "episode.json"
    record = PairRecord.from_line(read_text(line), str(line))
    if record.name != name or record.slot.name != name:
        raise InputFileError(
            line, f"is the record of {record.name!r}, not of its folder; take the pair out"
        )
    staged = folder.stage(name)
    files = {path: staged / "episode" / path.name for path in shard.episode(name).iterdir()}
    files |= {shard.image(side, name): staged / f"{side}.png" for side in SIDES}
    with storage_errors(folder.layout.root):
        (staged / "episode").mkdir(parents=True)
        linked = [_link_or_copy(source, target) for source, target in files.items()]
        if not all(linked):
            sync_tree(staged)
    folder.commit(record.slot, staged, times)


def _link_or_copy(source: Path, target: Path) -> bool:
    """Give a file a second name, or copy it; returns whether it is the same file."""
    try:
        os.link(source, target)
    except OSError:  # another file system, or one without links
        shutil.copyfile(source, target)
        return False
    return True


def _missing_shards(shards: list[Path]) -> list[str]:
    """Which shards of the same division are not there."""
    matches = [SHARD_NAME.fullmatch(shard.name) for shard in shards]
    divisions = [(int(match[1]), int(match[2])) for match in matches if match is not None]
    count = max(shards_of for _, shards_of in divisions)
    there = {number for number, shards_of in divisions if shards_of == count}
    return [f"{number}/{count}" for number in range(count) if number not in there]
