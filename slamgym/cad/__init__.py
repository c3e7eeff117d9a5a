"""Floor plans: geometry, files, and where they come from."""

from slamgym.cad.floorplan import Door, FloorPlan, Room, check_plan, robot_space
from slamgym.cad.generator import GeneratorConfig, generate_plan
from slamgym.cad.houseexpo import format_houseexpo, parse_houseexpo, read_houseexpo, write_houseexpo
from slamgym.cad.sources import PlanSource, open_plans

__all__ = [
    "Door",
    "FloorPlan",
    "GeneratorConfig",
    "PlanSource",
    "Room",
    "check_plan",
    "format_houseexpo",
    "generate_plan",
    "open_plans",
    "parse_houseexpo",
    "read_houseexpo",
    "robot_space",
    "write_houseexpo",
]
