"""Which floor plans a policy may learn from, and which are kept for testing it.

The split is a function of a plan's id alone, so it is the same whatever the archive, its order, or the
machine, and a plan that was once held out stays held out.
"""

import hashlib
from collections.abc import Iterable
from typing import Literal

from slamgym.cad.plan_index import PlanIndex, PlanSource, some_plans
from slamgym.core.config import suggest
from slamgym.core.errors import ConfigError

PlanSplit = Literal["train", "validation", "test"]
PLAN_SPLITS: tuple[PlanSplit, ...] = ("train", "validation", "test")

_FOLDS = 10  # one for the test, one for validation, the rest to learn from


def split_of(plan_id: str) -> PlanSplit:
    """The split of a plan: a tenth of all ids is ``"test"``, another tenth ``"validation"``.

    Args:
        plan_id: Name of the plan, as its source lists it.
    """
    fold = int.from_bytes(hashlib.sha256(plan_id.encode()).digest(), "big") % _FOLDS
    if fold == 0:
        return "test"
    return "validation" if fold == 1 else "train"


def ids_of(ids: Iterable[str], split: PlanSplit) -> list[str]:
    """The ids of a split, in the order given.

    Raises:
        ConfigError: If there is no split of that name.
    """
    if split not in PLAN_SPLITS:
        raise ConfigError(f"no split {split!r}; {suggest(split, PLAN_SPLITS)}")
    return [plan_id for plan_id in ids if split_of(plan_id) == split]


def split_plans(source: PlanSource, split: PlanSplit) -> PlanIndex:
    """The plans of a source that belong to a split.

    Args:
        source: Plans.
        split: Name of the split.

    Raises:
        ConfigError: If there is no split of that name, or the source has no plan in it.
    """
    ids = ids_of(source.ids, split)
    if not ids:
        raise ConfigError(
            f"none of the {len(source)} floor plans belongs to the split {split!r}; give more plans"
        )
    return some_plans(source, ids)
