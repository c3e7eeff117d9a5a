"""Files that other robotics software reads and writes: ROS maps, TUM trajectories, CARMEN logs, ROS bags."""

from slamgym.interop.carmen import read_carmen, write_carmen
from slamgym.interop.records import Log, LogRecord, LogWarnings
from slamgym.interop.relations import Relations, read_relations
from slamgym.interop.ros_map import read_ros_map, write_ros_map
from slamgym.interop.tum import read_tum, write_tum

__all__ = [
    "Log",
    "LogRecord",
    "LogWarnings",
    "Relations",
    "read_carmen",
    "read_relations",
    "read_ros_map",
    "read_tum",
    "write_carmen",
    "write_ros_map",
    "write_tum",
]
