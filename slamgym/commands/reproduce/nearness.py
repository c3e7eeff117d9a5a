"""Figures 7 and 9 in numbers: how far maps made of a CAD map lie from the simulated map of the same exploration.

The paper finds by eye that the parametric model, along the robot's own path, comes nearer to the simulated map than
Modelprog, which knows no path.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from slamgym.commands.reproduce.steps import PARAMETRIC, REDRAWN, TO_SLAM
from slamgym.commands.reproduce.verdicts import Claim, counted_share, judge, with_interval
from slamgym.core.intervals import Interval, mean_interval, wilson_interval
from slamgym.core.types import OCCUPIED, ByteArray, FloatArray, GridFrame, OccupancyGrid
from slamgym.dataset.format import Layout, read_manifest
from slamgym.dataset.images.format import load_images, read_images
from slamgym.dataset.images.square_images import resample_map
from slamgym.interop import read_ros_map
from slamgym.metrics import aligned_error, free_space
from slamgym.metrics.maps import distance_to
from slamgym.viz.plots import plot_boxes

if TYPE_CHECKING:
    from slamgym.dataset.record import PairRecord


class Nearness(NamedTuple):
    """Distances of made maps from the simulated maps of the same explorations."""

    errors: dict[str, FloatArray]
    """By method, mean squared errors of the free space, aligned by a similarity, shape (N,)."""
    wall_distances: dict[str, FloatArray]
    """By method, mean distances of walls from walls, there and back, not aligned [m], shape (N,)."""
    plans: list[str]
    """The plan of each exploration."""


def measure_nearness(pairs: Path, images: Path, redrawn: Path) -> Nearness | None:
    """Compare made maps with the simulated ones; None where no exploration was drawn by every method.

    Args:
        pairs: The explorations.
        images: Uniform images of them.
        redrawn: A folder with a dataset of each method that drew the explorations again.

    Raises:
        InputFileError: If a file is missing or malformed.
    """
    methods = (*REDRAWN, TO_SLAM)
    if not all((redrawn / method).is_dir() for method in methods):
        return None
    made = {method: _records(redrawn / method) for method in methods}
    simulated = _records(pairs)
    tested = read_images(images, "test")
    chosen = [image for image in tested if all(image.name in records for records in made.values())]
    if not chosen:
        return None
    errors = {}
    wall_distances = {}
    for method in methods:
        error_of_maps = []
        distance_of_maps = []
        for image in chosen:
            _, slam = load_images(images, image)
            from_start = simulated[image.name].start
            cells = _drawn_map(redrawn / method, made[method][image.name], from_start, image.frame)
            error_of_maps.append(aligned_error(free_space(cells), free_space(slam)).mse)
            distance_of_maps.append(wall_distance(cells, slam) * image.metres_per_px)
        errors[method] = np.array(error_of_maps)
        wall_distances[method] = np.array(distance_of_maps)
    return Nearness(errors, wall_distances, [image.group for image in chosen])


def _records(dataset: Path) -> dict[str, PairRecord]:
    return {record.name: record for record in read_manifest(dataset)}


def _drawn_map(
    dataset: Path, record: PairRecord, start: tuple[float, float, float], frame: GridFrame
) -> ByteArray:
    """A made map on the frame of an image, shape ``frame.shape``.

    Args:
        dataset: Of the method.
        record: Of the map.
        start: Where the robot of the simulated map began, world frame.
        frame: Of the image, in the map frame of that robot.

    Convention: a map frame lies about the robot's own start; a method without a path has chosen another one.
    """
    grid = read_ros_map(Layout(dataset).episode(record.name) / "map.yaml")
    own_x, own_y, _ = record.start
    start_x, start_y, _ = start
    moved = grid.frame._replace(
        origin_x=grid.frame.origin_x + own_x - start_x,
        origin_y=grid.frame.origin_y + own_y - start_y,
    )
    return resample_map(OccupancyGrid(grid.cells, moved), frame)


def wall_distance(first: ByteArray, second: ByteArray) -> float:
    """Mean distance of either map's occupied cells from the other's, the mean of both ways [cells].

    Args:
        first: A map, shape (H, W).
        second: Another one of the same shape.

    Returns:
        The diagonal where a map has no occupied cell.
    """
    walls = first == OCCUPIED
    other_walls = second == OCCUPIED
    if not (walls.any() and other_walls.any()):
        return float(np.hypot(*first.shape))
    there = distance_to(other_walls)[walls].mean()
    back = distance_to(walls)[other_walls].mean()
    return float(0.5 * (there + back))


def nearness_table(found: Nearness) -> tuple[list[str], list[list[str]]]:
    """Headings and rows: both distances of each method, with 95 % intervals over plans."""
    rows = []
    for method, errors in found.errors.items():
        error = mean_interval(errors, groups=found.plans)
        distance = mean_interval(found.wall_distances[method], groups=found.plans)
        shown = [with_interval(error, 3), with_interval(distance)]
        rows.append([method, str(len(errors)), *shown])
    headings = ["method", "maps", "aligned MSE", "walls from walls [m]"]
    return headings, rows


def nearness_claims(found: Nearness | None) -> list[Claim]:
    """Whether most parametric maps lie nearer to the simulated ones than Modelprog's, by either distance."""
    if found is None:
        return []
    # The paper says that it is so, and gives no number.
    by_eye = Interval(1.0, 0.5, 1.0)
    claims = []
    for name, distances in (("aligned MSE", found.errors), ("walls", found.wall_distances)):
        nearer = distances[PARAMETRIC] < distances[TO_SLAM]
        share = wilson_interval(int(nearer.sum()), len(nearer))
        question = (
            f"Figures 7 and 9: are most parametric maps nearer to the simulated ones than {TO_SLAM}'s "
            f"({name})?"
        )
        own = counted_share(share, len(nearer))
        claims.append(Claim(question, "yes, by eye", own, judge(share, by_eye, 0.5)))
    return claims


def plot_nearness(path: Path, found: Nearness) -> None:
    """Draw by how much each method's maps lie nearer to the simulated ones than Modelprog's, pair by pair, as boxes."""
    gains = {}
    for method, errors in found.errors.items():
        if method != TO_SLAM:
            gains[method] = found.errors[TO_SLAM] - errors
    label = f"{TO_SLAM}'s aligned MSE - the method's (positive: nearer to the simulated map)"
    plot_boxes(path, gains, label)
