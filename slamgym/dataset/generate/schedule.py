"""Which plan is explored when, and with which seed: a pure function of the dataset's seed.

:func:`schedule` is the endless sequence; :class:`SlotQueue` takes from it what a run has to make. Nothing in the
sequence depends on how many pairs are asked for, how many workers there are or in which order they finish, so an
interrupted, resumed or extended dataset is the same dataset.
"""

import itertools
from collections.abc import Iterator, Sequence

from slamgym.cad import FloorPlan, PlanGroup, PlanSource, check_plan, plan_groups
from slamgym.cad.plan_filter import passes
from slamgym.core.errors import PlanError, SlamgymError
from slamgym.core.seeding import exploration_seed, shuffled
from slamgym.dataset.folder import DatasetFolder
from slamgym.dataset.generate.exploration import ExplorationTask
from slamgym.dataset.generate.recipe import DatasetConfig
from slamgym.dataset.record import Slot
from slamgym.dataset.shard import WHOLE, Shard
from slamgym.envs.episode import MakeExplorer


def schedule(plan_ids: Sequence[str], seed: int, trajectories: int = 1) -> Iterator[Slot]:
    """Go through the plans in a shuffled order, over and over, without end.

    Args:
        plan_ids: The plans.
        seed: Of the order and of the explorations.
        trajectories: How many explorations of a plan come one after the other.
    """
    return schedule_groups([PlanGroup(plan_ids, 1.0)], seed, trajectories)


def schedule_groups(groups: Sequence[PlanGroup], seed: int, trajectories: int = 1) -> Iterator[Slot]:
    """Go through the plans of several sources at once, each as often as its weight says.

    The sources take turns as evenly as their weights allow (smooth weighted round robin), so that every
    beginning of the sequence has their proportions. Within a source the order is shuffled.
    """
    total = sum(group.weight for group in groups)
    credits = [0.0] * len(groups)
    turns = [_rounds(group.ids, (seed, number) if number else seed) for number, group in enumerate(groups)]
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
    return ((plan_id, turn) for turn in itertools.count() for plan_id in order)


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
        self._folder, self._plans, self._config, self._make_explorer = folder, plans, config, make_explorer
        self._slots = schedule_groups(plan_groups(plans), config.seed, config.trajectories)
        self._shard, self._shares_files = shard, shares_files
        self._missing = pairs
        self._barren = 0
        self._chosen: set[str] = set()
        self._unfit: dict[str, str | None] = {}
        """Why plans can't be explored; None: the filter leaves them out, which is no fault."""

    def wants_more(self) -> bool:
        """Whether slots are still missing."""
        return self._missing > 0

    def draw(self) -> Iterator[ExplorationTask]:
        """Yield the explorations to run; after a rejection it goes on with the next slot."""
        while self._missing > 0:
            slot = next(self._slots)
            if slot.index in self._folder.committed:
                self._count()
            elif self._shard != WHOLE:
                yield from self._draw_of_shard(slot)
            elif slot.index in self._folder.rejected or (plan := self._load_fit(slot)) is None:
                self._note_barren()
            else:
                self._count()
                yield self._exploration(slot, plan)

    def _draw_of_shard(self, slot: Slot) -> Iterator[ExplorationTask]:
        if not self._is_chosen(slot.plan_id):
            self._note_barren()
            if self._shard.owns(slot.index):
                self._reject_unfit(slot)
            return
        self._count()
        if self._shard.owns(slot.index) and slot.index not in self._folder.rejected:
            plan = self._load_fit(slot)
            if plan is not None:
                yield self._exploration(slot, plan)

    def _count(self) -> None:
        self._missing -= 1
        self._barren = 0

    def _exploration(self, slot: Slot, plan: FloorPlan) -> ExplorationTask:
        staged = self._folder.stage(slot.name) if self._shares_files else None
        return ExplorationTask(slot, plan, staged, self._config, self._make_explorer)

    def reject(self, slot: Slot, error: str, reason: str) -> None:
        """Note that a slot gives no pair; in a whole dataset another one takes its place."""
        self._folder.reject(slot, error, reason)
        if self._shard == WHOLE:
            self._missing += 1
            self._note_barren()

    def _is_chosen(self, plan_id: str) -> bool:
        """Whether a plan can be read and passes the filter: the quick part of the judgement, made once each."""
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

    def _load_fit(self, slot: Slot) -> FloorPlan | None:
        """The plan of a slot, or None if it can't be explored, with a note of the reason."""
        plan_id, plan = slot.plan_id, None
        if plan_id not in self._unfit and (plan := self._read(plan_id)) is not None:
            try:
                env = self._config.episode.env
                check_plan(plan, env.robot.radius, env.observation.largest_extent)
            except PlanError as error:
                self._unfit[plan_id] = error.reason
        if plan_id in self._unfit:
            self._reject_unfit(slot)
            return None
        return plan

    def _reject_unfit(self, slot: Slot) -> None:
        """Note why the plan of a slot can't be explored, unless the filter leaves it out."""
        reason = self._unfit[slot.plan_id]
        if reason is not None:
            self._folder.reject(slot, "PlanError", reason)

    def _note_barren(self) -> None:
        self._barren += 1
        if self._barren >= max(len(self._plans), 1) * self._config.trajectories:
            raise SlamgymError(
                f"no plan gave a pair (of {len(self._plans)}); {self._folder.layout.rejected} says why, "
                "unless the filter leaves none"
            )
