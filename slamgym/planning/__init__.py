"""Planning on the map that the robot believes in: frontiers, costmap, paths, and the navigation stack.

Nothing here sees a floor plan or a true pose: the inputs are an occupancy grid, an estimated pose and a scan.
"""

from slamgym.planning.context import ExplorerContext

__all__ = ["ExplorerContext"]
