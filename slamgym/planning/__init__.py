"""Planning on the map that the robot believes in: frontiers, costmap, paths, and the navigation stack.

Nothing here sees a floor plan or a true pose: the inputs are an occupancy grid, an estimated pose and a scan.
"""

import lazy_loader as lazy

__getattr__, __dir__, __all__ = lazy.attach_stub(__name__, __file__)
