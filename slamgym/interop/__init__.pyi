from .bag_topics import BagChoices
from .carmen import read_carmen
from .carmen_writer import write_carmen
from .logs import Relations, open_log, read_relations, read_truth
from .map_files import RobotMap, read_map
from .records import Log, LogFinding, LogRecord, LogWarnings
from .ros_map import read_ros_map, write_ros_map
from .rosbag import read_rosbag
from .rosbag_writer import write_rosbag2
from .tum import read_tum, write_tum
from .valetudo import MapSegment, parse_valetudo

__all__ = [
    "BagChoices",
    "Log",
    "LogFinding",
    "LogRecord",
    "LogWarnings",
    "MapSegment",
    "Relations",
    "RobotMap",
    "open_log",
    "parse_valetudo",
    "read_carmen",
    "read_map",
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
