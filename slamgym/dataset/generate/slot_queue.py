"""Which explorations a run has to make, drawn one at a time."""

from collections.abc import Iterator

from slamgym.cad import FloorPlan, PlanSource, check_plan, plan_groups
from slamgym.cad.plan_filter import passes
from slamgym.core.errors import PlanError, SlamgymError
from slamgym.dataset.folder import DatasetFolder
from slamgym.dataset.generate.exploration import Exploration
from slamgym.dataset.generate.settings import DatasetConfig
from slamgym.dataset.schedule import Slot, schedule_groups
from slamgym.dataset.shard import WHOLE, Shard
from slamgym.envs.episode import MakeExplorer

_LEFT_OUT = ""
"""Verdict on a plan that the filter leaves out, which is no fault."""


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
        self._faults: dict[str, str] = {}

    def wants_more(self) -> bool:
        """Whether slots are still missing."""
        return self._missing > 0

    def draw(self) -> Iterator[Exploration]:
        """Yield the explorations to run; a rejection on the way makes it go on with the next slot."""
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

    def _draw_of_shard(self, slot: Slot) -> Iterator[Exploration]:
        if not self._is_chosen(slot.plan_id):
            self._note_barren()
            if self._shard.owns(slot.index) and self._faults[slot.plan_id] != _LEFT_OUT:
                self._folder.reject(slot, "PlanError", self._faults[slot.plan_id])
            return
        self._count()
        if self._shard.owns(slot.index) and slot.index not in self._folder.rejected:
            plan = self._load_fit(slot)
            if plan is not None:
                yield self._exploration(slot, plan)

    def _count(self) -> None:
        self._missing -= 1
        self._barren = 0

    def _exploration(self, slot: Slot, plan: FloorPlan) -> Exploration:
        staged = self._folder.stage(slot.name) if self._shares_files else None
        return Exploration(slot, plan, staged, self._config, self._make_explorer)

    def reject(self, slot: Slot, error: str, reason: str) -> None:
        """Note that a slot gives no pair; in a whole dataset another one takes its place."""
        self._folder.reject(slot, error, reason)
        if self._shard == WHOLE:
            self._missing += 1
            self._note_barren()

    def _is_chosen(self, plan_id: str) -> bool:
        """Whether a plan can be read and passes the filter: the quick part of the judgement, made once each."""
        if plan_id not in self._chosen and plan_id not in self._faults:
            self._read(plan_id)
        return plan_id in self._chosen

    def _read(self, plan_id: str) -> FloorPlan | None:
        """The plan if the filter lets it through; else a fault is noted."""
        try:
            plan = self._plans.load(plan_id)
        except PlanError as error:
            self._faults[plan_id] = error.reason
            return None
        if not passes(plan, self._config.plans_filter):
            self._faults[plan_id] = _LEFT_OUT
            return None
        self._chosen.add(plan_id)
        return plan

    def _load_fit(self, slot: Slot) -> FloorPlan | None:
        """The plan of a slot, or None if it can't be explored, with a note of the reason."""
        plan_id, plan = slot.plan_id, None
        if plan_id not in self._faults and (plan := self._read(plan_id)) is not None:
            try:
                check_plan(plan, self._config.episode.env.robot.radius)
            except PlanError as error:
                self._faults[plan_id] = error.reason
        fault = self._faults.get(plan_id)
        if fault is None:
            return plan
        if fault != _LEFT_OUT:
            self._folder.reject(slot, "PlanError", fault)
        return None

    def _note_barren(self) -> None:
        self._barren += 1
        if self._barren >= max(len(self._plans), 1) * self._config.trajectories:
            raise SlamgymError(
                f"none of the {len(self._plans)} plans gave a pair; {self._folder.layout.rejected} says why, "
                "unless the filter leaves none"
            )
