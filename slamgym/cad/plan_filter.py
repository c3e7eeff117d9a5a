"""Which floor plans are worth exploring."""

from typing import Literal

from slamgym.cad import FloorPlan

PlanFilter = Literal["none", "useful"]

ROOMS = (2, 20)
AREA = (20.0, 300.0)  # [m2]
LONG_SIDE = 30.0  # [m]
MAX_VERTICES = 1500


def passes(plan: FloorPlan, plan_filter: PlanFilter) -> bool:
    """Whether the filter lets a plan through.

    ``useful`` leaves out single empty rooms and giants, and keeps 87 % of HouseExpo: 2-20 rooms, 20-300 m2 of
    free area, at most 30 m long, at most 1,500 vertices. It concerns plans in HouseExpo's format; generated
    plans and annotated floors, which are offices and schools, always pass.
    """
    if plan_filter == "none" or not plan.source.endswith(".json"):
        return True
    min_x, min_y, max_x, max_y = plan.bounds
    return (
        ROOMS[0] <= len(plan.rooms) <= ROOMS[1]
        and AREA[0] <= plan.area <= AREA[1]
        and max(max_x - min_x, max_y - min_y) <= LONG_SIDE
        and len(plan.segments()) <= MAX_VERTICES
    )
