"""Floor plans: geometry, files, and where they come from."""

from slamgym.cad.floorplan import Door, FloorPlan, Room, check_plan, robot_space
from slamgym.cad.generator import PlanGeneratorConfig, generate_plan
from slamgym.cad.houseexpo import format_houseexpo, parse_houseexpo, read_houseexpo, write_houseexpo
from slamgym.cad.image_plan import read_image_plan, read_ros_plan, trace_plan
from slamgym.cad.plan_filter import Rejection, Rejections, usable_plans
from slamgym.cad.sources import PlanGroup, PlanSource, open_plan_mix, open_plans, plan_groups

__all__ = [
    "Door",
    "FloorPlan",
    "PlanGeneratorConfig",
    "PlanGroup",
    "PlanSource",
    "Rejection",
    "Rejections",
    "Room",
    "check_plan",
    "format_houseexpo",
    "generate_plan",
    "open_plan_mix",
    "open_plans",
    "parse_houseexpo",
    "plan_groups",
    "read_houseexpo",
    "read_image_plan",
    "read_ros_plan",
    "robot_space",
    "trace_plan",
    "usable_plans",
    "write_houseexpo",
]
