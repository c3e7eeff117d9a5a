"""What a robot sees where its map knows nothing: surfaces that lead it back, as the odometry alone soon goes astray."""

import numpy as np

from slamgym.core.types import FloatArray
from slamgym.slam.graph.alignment import AlignmentTarget
from slamgym.slam.graph.relative import seen_from
from slamgym.slam.graph.submaps import SUBMAP_CELL, OrientedPoints, Submap
from slamgym.slam.localization.known_map import KnownMap

BEYOND_REACH = 30.0
"""The robot follows what it sees so far round the map [m]."""
DRAWN_EVERY = 0.2
"""A scan is drawn after so much driving [m] or turning [rad]."""


class SurfacesBeyond:
    """A map's surfaces, and such as a robot that is sure of its place sees beyond the map.

    Args:
        known: The map.
    """

    def __init__(self, known: KnownMap) -> None:
        self._known = known
        self._frame = known.surfaces.frames[0]
        self.clear()

    def clear(self) -> None:
        """Forget what was seen beyond the map: the robot was somewhere else."""
        self.surfaces = self._known.surfaces
        """What a scan is aligned with."""
        self._submap: Submap | None = None
        self._drawn = np.full(3, np.inf)  # pose of the last scan that was drawn

    def draw(self, pose: FloatArray, scan: OrientedPoints) -> None:
        """Draw what a scan, taken at a pose (3,), shows beyond the map."""
        if np.abs(pose - self._drawn).max() < DRAWN_EVERY:
            return
        self._drawn = pose
        seen = scan.at(self._known.are_beyond(scan.placed(pose).points))
        if len(seen.points) == 0:
            return
        (known,) = self._known.surfaces.submaps
        if self._submap is None:
            half = 0.5 * SUBMAP_CELL * max(known.grid.shape[:2])
            self._submap = Submap(0, half + BEYOND_REACH)
        self._submap.add(seen_from(self._frame, pose), seen)
        frames = np.array([self._frame, self._frame])
        self.surfaces = AlignmentTarget([known, self._submap], frames)
