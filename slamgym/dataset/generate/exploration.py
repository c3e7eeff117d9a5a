"""The task of a worker: one exploration, from the floor plan to the files of its pair.

Nothing here knows which engine runs it. Where the worker sees the dataset's folder it writes into the staging
place there; on another machine it gives the files back as bytes.
"""

import functools
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from slamgym.cad import FloorPlan
from slamgym.core.config import config_hash
from slamgym.core.files import storage_errors, sync_tree
from slamgym.dataset.folder import make_staging_place, stage_pair
from slamgym.dataset.format import write_episode
from slamgym.dataset.generate.recipe import DatasetConfig, episode_conditions
from slamgym.dataset.record import Slot, make_pair
from slamgym.envs.episode import MakeExplorer, run_episode
from slamgym.envs.team.episode import run_team_episode


@dataclass(frozen=True)
class ExplorationTask:
    """Input of a worker."""

    slot: Slot
    plan: FloorPlan
    staged: Path | None
    """Where to write the files; None to give them back."""
    config: DatasetConfig
    make_explorer: MakeExplorer


@dataclass(frozen=True)
class ExplorationOutcome:
    """Result that a worker reports."""

    slot: Slot
    timing: dict[str, Any] = field(default_factory=dict)
    files: Mapping[str, bytes] | None = None
    """Content by path below the staging place, unless the worker has written there itself."""


def run_exploration(exploration: ExplorationTask) -> ExplorationOutcome:
    """Run one exploration and write its pair.

    Raises:
        PlanError: If the plan can't be explored.
        SlamgymError: If a setting is wrong or the disk can't be written.
    """
    wall_before = time.perf_counter()
    cpu_before = time.process_time()
    files = _write_or_pack(exploration)
    cpu = time.process_time() - cpu_before
    wall = time.perf_counter() - wall_before
    timing = {"cpu_seconds": cpu, "wall_seconds": wall}
    return ExplorationOutcome(exploration.slot, timing, files)


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write what :func:`run_exploration` gave back into a new staging place, and wait until the disk has it."""
    with storage_errors(folder):
        make_staging_place(folder)
        for name, data in files.items():
            (folder / name).write_bytes(data)
        sync_tree(folder)


def _write_or_pack(exploration: ExplorationTask) -> dict[str, bytes] | None:
    if exploration.staged is not None:
        _write_pair(exploration, exploration.staged)
        with storage_errors(exploration.staged):
            sync_tree(exploration.staged)
        return None
    folder = Path(os.environ.get("TMPDIR", "/tmp"))
    with storage_errors(folder), TemporaryDirectory(prefix="slamgym-") as temporary:
        staged = Path(temporary) / exploration.slot.name
        _write_pair(exploration, staged)
        return {
            path.relative_to(staged).as_posix(): path.read_bytes()
            for path in sorted(staged.rglob("*"))
            if path.is_file()
        }


def _write_pair(exploration: ExplorationTask, staged: Path) -> None:
    slot = exploration.slot
    config = exploration.config
    settings, conditions = episode_conditions(config.recipe, config.episode, slot.seed)
    run = run_team_episode if settings.env.team.robots > 1 else run_episode
    episode = run(exploration.plan, slot.seed, settings, exploration.make_explorer)
    pair = make_pair(episode.plan, episode.start, episode.slam_map, config.pair)
    write = functools.partial(write_episode, episode=episode)
    stage_pair(staged, write, slot, episode.plan, pair, episode, conditions, config_hash(config))
