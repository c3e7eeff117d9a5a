"""Scans of the simulator's robot along a path, and the map that SLAM draws of them at the believed poses.

Laser, furniture, materials and the drawing are the simulator's and the mapper's own, so that a map differs from a
simulated one in nothing but where its scans lie. People and what moves are left out.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import shapely

from slamgym.core.types import (
    Float32Array,
    FloatArray,
    GridFrame,
    LaserGeometry,
    OccupancyGrid,
    Pose2D,
    Twist2D,
)
from slamgym.parametric.paths import TimedTrajectory
from slamgym.sim import ClutterConfig, Lidar, LidarConfig, RobotConfig, make_clutter, make_surfaces
from slamgym.sim.clutter import outlines_of
from slamgym.slam.config import SlamConfig
from slamgym.slam.hit_count_kernels import BeamTable
from slamgym.slam.hit_counts import HitCountMap

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan


@dataclass(frozen=True)
class RobotScans:
    """The scans of a path, one a pose."""

    middle: FloatArray  # (T, 3) true poses of the base in the middle of each sweep, world frame
    geometry: LaserGeometry
    true: Float32Array  # (T, B) [m], inf where nothing is in range
    measured: Float32Array  # (T, B) [m], as REP 117

    def end_points(self, usable: float) -> tuple[FloatArray, np.ndarray]:
        """Where beams truly ended, (T, B, 2) [m] world frame, and which ended within ``usable`` [m], (T, B)."""
        mount, theta = self.geometry.mount, self.middle[:, 2]
        x = self.middle[:, 0] + np.cos(theta) * mount.x - np.sin(theta) * mount.y
        y = self.middle[:, 1] + np.sin(theta) * mount.x + np.cos(theta) * mount.y
        near = self.true <= usable
        length = np.where(near, self.true, 0.0)
        angle = (theta + mount.theta)[:, None] + self.geometry.angles
        points = np.stack([x[:, None] + length * np.cos(angle), y[:, None] + length * np.sin(angle)], axis=-1)
        return points, near


def furniture_beside(
    path: FloatArray, plan: "FloorPlan", config: ClutterConfig, rng: np.random.Generator
) -> FloatArray:
    """Furnish a building, but not where the robot is known to have driven.

    Args:
        path: (T, 2) [m] world frame.
        plan: The building.
        config: How much there is.
        rng: Draws it.

    Returns:
        Outlines, (F, 4) as x0, y0, x1, y1 [m].
    """
    if config.is_empty:
        return np.empty((0, 4))
    solids = make_clutter(plan, rng, config).solids()
    gaps = shapely.distance(shapely.LineString(path), [shapely.Polygon(corners) for corners in solids])
    near = 0.5 * RobotConfig().radius
    return outlines_of([solid for solid, gap in zip(solids, gaps, strict=True) if gap > near])


def take_scans(
    plan: "FloorPlan",
    furniture: FloatArray,
    path: TimedTrajectory,
    config: LidarConfig,
    rng: np.random.Generator,
) -> RobotScans:
    """Measure a building from every pose of a path.

    Args:
        plan: The building.
        furniture: Outlines of what stands in it, (F, 4) [m].
        path: True poses at which scans enter the map, world frame.
        config: The laser.
        rng: Draws its errors.
    """
    surfaces = make_surfaces(plan, furniture, config.surfaces)
    segments = np.vstack([plan.segments(), furniture])
    lidar = Lidar(config)
    true = np.empty((len(path), lidar.geometry.num_beams), dtype=np.float32)
    measured = np.empty_like(true)
    for k, (pose, twist) in enumerate(zip(path.poses.tolist(), path.twists.tolist(), strict=True)):
        sighting = lidar.look(Pose2D(*pose), segments, Twist2D(*twist))
        true[k] = sighting.ranges
        measured[k] = lidar.measure(sighting, rng, 0.0, surfaces).ranges
    back = 0.5 * config.sweep * path.twists
    middle = path.poses.copy()
    middle[:, 0] -= back[:, 0] * np.cos(path.poses[:, 2])
    middle[:, 1] -= back[:, 0] * np.sin(path.poses[:, 2])
    middle[:, 2] -= back[:, 1]
    return RobotScans(middle, lidar.geometry, true, measured)


def drawn_map(scans: RobotScans, believed: FloatArray, frame: GridFrame, config: SlamConfig) -> OccupancyGrid:
    """Draw every scan where the robot believed to be.

    Args:
        scans: What was measured.
        believed: (T, 3) poses of the base, in the frame that ``frame`` places.
        frame: Its cell borders are the map's, too.
        config: Counting, thresholds and usable range.

    Returns:
        The cells that are known, and no more.
    """
    config = replace(config, resolution=frame.resolution)
    counts = HitCountMap(BeamTable.of(scans.geometry, config), config)
    counts.draw(believed - np.array([frame.origin_x, frame.origin_y, 0.0]), scans.measured)
    grid = counts.occupancy_grid()
    x, y = frame.origin_x + grid.frame.origin_x, frame.origin_y + grid.frame.origin_y
    return OccupancyGrid(grid.cells, GridFrame(frame.resolution, x, y, *grid.cells.shape))
