"""A finished map goes on with a new drive: both become one map in the frame of the older one, thinned."""

from dataclasses import replace

import numpy as np

from slamgym.core.errors import ConfigError, SlamgymError
from slamgym.core.geometry import transform_poses
from slamgym.core.types import FloatArray, Trajectory
from slamgym.metrics.trajectory import align_se2
from slamgym.slam.graph.map_graph import MapGraph
from slamgym.slam.graph.relative import moved_by, seen_from
from slamgym.slam.merge.days import draw_days
from slamgym.slam.merge.merged import Merged, Refusal, merge_parts
from slamgym.slam.merge.merging import Part
from slamgym.slam.merge.thinning import thinned
from slamgym.slam.merge.verdict import SAME_BUILDING
from slamgym.slam.replay import ReplayResult


def continue_map(older: Part, result: ReplayResult, name: str) -> ReplayResult:
    """Join a drive with an older map, which moves, too, if it has a graph.

    Args:
        older: The map; the result is in its frame.
        result: The drive, mapped alone.
        name: Of the drive, for errors.

    Raises:
        ConfigError: If the drive has no graph, or cells of another size.
        SlamgymError: If it isn't sure where it lies on the map.
    """
    if result.graph is None:
        raise ConfigError("--continue joins graphs; leave --mode out, or take pose_graph")
    cell = older.floor.grid.frame.resolution
    if result.grid.frame.resolution != cell:
        raise ConfigError(
            f"--resolution is {result.grid.frame.resolution} m, but the map to continue has cells of {cell} m; leave "
            "it out"
        )
    merged = merge_parts([older, Part.of_graph(name, result.graph)], odds=SAME_BUILDING)
    if isinstance(merged, Refusal):
        raise SlamgymError(
            f"{name}: isn't sure to find itself on the map to continue ({merged.verdict.doubt}); drive further in the "
            "mapped part of the same building, or map the log anew without --continue"
        )
    graph = _in_place(merged, older)
    poses = graph.poses[merged.placed[1].nodes]
    grid = merged.grid()
    if older.graph is not None:
        graph = thinned(graph)
        grid = draw_days(graph)
    return replace(
        result,
        grid=grid,
        processed=Trajectory(result.processed.stamps, poses),
        trajectory=_carried(result.trajectory, result.processed, poses),
        moments=_carried(result.moments, result.processed, poses),
        graph=graph,
    )


def _in_place(merged: Merged, older: Part) -> MapGraph:
    """The joint graph where the older map lay: its first node alone would turn it a little with each drive."""
    graph = merged.graph
    assert graph is not None
    if older.graph is None:
        return graph
    before = older.graph.poses
    back = align_se2(graph.poses[: len(before), :2], before[:, :2])
    return graph.moved(transform_poses(back, graph.poses))


def _carried(path: Trajectory, nodes: Trajectory, poses: FloatArray) -> Trajectory:
    """A path moved along with the nodes that it passes, which now lie at other poses (N, 3)."""
    before = np.searchsorted(nodes.stamps, path.stamps, side="right") - 1
    moved = [
        moved_by(poses[node], seen_from(nodes.poses[node], pose))
        for node, pose in zip(np.maximum(before, 0).tolist(), path.poses, strict=True)
    ]
    return Trajectory(path.stamps, np.array(moved).reshape(-1, 3))
