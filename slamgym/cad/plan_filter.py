"""Which floor plans are worth exploring, and which a batch omits and why."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from slamgym.core.errors import PlanError
from slamgym.core.files import write_text

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan
    from slamgym.cad.plan_index import PlanSource

PlanFilter = Literal["none", "useful"]

ROOMS = (2, 20)
AREA = (20.0, 300.0)  # [m2]
LONG_SIDE = 30.0  # [m]
MAX_VERTICES = 1500


def passes(plan: FloorPlan, plan_filter: PlanFilter) -> bool:
    """True if the filter lets a plan through.

    ``useful`` omits single empty rooms and giants, and keeps 87 % of HouseExpo: 2-20 rooms, 20-300 m2 of
    free area, at most 30 m long, at most 1,500 vertices. It concerns plans in HouseExpo's format; generated
    plans and annotated floors, which are offices and schools, always pass.
    """
    if plan_filter == "none" or not plan.source.endswith(".json"):
        return True
    return (
        ROOMS[0] <= len(plan.rooms) <= ROOMS[1]
        and AREA[0] <= plan.area <= AREA[1]
        and plan.extent <= LONG_SIDE
        and len(plan.segments()) <= MAX_VERTICES
    )


@dataclass(frozen=True)
class Rejection:
    """One plan that was left out."""

    plan: str
    source: str
    reason: str


class Rejections(list[Rejection]):
    """The plans that a batch omits, which can be written to ``rejected.jsonl``."""

    def add(self, plan_id: str, error: PlanError) -> None:
        """Note that a plan was left out."""
        self.append(Rejection(plan_id, error.path, error.reason))

    def write(self, path: Path | str) -> None:
        """Write one JSON object a line, ``{plan, source, reason}``; nothing if no plan was left out.

        Raises:
            InputFileError: If the file can't be written.
        """
        if self:
            write_text(path, "".join(json.dumps(asdict(entry)) + "\n" for entry in self))


def usable_plans(
    source: PlanSource,
    ids: Iterable[str],
    rejections: Rejections,
    robot_radius: float = 0.22,
    max_extent: float = math.inf,
) -> Iterator[FloorPlan]:
    """Load and check plans; those that fail go to ``rejections`` instead.

    Args:
        source: Where the plans are.
        ids: Which of them.
        rejections: Collects the others.
        robot_radius: See :func:`slamgym.cad.check_plan` [m].
        max_extent: See :func:`slamgym.cad.check_plan` [m].
    """
    from slamgym.cad.floorplan import check_plan

    for plan_id in ids:
        try:
            plan = source.load(plan_id)
            check_plan(plan, robot_radius, max_extent)
        except PlanError as error:
            rejections.add(plan_id, error)
        else:
            yield plan
