"""The main path of ``slamgym generate``: floor plans in, a folder of map pairs out."""

import contextlib
import functools
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from slamgym.cad import PlanSource
from slamgym.core.parallel.backlog import Lost, tried
from slamgym.core.parallel.engine import Execution, try_out
from slamgym.core.progress import show_progress
from slamgym.dataset.folder import DatasetFolder, open_dataset
from slamgym.dataset.generate.exploration import (
    ExplorationOutcome,
    ExplorationTask,
    run_exploration,
    write_files,
)
from slamgym.dataset.generate.recipe import DatasetConfig, dataset_settings
from slamgym.dataset.generate.schedule import SlotQueue
from slamgym.dataset.shard import WHOLE, Shard
from slamgym.envs.episode import MakeExplorer, check_explorer
from slamgym.envs.warmup import compile_for


@dataclass(frozen=True)
class BuildReport:
    """What a run of :func:`build_dataset` did."""

    root: Path
    """The folder: that of the shard, if there is one."""
    pairs: int
    """Pairs in the folder now."""
    fresh: int
    """Pairs that this run added."""
    rejected: dict[str, int]
    """How many plans gave no pair, by the kind of error; see ``rejected.jsonl``."""
    seconds: float
    """Wall time of this run [s]."""


def build_dataset(
    root: Path | str,
    plans: PlanSource,
    config: DatasetConfig,
    make_explorer: MakeExplorer,
    *,
    pairs: int,
    workers: int = 1,
    execution: Execution | None = None,
    shard: Shard = WHOLE,
) -> BuildReport:
    """Explore floor plans until the folder holds the wanted number of pairs.

    Pairs that are there already are kept; a run that was interrupted goes on where it stopped. The content
    depends on the plans and the settings alone, not on the number of workers or on interruptions.

    Args:
        root: The dataset's folder; made if it is missing. A shard has a folder of its own below it.
        plans: Where the floor plans come from.
        config: The settings.
        make_explorer: Makes the explorer of an exploration; a function that can be pickled by reference.
        pairs: How many pairs the folder shall hold; of a shard, how many the whole dataset shall hold.
        workers: Number of processes on this machine.
        execution: Other places to work in, instead of ``workers``.
        shard: The part of the dataset to make.

    Raises:
        ConfigError: If the folder holds pairs made with other settings, or the engine can't be started.
        StorageError: If the folder can't be written, or another run is writing to it.
        WorkerLostError: If worker after worker is killed.
        SlamgymError: If no plan at all can be explored.
    """
    began = time.monotonic()
    execution = execution or Execution(workers)
    root = Path(root) if shard == WHOLE else Path(root) / shard.folder_name
    explorers = config.recipe.values("explorer") or [config.episode.explorer]
    with contextlib.ExitStack() as stack:
        engine = stack.enter_context(execution.open())
        try_out(engine, functools.partial(check_explorer, config.episode, make_explorer), explorers)
        compile_for(config.episode.env, execution, is_varied=bool(config.recipe.factors))
        folder = stack.enter_context(open_dataset(root, dataset_settings(config, plans)))
        before, wanted = len(folder.committed), shard.share_of(pairs)
        queue = SlotQueue(
            folder, plans, config, make_explorer, pairs, shard, shares_files=engine.shares_files
        )
        with show_progress("pairs", min(before, wanted), wanted) as advance:
            while queue.wants_more():
                for outcome in engine.run(functools.partial(tried, run_exploration), queue.draw()):
                    if _take(outcome, folder, queue):
                        advance()
        committed = len(folder.committed)
        kinds = {entry["plan_id"]: entry["error"] for entry in folder.rejected.values()}
    seconds = time.monotonic() - began
    return BuildReport(root, committed, committed - before, dict(Counter(kinds.values())), seconds)


def _take(
    outcome: ExplorationOutcome | Lost[ExplorationTask], folder: DatasetFolder, queue: SlotQueue
) -> bool:
    """Commit what a worker made, or note why there is nothing; returns whether there is a pair."""
    if isinstance(outcome, Lost):
        queue.reject(outcome.item.slot, outcome.error, outcome.reason)
        return False
    staged = folder.stage(outcome.slot.name)
    if outcome.files is not None:
        write_files(staged, outcome.files)
    folder.commit(outcome.slot, staged, outcome.timing)
    return True
