"""ROS 2 nodes: a simulated robot, the mapper, the explorers; run by ``slamgym ros2``.

``parameters`` has what each node may be told, ``node``, ``worker`` and ``topics`` what they share. ``simulator`` (with
``sim_clock``), ``mapping`` and ``exploring`` are the nodes, and ``demo`` starts all three; ``driving``, ``goals`` and
``viewing`` publish what an exploration sends and shows. ``stamps``, ``frames`` and ``laser`` read messages;
``run_files``, ``map_run``, ``exploration``, ``inputs``, ``orders``, ``trials``,
``way_back`` and ``foreign_maps`` decide, without ROS. Only this package imports rclpy, and nothing but the commands
imports this package.
"""

__all__: list[str] = []
