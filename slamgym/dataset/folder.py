"""A dataset folder that is being written: resumable, and consistent whenever the writing stops.

Workers write into ``.incoming``; the one process that holds the lock commits. A pair is part of the dataset
from the moment its folder appears in ``episodes`` (one rename); its two images are in place before that.
Files that a killed run has left behind are not part of the dataset; the next run removes them.

A worker's files are on the disk before they are renamed, but the renames themselves are synchronised only now
and then: after a power cut the last seconds' pairs may be missing, and none is torn.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slamgym.core.config import changed_settings
from slamgym.core.documents import parse_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import (
    append_line,
    drop_torn_line,
    exclusive_lock,
    own_folder,
    remove_leftovers,
    replace_file,
    replace_if_changed,
    storage_errors,
    sync_folder,
    text_lines,
)
from slamgym.core.pictures import encode_png
from slamgym.dataset.format import (
    SIDES,
    SUMS,
    FolderLayout,
    Layout,
    digest_lines,
    is_shard_name,
    read_object,
)
from slamgym.dataset.manifest_file import ManifestFile
from slamgym.dataset.record import MapPair, Outcome, Slot, make_record

if TYPE_CHECKING:
    from slamgym.cad import FloorPlan
    from slamgym.envs.episode import Episode

_OUR_NAME = re.compile(r"([0-9]{6,8})_[A-Za-z0-9_.-]+")  # below MAX_SLOTS
_INDEX_SHARE_OF_TIME = 0.02
"""The manifest is rewritten at most so often that it costs this share of the time."""


class DatasetFolder:
    """The writer's side of a dataset; use :func:`open_dataset` to get one."""

    def __init__(self, root: Path, incoming: Path) -> None:
        self.layout = Layout(root)
        self.incoming = incoming
        self.committed = self._scan()
        self.rejected: dict[int, dict[str, Any]] = read_rejected(self.layout.rejected)
        self._manifest = ManifestFile(self.layout.manifest)
        self._list_committed()
        self._next_index_time = time.monotonic()

    def stage(self, name: str) -> Path:
        """Where a worker may write a pair; a worker of a run that was killed finds no such place any more."""
        return self.incoming / name

    def commit(self, slot: Slot, staged: Path, timing: Mapping[str, Any]) -> None:
        """Make a staged pair (``A.png``, ``B.png`` and the folder ``episode``) part of the dataset."""
        layout = self.layout
        name = slot.name
        with storage_errors(layout.root):
            line = (staged / "episode" / "episode.json").read_bytes()
            for side in SIDES:
                (staged / f"{side}.png").replace(layout.image(side, name))
            (staged / "episode").rename(layout.episode(name))
            staged.rmdir()
            if timing:
                append_line(layout.timing, json.dumps({"name": name, **timing}) + "\n")
            self.committed.add(slot.index)
            self._manifest.add(slot.index, line)
        if time.monotonic() >= self._next_index_time:
            self.write_index()

    def reject(self, slot: Slot, error: str, reason: str) -> None:
        """Note that a plan could not be explored, and why."""
        self.rejected[slot.index] = {**asdict(slot), "error": error, "reason": reason}

    def write_index(self) -> None:
        """Write ``manifest.jsonl`` and ``rejected.jsonl`` as of now, in the order of the schedule."""
        began = time.monotonic()
        layout = self.layout
        with storage_errors(layout.root):
            for folder in (*(layout.root / side for side in SIDES), layout.episodes):
                sync_folder(folder)
            self._manifest.write()
            rejected = "".join(
                json.dumps(entry) + "\n" for _, entry in sorted(self.rejected.items())
            )
            if rejected or layout.rejected.exists():
                replace_if_changed(layout.rejected, rejected.encode())
        now = time.monotonic()
        self._next_index_time = now + max(5.0, (now - began) / _INDEX_SHARE_OF_TIME)

    def write_last_index(self) -> None:
        """Write the index after an interruption, from what lies in the folder.

        It may have come between a pair's last rename and the note of it.
        """
        self.committed = self._scan()
        self._list_committed()
        self.write_index()

    def _list_committed(self) -> None:
        missing = self.committed - self._manifest.listed
        names = {
            index: name for index, name in pair_names(self.layout.episodes) if index in missing
        }

        def read_line(index: int) -> bytes:
            return (self.layout.episode(names[index]) / "episode.json").read_bytes()

        self._manifest.agree_with(self.committed, read_line)

    def _scan(self) -> set[int]:
        """Find the committed pairs; remove what is not whole."""
        layout = self.layout
        folders = [layout.root / "A", layout.root / "B", layout.episodes]
        present = [{index for index, _ in pair_names(folder)} for folder in folders]
        whole = set.intersection(*present)
        for folder, indices in zip(folders, present, strict=True):
            if len(indices) > len(whole):
                for name in [name for index, name in pair_names(folder) if index not in whole]:
                    if folder == layout.episodes:
                        shutil.rmtree(folder / name)
                    else:
                        (folder / name).unlink()
        return whole


@contextmanager
def open_dataset(root: Path, settings: Mapping[str, Any]) -> Iterator[DatasetFolder]:
    """Lock a folder for writing, make it if need be, and clear away what a killed run left in it.

    Args:
        root: The folder.
        settings: What decides the content of the pairs, in JSON form; written to ``config.json``.

    Raises:
        ConfigError: If the folder holds a dataset made with other settings.
        StorageError: If the folder can't be written or another run is writing to it.
    """
    layout = Layout(root)
    with storage_errors(root):
        root.mkdir(parents=True, exist_ok=True)
    with exclusive_lock(layout.lock):
        # The settings first: by them a folder is known, however early the run is killed.
        claim_folder(layout.config, settings, "pairs", is_shard_name)
        for part in (layout.root / "A", layout.root / "B", layout.episodes):
            own_folder(part)
        with storage_errors(root):
            shutil.rmtree(layout.incoming, ignore_errors=True)
            own_folder(layout.incoming)
            incoming = Path(tempfile.mkdtemp(dir=layout.incoming))
            drop_torn_line(layout.timing)
            folder = DatasetFolder(root, incoming)
        try:
            yield folder
        except BaseException:
            folder.write_last_index()
            raise
        else:
            folder.write_index()
        finally:
            shutil.rmtree(layout.incoming, ignore_errors=True)


def make_staging_place(staged: Path) -> None:
    """Make the folders; not their parent, which is gone when the run that asked for the pair has ended."""
    if staged.exists():  # a worker died here before
        shutil.rmtree(staged)
    staged.mkdir()
    (staged / "episode").mkdir()


def stage_pair(
    staged: Path,
    write: Callable[[Path], None],
    slot: Slot,
    plan: FloorPlan,
    pair: MapPair,
    outcome: Outcome | Episode,
    conditions: Mapping[str, Any],
    settings_hash: str,
) -> None:
    """Write a pair where :meth:`DatasetFolder.commit` takes it from.

    Args:
        staged: The place.
        write: Writes the files of the exploration, but for digests and record, into an empty folder.
        slot: Its place in the schedule.
        plan: The building.
        pair: The images.
        outcome: How the map came about.
        conditions: The conditions of the exploration.
        settings_hash: Hash of the dataset's settings.

    Raises:
        StorageError: If a file can't be written.
    """
    files = {
        side: encode_png(image) for side, image in zip(SIDES, (pair.cad, pair.slam), strict=True)
    }
    with storage_errors(staged):
        make_staging_place(staged)
        for side, data in files.items():
            (staged / f"{side}.png").write_bytes(data)
        episode = staged / "episode"
        write(episode)
        files["episode"] = digest_lines(episode)
        (episode / SUMS).write_bytes(files["episode"])
        record = make_record(slot, plan, pair, outcome, files, conditions, settings_hash)
        (episode / "episode.json").write_bytes(record.to_line().encode())


def pair_names(folder: Path) -> Iterator[tuple[int, str]]:
    """Slot and name of what belongs to pairs; what a user put there is left alone."""
    if not folder.is_dir():
        return
    with os.scandir(folder) as entries:
        for entry in entries:
            match = _OUR_NAME.fullmatch(entry.name)
            if match is not None:
                yield int(match[1]), entry.name


def is_whole(layout: Layout, name: str) -> bool:
    """True if a pair has its two images and its record, all files: no links to what lies elsewhere, no devices."""
    folder = layout.episode(name)
    if folder.is_symlink() or not folder.is_dir():
        return False
    files = [
        *(layout.image(side, name) for side in SIDES),
        folder / "episode.json",
        *folder.iterdir(),
    ]
    return all(path.is_file() and not path.is_symlink() for path in files)


def read_rejected(path: Path) -> dict[int, dict[str, Any]]:
    """The entries of ``rejected.jsonl`` by slot.

    Raises:
        InputFileError: If it is malformed.
    """
    if not path.exists():
        return {}
    try:
        entries = [parse_json(line, where) for line, where in text_lines(path)]
        return {
            int(entry["index"]): entry | {name: str(entry[name]) for name in ("plan_id", "error")}
            for entry in entries
        }
    except (ValueError, KeyError, TypeError, OverflowError) as error:
        raise InputFileError(
            path, f"is malformed ({error}); delete it to have the plans tried again"
        ) from error


def read_times(path: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Name and times of each exploration, one by one, as far as ``timing.jsonl`` has them."""
    for line, where in text_lines(path) if path.is_file() else ():
        try:
            entry = parse_json(line, where)
            yield str(entry.pop("name")), {"cpu_seconds": float(entry.pop("cpu_seconds")), **entry}
        except (InputFileError, ValueError, KeyError, TypeError, AttributeError, OverflowError):
            continue  # a killed run may have cut a line off


def claim_folder(
    path: Path,
    settings: Mapping[str, Any],
    content: str,
    may_hold: Callable[[str], bool] = lambda _: False,
) -> None:
    """Write the settings into an empty folder, or find that it has them.

    Args:
        path: The file of the settings in the folder.
        settings: What decides the content, in JSON form.
        content: What the folder is for, in the plural: ``pairs``.
        may_hold: Decides by the name what else may lie in a folder without settings.

    Raises:
        ConfigError: If the folder has other settings, or holds something else.
        InputFileError: If its settings can't be read.
        StorageError: If it can't be written.
    """
    root = path.parent
    with storage_errors(root):
        remove_leftovers(path)
        remove_leftovers(FolderLayout(root).manifest)
        names = sorted(entry.name for entry in root.iterdir())
    if path.name not in names:
        unexpected = [
            name for name in names if name != FolderLayout(root).lock.name and not may_hold(name)
        ]
        if unexpected:
            raise ConfigError(
                f"{root}: holds {unexpected[0]} and no {content}; choose a new folder"
            )
        replace_file(path, (json.dumps(settings, indent=2) + "\n").encode())
        return
    as_written = json.loads(json.dumps(settings))
    changes = changed_settings(read_object(path), as_written)
    if changes:
        raise ConfigError(
            f"{root}: holds {content} made with other settings ({changes}); "
            "choose a new folder, or the same settings to go on"
        )
