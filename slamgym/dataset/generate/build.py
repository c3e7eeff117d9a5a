"""The main path of ``slamgym generate``: floor plans in, a folder of map pairs out.

:func:`schedule_groups` is the endless sequence of explorations, a pure function of the dataset's seed;
:class:`SlotQueue` takes from it what a run has to make. Nothing in the sequence depends on how many pairs are asked
for, how many workers there are or in which order they finish, so an interrupted, resumed or extended dataset is the
same dataset.
"""

import contextlib
import functools
import itertools
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from slamgym.cad import FloorPlan, PlanGroup, PlanSource, check_plan, plan_groups
from slamgym.cad.plan_filter import passes, usual_reason
from slamgym.core.errors import PlanError, SlamgymError
from slamgym.core.names import exploration_seed, shuffled
from slamgym.core.parallel.backlog import Lost, tried
from slamgym.core.parallel.engine import Execution, try_out
from slamgym.core.progress import show_progress
from slamgym.dataset.folder import DatasetFolder, open_dataset
from slamgym.dataset.format import WHOLE, Shard
from slamgym.dataset.generate.exploration import (
    ExplorationOutcome,
    ExplorationTask,
    run_exploration,
    write_files,
)
from slamgym.dataset.generate.recipe import DatasetConfig, dataset_settings
from slamgym.dataset.record import Slot
from slamgym.envs.episode import MakeExplorer, check_explorer
from slamgym.envs.warmup import compile_for


def schedule_groups(
    groups: Sequence[PlanGroup], seed: int, trajectories: int = 1
) -> Iterator[Slot]:
    """Go through the plans of several sources at once, each as often as its weight says.

    The sources take turns as evenly as their weights allow (smooth weighted round robin), so that every
    beginning of the sequence has their proportions. Within a source the order is shuffled, over and over.

    Args:
        groups: The plans.
        seed: Of the order and of the explorations.
        trajectories: How many explorations of a plan come one after the other.
    """
    total = sum(group.weight for group in groups)
    credits = [0.0] * len(groups)
    turns = []
    for number, group in enumerate(groups):
        of_group = (seed, number) if number else seed
        turns.append(_rounds(group.ids, of_group))
    index = 0
    while True:
        credits = [credit + group.weight for credit, group in zip(credits, groups, strict=True)]
        chosen = credits.index(max(credits))
        credits[chosen] -= total
        plan_id, turn = next(turns[chosen])
        for repetition in range(turn * trajectories, (turn + 1) * trajectories):
            yield Slot(index, plan_id, repetition, exploration_seed(seed, plan_id, repetition))
            index += 1


def _rounds(plan_ids: Sequence[str], seed: int | tuple[int, int]) -> Iterator[tuple[str, int]]:
    """The plans of one source in its order, and how often each came before."""
    order = shuffled(plan_ids, seed)
    for turn in itertools.count():
        for plan_id in order:
            yield plan_id, turn


class SlotQueue:
    """Draws explorations from the schedule until enough slots hold a pair or are being explored.

    A whole dataset has the first ``pairs`` slots that give a pair. The run of a shard can't know which of the
    other shards' plans can't be explored, so together they take the first ``pairs`` slots whose plan the
    filter lets through. Of these some fail; a run without shards adds afterwards what is missing.

    Args:
        folder: Where the pairs are kept.
        plans: The floor plans.
        config: The settings.
        make_explorer: Handed to the workers.
        pairs: How many pairs the whole dataset shall have.
        shard: Whose explorations to draw.
        shares_files: Whether the workers write into the folder.
    """

    def __init__(
        self,
        folder: DatasetFolder,
        plans: PlanSource,
        config: DatasetConfig,
        make_explorer: MakeExplorer,
        pairs: int,
        shard: Shard = WHOLE,
        *,
        shares_files: bool = True,
    ) -> None:
        self._folder = folder
        self._plans = plans
        self._config = config
        self._make_explorer = make_explorer
        self._slots = schedule_groups(plan_groups(plans), config.seed, config.trajectories)
        self._shard = shard
        self._shares_files = shares_files
        self._missing = pairs
        self._barren = 0
        self._chosen: set[str] = set()
        self._unfit: dict[str, str | None] = {}
        """Why plans can't be explored; None: the filter omits them, which is no fault."""

    def wants_more(self) -> bool:
        """True if slots are still missing."""
        return self._missing > 0

    def draw(self) -> Iterator[ExplorationTask]:
        """Yield the explorations to run; after a rejection it continues with the next slot."""
        while self._missing > 0:
            slot = next(self._slots)
            is_committed = slot.index in self._folder.committed
            is_rejected = slot.index in self._folder.rejected
            plan = None
            if not is_committed and not is_rejected and self._shard.owns(slot.index):
                plan = self._fit_plan(slot)
            if is_committed or self._counts(slot, plan):
                self._missing -= 1
                self._barren = 0
            else:
                self._note_barren()
            if plan is not None:
                staged = self._folder.stage(slot.name) if self._shares_files else None
                yield ExplorationTask(slot, plan, staged, self._config, self._make_explorer)

    def reject(self, slot: Slot, error: str, reason: str) -> None:
        """Note that a slot gives no pair; in a whole dataset another one takes its place."""
        self._folder.reject(slot, error, reason)
        if self._shard == WHOLE:
            self._missing += 1
            self._note_barren()

    def _counts(self, slot: Slot, plan: FloorPlan | None) -> bool:
        """True if a slot without a pair is one of the slots to fill.

        Args:
            slot: The slot.
            plan: Its plan, if it is to be explored in this run.
        """
        if self._shard == WHOLE:
            return plan is not None
        return self._is_chosen(slot.plan_id)

    def _is_chosen(self, plan_id: str) -> bool:
        """True if a plan can be read and passes the filter: the quick part of the judgement, made once each."""
        if plan_id not in self._chosen and plan_id not in self._unfit:
            self._read(plan_id)
        return plan_id in self._chosen

    def _read(self, plan_id: str) -> FloorPlan | None:
        """The plan if the filter lets it through; else it is noted why not."""
        try:
            plan = self._plans.load(plan_id)
        except PlanError as error:
            self._unfit[plan_id] = error.reason
            return None
        if not passes(plan, self._config.plans_filter):
            self._unfit[plan_id] = None
            return None
        self._chosen.add(plan_id)
        return plan

    def _fit_plan(self, slot: Slot) -> FloorPlan | None:
        """The plan of a slot; None if it can't be explored, with a note of the reason unless the filter is it."""
        plan_id = slot.plan_id
        plan = None if plan_id in self._unfit else self._read(plan_id)
        if plan is not None:
            try:
                env = self._config.episode.env
                check_plan(plan, env.robot.radius, env.observation.largest_extent)
            except PlanError as error:
                self._unfit[plan_id] = error.reason
            else:
                return plan
        reason = self._unfit[plan_id]
        if reason is not None:
            self._folder.reject(slot, "PlanError", reason)
        return None

    def _note_barren(self) -> None:
        self._barren += 1
        if self._barren >= max(len(self._plans), 1) * self._config.trajectories:
            omitted = f"--plans-filter {self._config.plans_filter} omits it"
            reasons = [reason or omitted for reason in self._unfit.values()]
            why = f"; {usual_reason(reasons)}" if reasons else ""
            raise SlamgymError(
                f"no plan gave a pair (of {len(self._plans):,}){why}; {self._folder.layout.rejected} says more"
            )


@dataclass(frozen=True)
class BuildReport:
    """Result of a run of :func:`build_dataset`."""

    root: Path
    """The folder: that of the shard, if there is one."""
    pairs: int
    """Pairs in the folder now."""
    fresh: int
    """Pairs that this run added."""
    rejected: dict[str, int]
    """Number of plans that gave no pair, by the kind of error; see ``rejected.jsonl``."""
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

    Pairs that are there already are kept; a run that was interrupted continues where it stopped. The content
    depends on the plans and the settings alone, not on the number of workers or on interruptions.

    Args:
        root: The dataset's folder; made if it is missing. A shard has a separate folder below it.
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
        before = len(folder.committed)
        wanted = shard.share_of(pairs)
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
