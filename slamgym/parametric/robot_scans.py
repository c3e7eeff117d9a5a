"""What the simulator's robot would measure along a path, and the map that SLAM draws of it where it believes to be.

Laser, furniture, materials and the drawing are the simulator's and the mapper's own, so that a map differs from a
simulated one in nothing but where its scans lie. People and what moves are left out.
"""

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import shapely

from slamgym.core.grids import paste
from slamgym.core.types import (
    UNKNOWN,
    ByteArray,
    Float32Array,
    FloatArray,
    GridFrame,
    LaserGeometry,
    Pose2D,
    Twist2D,
)
from slamgym.parametric.config import SensingConfig
from slamgym.parametric.trajectory import TimedTrajectory
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

    poses: FloatArray  # (T, 3) true, of the base, world frame
    geometry: LaserGeometry
    true: Float32Array  # (T, B) [m], inf where nothing is in range
    measured: Float32Array  # (T, B) [m], as REP 117

    def end_points(self, usable: float) -> tuple[FloatArray, np.ndarray]:
        """Where beams truly ended, (T, B, 2) [m] world frame, and which ended within ``usable`` [m], (T, B)."""
        mount, theta = self.geometry.mount, self.poses[:, 2]
        x = self.poses[:, 0] + np.cos(theta) * mount.x - np.sin(theta) * mount.y
        y = self.poses[:, 1] + np.sin(theta) * mount.x + np.cos(theta) * mount.y
        near = self.true <= usable
        length = np.where(near, self.true, 0.0)
        angle = (theta + mount.theta)[:, None] + self.geometry.angles
        points = np.stack([x[:, None] + length * np.cos(angle), y[:, None] + length * np.sin(angle)], axis=-1)
        return points, near


def furniture_beside(
    path: FloatArray,
    plan: "FloorPlan",
    config: ClutterConfig,
    rng: np.random.Generator,
    robot: RobotConfig | None = None,
) -> FloatArray:
    """Furnish a building, but not where the robot is known to have driven.

    Args:
        path: (T, 2) [m] world frame.
        plan: The building.
        config: How much there is.
        rng: Draws it.
        robot: Who drives; a TurtleBot3 Waffle Pi where left out.

    Returns:
        Outlines, (F, 4) as x0, y0, x1, y1 [m].
    """
    if config.is_empty:
        return np.empty((0, 4))
    robot = robot or RobotConfig()
    solids = make_clutter(plan, rng, config, robot).solids()
    gaps = shapely.distance(shapely.LineString(path), [shapely.Polygon(corners) for corners in solids])
    return outlines_of([solid for solid, gap in zip(solids, gaps, strict=True) if gap > 0.5 * robot.radius])


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
    return RobotScans(path.poses, lidar.geometry, true, measured)


def drawn_map(scans: RobotScans, believed: FloatArray, frame: GridFrame, config: SlamConfig) -> ByteArray:
    """Draw every scan where the robot believed to be.

    Args:
        scans: What was measured.
        believed: (T, 3) poses of the base, in the frame that ``frame`` places.
        frame: The grid.
        config: Counting, thresholds and usable range.

    Returns:
        (H, W) 0 occupied, 205 unknown, 254 free.
    """
    grid = _counts(scans.geometry, scans.measured, believed, frame, config).occupancy_grid()
    return _placed(grid.cells, grid.frame.origin_x, grid.frame.origin_y, frame, UNKNOWN)


def texture_channels(
    scans: RobotScans, believed: FloatArray, frame: GridFrame, config: SlamConfig
) -> Float32Array:
    """What a network draws a map from: scans without errors, drawn where the robot believed to be.

    Args:
        scans: Their true ranges are drawn.
        believed: As for :func:`drawn_map`.
        frame: The grid.
        config: Counting and usable range.

    Returns:
        (3, H, W): logarithms of how many beams met a cell and of how many ended in it, in fifths, and the share
        of the latter.
    """
    drawn = _counts(scans.geometry, scans.true, believed, frame, config)
    row, col = drawn.corner
    r = frame.resolution
    hits, visits = (
        _placed(drawn.counts[::-1, :, k], col * r, row * r, frame, 0).astype(np.float32) for k in (0, 1)
    )
    return np.stack([0.2 * np.log1p(visits), 0.2 * np.log1p(hits), hits / np.maximum(visits, 1.0)])


STYLE_NAMES = ("occupied threshold", "min passes", "no return clears", "glazing", "roughness", "noise")


def style_of(config: SensingConfig) -> Float32Array:
    """What a map's texture depends on beside its scans: how the mapper draws and how the laser errs, of order 1."""
    lidar, slam = config.lidar, config.slam
    values = (
        4.0 * slam.occupied_threshold,
        math.log(slam.min_passes),
        float(slam.no_return == "clear"),
        20.0 * lidar.surfaces.glazing,
        100.0 * lidar.surfaces.roughness,
        100.0 * lidar.sigma_relative,
    )
    return np.array(values, dtype=np.float32)


def _counts(
    geometry: LaserGeometry, ranges: Float32Array, believed: FloatArray, frame: GridFrame, config: SlamConfig
) -> HitCountMap:
    """Hits and visits on a lattice that begins where the frame does."""
    config = replace(config, resolution=frame.resolution)
    counts = HitCountMap(BeamTable.of(geometry, config), config)
    counts.draw(believed - np.array([frame.origin_x, frame.origin_y, 0.0]), ranges)
    return counts


def _placed(cells: np.ndarray, x: float, y: float, frame: GridFrame, outside: int) -> np.ndarray:
    """Cells (H, W), row 0 at the top, whose lower left corner lies (x, y) [m] from the frame's, cut to the frame."""
    placed = np.full((frame.height_px, frame.width_px), outside, cells.dtype)
    left, bottom = round(x / frame.resolution), round(y / frame.resolution)
    paste(placed, cells, bottom + len(cells) - frame.height_px, -left)
    return placed
