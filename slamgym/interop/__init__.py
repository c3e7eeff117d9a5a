"""Files that other robotics software reads and writes: ROS maps, TUM trajectories, CARMEN logs, ROS bags."""

from slamgym.interop.carmen import read_carmen, write_carmen
from slamgym.interop.logs import Relations, open_log, read_relations, read_truth
from slamgym.interop.records import Log, LogRecord, LogWarnings
from slamgym.interop.ros_map import read_ros_map, write_ros_map
from slamgym.interop.rosbag import read_rosbag
from slamgym.interop.rosbag_writer import write_rosbag2
from slamgym.interop.tum import read_tum, write_tum

__all__ = [
    "Log",
    "LogRecord",
    "LogWarnings",
    "Relations",
    "open_log",
    "read_carmen",
    "read_relations",
    "read_ros_map",
    "read_rosbag",
    "read_truth",
    "read_tum",
    "write_carmen",
    "write_ros_map",
    "write_rosbag2",
    "write_tum",
]
