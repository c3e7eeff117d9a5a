"""Which floor plans a policy may learn from, and which are kept for testing it.

The split is a function of a plan's id alone, so it doesn't depend on the archive, its order, or the
machine, and a plan that was once held out stays held out.
"""

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from typing import Literal

import numpy as np

from slamgym.cad import FloorPlan, check_plan, open_plans
from slamgym.cad.plan_filter import AREA, LONG_SIDE, passes
from slamgym.cad.plan_index import PlanSource
from slamgym.core.errors import ConfigError, PlanError
from slamgym.core.progress import Advance
from slamgym.sim import RobotConfig

PlanSplit = Literal["train", "validation", "test"]
"""Name of a split."""

_FOLDS = 10
"""One is for the test, one for validation, the rest to learn from."""


def split_of(plan_id: str) -> PlanSplit:
    """The split of a plan: a tenth of all ids is ``"test"``, another tenth ``"validation"``.

    Args:
        plan_id: Name of the plan, as its source lists it.
    """
    digest = hashlib.sha256(plan_id.encode()).digest()
    fold = int.from_bytes(digest, "big") % _FOLDS
    held_out: dict[int, PlanSplit] = {0: "test", 1: "validation"}
    return held_out.get(fold, "train")


def ids_of(ids: Iterable[str], split: PlanSplit) -> list[str]:
    """The ids of a split, in the order given."""
    return [plan_id for plan_id in ids if split_of(plan_id) == split]


def longest_side(largest_area: float) -> float:
    """Longest side of plans up to an area [m], in proportion to homes."""
    return LONG_SIDE * max(1.0, largest_area / AREA[1]) ** 0.5


def draw_plans(
    specs: Sequence[str],
    split: PlanSplit,
    count: int,
    seed: int = 0,
    largest_area: float = AREA[1],
    advance: Advance = lambda: None,
) -> list[FloorPlan]:
    """Draw plans that are worth exploring from a split of some sources, as many from each.

    Generated plans have to be of the size of homes too, which :func:`slamgym.cad.plan_filter.passes` asks of
    HouseExpo's alone, if nothing else is asked for.

    Args:
        specs: What :func:`slamgym.cad.open_plans` takes; one that is named twice gives twice as many.
        split: Of which split.
        count: How many in all; fewer if the sources have no more.
        seed: Of the draw.
        largest_area: Of a generated plan [m2].
        advance: Is called after each plan: a thousand generated ones take a minute.

    Raises:
        ConfigError: If none is left.
    """

    def is_of_size(plan: FloorPlan) -> bool:
        is_long = plan.extent > longest_side(largest_area)
        return AREA[0] <= plan.area <= largest_area and not is_long

    plans: dict[str, FloorPlan] = {}
    for number, spec in enumerate(specs):
        source = open_plans(spec)
        ids = ids_of(source.ids, split)
        wanted = (count * (number + 1)) // len(specs)
        order = np.random.default_rng(seed).permutation(len(ids)).tolist()
        for plan in explorable_plans(source, (ids[index] for index in order)):
            if len(plans) >= wanted:
                break
            if is_of_size(plan) and passes(plan, "useful"):
                plans[plan.id] = plan
                advance()
    if not plans:
        raise ConfigError(
            f"{', '.join(specs)}: no plan of the split {split!r} is worth exploring; give more"
        )
    return list(plans.values())


def explorable_plans(source: PlanSource, ids: Iterable[str]) -> Iterator[FloorPlan]:
    """The plans of some ids that the robot can explore, in their order."""
    for plan_id in ids:
        try:
            plan = source.load(plan_id)
            check_plan(plan, RobotConfig().radius)
        except PlanError:
            continue
        yield plan
