"""ROS 2 nodes: a simulated robot, the mapper, the explorers; run by ``slamgym ros2``.

``parameters`` has what each node may be told, ``node`` and ``topics`` what they share. ``simulator``, ``mapping`` and
``exploring`` are the nodes, and ``demo`` starts all three; ``goals`` and ``viewing`` publish what an exploration sends
and shows. ``frames`` and ``laser`` read messages; ``map_run``, ``exploration``, ``inputs``, ``orders``, ``trials``,
``way_back`` and ``foreign_maps`` decide, without ROS. Only this package imports rclpy, and nothing but the commands
imports this package.
"""

__all__: list[str] = []
