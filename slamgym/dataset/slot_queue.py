"""Which explorations a run has to make, drawn one at a time."""

from collections.abc import Iterator
from pathlib import Path

from slamgym.cad import FloorPlan, PlanSource, check_plan, plan_groups
from slamgym.dataset.episode import MakeExplorer
from slamgym.dataset.exploration import Exploration
from slamgym.dataset.folder import DatasetFolder
from slamgym.dataset.plan_filter import passes
from slamgym.dataset.schedule import Slot, schedule_groups
from slamgym.dataset.settings import DatasetConfig
from slamgym.dataset.shard import WHOLE, Shard
from slamgym.errors import PlanError, SlamgymError

_LEFT_OUT = ""
"""Verdict on a plan that the filter leaves out, which is no fault."""


class SlotQueue:
    """Draws explorations from the schedule until enough slots hold a pair or are being explored.

    A whole dataset has the first ``pairs`` slots that give a pair. The runs of its shards can't know of each
    other's explorations that fail, so together they take the first ``pairs`` slots whose plan is fit; a run
    without shards adds afterwards what is missing.

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
        self._unfit: dict[str, str] = {}

    def wants_more(self) -> bool:
        """Whether slots are still missing."""
        return self._missing > 0

    def draw(self) -> Iterator[Exploration]:
        """Yield the explorations to run; a rejection on the way makes it go on with the next slot."""
        while self._missing > 0:
            slot = next(self._slots)
            if slot.index in self._folder.committed:
                self._missing -= 1
                self._barren = 0
                continue
            if self._shard == WHOLE and slot.index in self._folder.rejected:
                self._note_barren()
                continue
            plan = self._load(slot)
            if plan is None:
                self._note_barren()
                continue
            self._missing -= 1
            self._barren = 0
            if self._shard.owns(slot.index) and slot.index not in self._folder.rejected:
                yield Exploration(slot, plan, self._staging_place(slot), self._config, self._make_explorer)

    def reject(self, slot: Slot, error: str, reason: str) -> None:
        """Note that a slot gives no pair; in a whole dataset another one takes its place."""
        self._folder.reject(slot, error, reason)
        if self._shard == WHOLE:
            self._missing += 1
            self._note_barren()

    def _staging_place(self, slot: Slot) -> Path | None:
        return self._folder.stage(slot.name) if self._shares_files else None

    def _load(self, slot: Slot) -> FloorPlan | None:
        """The plan, or None if it is unfit; each unfit plan is loaded once."""
        fault = self._unfit.get(slot.plan_id)
        if fault is None:
            try:
                plan = self._plans.load(slot.plan_id)
                check_plan(plan, self._config.episode.env.robot.radius)
            except PlanError as error:
                fault = error.reason
            else:
                if passes(plan, self._config.plans_filter):
                    return plan
                fault = _LEFT_OUT
            self._unfit[slot.plan_id] = fault
        if fault != _LEFT_OUT and self._shard.owns(slot.index):
            self._folder.reject(slot, "PlanError", fault)
        return None

    def _note_barren(self) -> None:
        self._barren += 1
        if self._barren >= max(len(self._plans), 1) * self._config.trajectories:
            raise SlamgymError(
                f"none of the {len(self._plans)} plans gave a pair; {self._folder.layout.rejected} says why, "
                "unless the filter leaves none"
            )
