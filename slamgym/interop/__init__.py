"""Files that other robotics software reads and writes: ROS maps, TUM trajectories, CARMEN logs, ROS bags."""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
