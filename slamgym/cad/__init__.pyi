from .dxf import read_dxf
from .floorplan import Door, FloorPlan, Room, check_plan, robot_space
from .generator import PlanGeneratorConfig, generate_plan
from .geojson import read_geojson
from .houseexpo import format_houseexpo, parse_houseexpo, read_houseexpo, write_houseexpo
from .ifc import read_ifc
from .image_plan import read_image_plan, read_ros_plan, trace_plan
from .plan_index import PlanGroup, PlanSource, plan_groups
from .sources import open_plan_mix, open_plans

__all__ = [
    "Door",
    "FloorPlan",
    "PlanGeneratorConfig",
    "PlanGroup",
    "PlanSource",
    "Room",
    "check_plan",
    "format_houseexpo",
    "generate_plan",
    "open_plan_mix",
    "open_plans",
    "parse_houseexpo",
    "plan_groups",
    "read_dxf",
    "read_geojson",
    "read_houseexpo",
    "read_ifc",
    "read_image_plan",
    "read_ros_plan",
    "robot_space",
    "trace_plan",
    "write_houseexpo",
]
