"""ROS 2: slamgym's world, mapper and explorers as nodes; everything that they decide is in modules without rclpy."""

__all__: list[str] = []
