"""Groups of buildings on which promises are calibrated and explorers are checked, none of them learned on."""

import dataclasses
from collections.abc import Iterator
from typing import NamedTuple

from slamgym.agents.plan_splits import PlanSplit, explorable_plans, ids_of
from slamgym.agents.rl.train_config import FURNISHED
from slamgym.cad import FloorPlan, open_plans
from slamgym.cad.plan_filter import AREA, passes
from slamgym.core.names import shuffled
from slamgym.sim import ClutterConfig


class BuildingGroup(NamedTuple):
    """Buildings of one kind."""

    plans: str
    """Floor plans; HouseExpo's where empty."""
    clutter: tuple[ClutterConfig, ...] = (ClutterConfig(),)
    """What stands and walks in them, in turn."""
    area: tuple[float, float] = AREA
    """Floor [m2]."""


BUILDING_GROUPS = {
    "homes": BuildingGroup(""),
    "furnished": BuildingGroup("", (FURNISHED,)),
    "people": BuildingGroup(
        "", tuple(dataclasses.replace(FURNISHED, people=count) for count in (1, 2))
    ),
    "generated homes": BuildingGroup("procedural:home:loops"),
    "generated offices": BuildingGroup("procedural:office:loops"),
    "large homes": BuildingGroup("", area=(AREA[1], 1500.0)),
    "large offices": BuildingGroup("procedural:office:loops", area=(AREA[1], 1500.0)),
}
"""No plan is in two groups: of HouseExpo's usual homes, each takes every third."""


def plans_of(houseexpo: str, name: str, split: PlanSplit) -> Iterator[FloorPlan]:
    """The plans of a group in a fixed order."""
    group = BUILDING_GROUPS[name]
    source = open_plans(group.plans or houseexpo)
    order = shuffled(ids_of(source.ids, split), 77)
    sharing = [
        other
        for other, one in BUILDING_GROUPS.items()
        if (one.plans, one.area) == (group.plans, group.area)
    ]
    low, high = group.area
    for plan in explorable_plans(source, order[sharing.index(name) :: len(sharing)]):
        if low < plan.area <= high and (high > AREA[1] or passes(plan, "useful")):
            yield plan
