"""Which floor plans are worth exploring."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan

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


def usual_reason(reasons: Sequence[str]) -> str:
    """Why most of the plans can't be used, how often, and the advice that it gives; numbers in it are one plan's."""
    kinds = [re.sub(r"[0-9.]+", "0", reason) for reason in reasons]
    kind, times = Counter(kinds).most_common(1)[0]
    return f"{times:,} of {len(reasons):,}: {reasons[kinds.index(kind)]}"
