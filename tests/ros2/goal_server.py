"""A program in Nav2's place: takes goals of the real action, aborts each, and prints them as one line of JSON.

``python goal_server.py GOALS SECONDS``; it needs nav2_msgs.
"""

import json
import sys
import time

import rclpy
from nav2_msgs.action import NavigateToPose
from rclpy.action import ActionServer
from rclpy.executors import MultiThreadedExecutor


def main(count, seconds):
    rclpy.init()
    node = rclpy.create_node("goal_server")
    goals = []

    def take(handle):
        pose = handle.request.pose
        goals.append(
            {"frame": pose.header.frame_id, "at": [pose.pose.position.x, pose.pose.position.y]}
        )
        handle.abort()
        return NavigateToPose.Result(error_code=NavigateToPose.Result.UNKNOWN)

    ActionServer(node, NavigateToPose, "navigate_to_pose", take)
    executor = MultiThreadedExecutor(2)
    executor.add_node(node)
    end = time.monotonic() + seconds
    while time.monotonic() < end and len(goals) < count:
        executor.spin_once(timeout_sec=0.1)
    ends = node.get_subscriptions_info_by_topic("/map_updates")
    updates = sorted({one.topic_type for one in ends})
    sys.stdout.write(json.dumps({"goals": goals, "updates": updates}) + "\n")
    rclpy.try_shutdown()


if __name__ == "__main__":
    main(int(sys.argv[1]), float(sys.argv[2]))
