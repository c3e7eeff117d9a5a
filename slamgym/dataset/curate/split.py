"""Which plans are for training and which for testing: by plan, with near-duplicates on one side.

A group's side follows from the dataset's split seed and the first plan of the group in the order of the
schedule. So the same dataset always splits the same way, and when a dataset grows, plans that were there keep
their sides (unless a new plan joins two groups into one).

Plans are compared without their size: in images that are scaled to fit, a building looks like a larger one of the same
form.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from slamgym.core.config import from_dict, suggest, to_dict
from slamgym.core.documents import json_text, read_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import replace_file
from slamgym.core.limits import FILE_BYTES
from slamgym.core.names import uniform_share
from slamgym.core.progress import show_progress
from slamgym.dataset.format import Layout, read_manifest
from slamgym.dataset.images.format import Split
from slamgym.dataset.record import PairRecord

SPLIT_VERSION = 2


@dataclass(frozen=True)
class PlanSide:
    """Where a plan belongs."""

    side: Split
    group: str
    """The first of the plans that look like this one; itself if there is no other."""


@dataclass(frozen=True)
class SplitTable:
    """The content of ``split.json``."""

    seed: int
    test: float
    """Share of the groups that are for testing."""
    plans: Mapping[str, PlanSide] = field(default_factory=dict)
    forced: tuple[str, ...] = ()
    """Plans that were asked for on the test side; their groups went with them."""
    split_version: int = SPLIT_VERSION

    def of_side(self, side: Split) -> list[str]:
        """The plans of one side."""
        return [plan_id for plan_id, place in self.plans.items() if place.side == side]

    @property
    def groups(self) -> int:
        """Number of groups."""
        return len({place.group for place in self.plans.values()})


def split_path(root: Path | str) -> Path:
    """Where a dataset's split lies."""
    return Path(root) / "split.json"


def make_split(
    root: Path | str, *, test: float = 0.1, seed: int = 0, forced: Collection[str] = ()
) -> SplitTable:
    """Split the plans of a dataset and write its ``split.json``.

    Args:
        root: The dataset.
        test: Share of the groups of plans that are for testing.
        seed: Another seed gives another split.
        forced: Plans that shall be on the test side.

    Raises:
        ConfigError: If the share is none, or a forced plan is not in the dataset.
        InputFileError: If a file of the dataset is missing or malformed.
    """
    from slamgym.cad import read_houseexpo
    from slamgym.dataset.curate.near_duplicates import near_duplicates, plan_print

    if not 0.0 <= test <= 1.0:
        raise ConfigError(f"the share of test plans must lie in [0, 1], not {test}")
    first: dict[str, PairRecord] = {}  # pair of each plan, in the order of the schedule
    for record in read_manifest(root):
        first.setdefault(record.plan_id, record)
    if not first:
        raise ConfigError(f"{root}: holds no pairs yet")
    unexpected = [plan_id for plan_id in forced if plan_id not in first]
    if unexpected:
        raise ConfigError(
            f"{root} has no pair of the plan {unexpected[0]!r}; {suggest(unexpected[0], list(first)[:1000])}"
        )
    layout = Layout(Path(root))
    prints = []
    with show_progress("plans compared", 0, len(first)) as advance:
        for record in first.values():
            plan = read_houseexpo(layout.episode(record.name) / "plan.json")
            prints.append(plan_print(plan))
            advance()
    ids = list(first)
    alike = near_duplicates(np.stack(prints))
    groups = {plan_id: ids[index] for plan_id, index in zip(ids, alike, strict=True)}
    table = assign_sides(groups, test=test, seed=seed, forced=forced)
    replace_file(split_path(root), json_text(to_dict(table)).encode())
    return table


def read_split(root: Path | str) -> SplitTable:
    """Read a dataset's ``split.json``.

    Raises:
        InputFileError: If it is missing, malformed or of another version.
    """
    path = split_path(root)
    content = read_json(path, "run `slamgym dataset split` again", FILE_BYTES)
    try:
        table = from_dict(SplitTable, content)
    except ConfigError as error:
        raise InputFileError(
            path, f"is malformed ({error}); run `slamgym dataset split` again"
        ) from error
    if table.split_version != SPLIT_VERSION:
        raise InputFileError(
            path, "is of another version of slamgym; run `slamgym dataset split` again"
        )
    return table


def current_split(root: Path | str) -> SplitTable:
    """The split of a dataset as it is now: made if there is none, made again by the same rule if plans were added.

    Raises:
        InputFileError: If a file of the dataset is missing or malformed.
    """
    if not split_path(root).is_file():
        return make_split(root)
    split = read_split(root)
    if all(record.plan_id in split.plans for record in read_manifest(root)):
        return split
    return make_split(root, test=split.test, seed=split.seed, forced=split.forced)


def assign_sides(
    groups: Mapping[str, str], *, test: float, seed: int, forced: Collection[str] = ()
) -> SplitTable:
    """Choose a side for each group.

    Args:
        groups: Plan to the plan that stands for its group.
        test: Share of the groups that are for testing. Where one side would stay empty, the group that came
            nearest goes there, if there are two groups at all.
        seed: Of the choice.
        forced: Plans whose groups are for testing in any case.
    """
    must = {groups[plan_id] for plan_id in forced}
    shares = {
        group: -1.0 if group in must else uniform_share(f"split/{seed}/{group}")
        for group in set(groups.values())
    }
    chosen = {group for group, share in shares.items() if share < test}
    order = sorted(shares, key=lambda group: (shares[group], group))
    if len(order) > 1 and 0.0 < test < 1.0:
        chosen |= {order[0]}
        if len(chosen) == len(order) and order[-1] not in must:
            chosen -= {order[-1]}
    plans = {
        plan_id: PlanSide("test" if group in chosen else "train", group)
        for plan_id, group in groups.items()
    }
    return SplitTable(seed, test, plans, tuple(sorted(forced)))
