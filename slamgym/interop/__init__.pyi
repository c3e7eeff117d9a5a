from .carmen import read_carmen, write_carmen
from .logs import Relations, open_log, read_relations, read_truth
from .records import Log, LogRecord, LogWarnings
from .ros_map import read_ros_map, write_ros_map
from .rosbag import read_rosbag
from .rosbag_writer import write_rosbag2
from .tum import read_tum, write_tum

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
