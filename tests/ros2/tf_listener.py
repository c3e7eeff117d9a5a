"""A program beside the nodes: what is on /tf, and whether it leads where the robot is. Prints a line of JSON.

``python tf_listener.py COUNT SECONDS`` ends after so many corrections of the odometry, or so long; it needs tf2_msgs.
"""

import collections
import json
import math
import statistics
import sys
import time

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from tf2_msgs.msg import TFMessage

from slamgym.core.geometry import compose, inverse
from slamgym.core.types import Pose2D
from slamgym.interop.ros_messages import pose_of


def stamp(header):
    return header.stamp.sec + 1e-9 * header.stamp.nanosec


def planar(transform):
    move, turn = transform.translation, transform.rotation
    return Pose2D(move.x, move.y, 2.0 * math.atan2(turn.z, turn.w))


def main(count, seconds):
    rclpy.init()
    node = rclpy.create_node("tf_listener")
    found, static, truth = collections.defaultdict(dict), {}, {}
    backwards = 0

    def take(message):
        nonlocal backwards
        for one in message.transforms:
            key = f"{one.header.frame_id} -> {one.child_frame_id}"
            at = stamp(one.header)
            backwards += at < max(found[key], default=0.0)
            found[key][at] = planar(one.transform)

    def take_static(message):
        for one in message.transforms:
            static[f"{one.header.frame_id} -> {one.child_frame_id}"] = planar(one.transform)

    kept = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(TFMessage, "/tf", take, 100)
    node.create_subscription(TFMessage, "/tf_static", take_static, kept)
    node.create_subscription(
        PoseStamped, "ground_truth/pose",
        lambda message: truth.__setitem__(stamp(message.header), pose_of(message.pose, "pose")), 100,
    )  # fmt: skip
    end = time.monotonic() + seconds
    while time.monotonic() < end and len(found["map -> odom"]) < count:
        rclpy.spin_once(node, timeout_sec=0.1)
    found = report(found, static, truth) | {"backwards": backwards}
    sys.stdout.write(json.dumps(found) + "\n")
    rclpy.try_shutdown()


def report(found, static, truth):
    """Rates in robot time, and how far the chain map -> odom -> base is from the truth, as a motion since the start."""
    rates = {}
    for key, by_stamp in found.items():
        stamps = sorted(by_stamp) or [0.0]
        rates[key] = (len(stamps) - 1) / max(stamps[-1] - stamps[0], 1e-9)
    corrections, odometry = found.get("map -> odom", {}), found.get("odom -> base_footprint", {})
    errors, first = [], None
    for at in sorted(set(truth) & set(odometry)):
        before = [one for one in corrections if one <= at + 0.3]
        if not before:
            continue
        believed = compose(corrections[max(before)], odometry[at])
        first = first or (believed, truth[at])
        moved = compose(inverse(first[0]), believed)
        truly = compose(inverse(first[1]), truth[at])
        errors.append(math.dist(moved[:2], truly[:2]))
    return {
        "rates": rates,
        "static": sorted(static),
        "poses": len(errors),
        "error": statistics.median(errors) if errors else math.inf,
    }


if __name__ == "__main__":
    main(int(sys.argv[1]), float(sys.argv[2]))
