"""Several maps in one frame, one after the other: what is sure first."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from slamgym.core.geometry import compose, inverse, transform_poses
from slamgym.core.types import FloatArray, OccupancyGrid, Pose2D
from slamgym.metrics.trajectory import align_se2
from slamgym.slam.graph.map_graph import MapGraph
from slamgym.slam.merge.days import draw_days
from slamgym.slam.merge.drawing import Picture, paint
from slamgym.slam.merge.joint import tied_loosely
from slamgym.slam.merge.merging import Part, compare_parts
from slamgym.slam.merge.verdict import UNKNOWN_BUILDINGS, JointVerdict, Odds


@dataclass(frozen=True)
class Placed:
    """An input, and where it lies."""

    part: Part
    nodes: slice
    """Its nodes in the joint graph; empty of a picture."""
    pose: Pose2D
    """Of its frame in that of the merged map."""
    covariance: FloatArray
    """(3, 3) of its first pose in the frame of the first input; zero of that."""
    verdict: JointVerdict | None
    """What says that it belongs to the others; None of the first."""


@dataclass(frozen=True)
class Merged:
    """Some maps in one frame, that of the first of them."""

    placed: tuple[Placed, ...]
    graph: MapGraph | None
    """None if all are pictures."""

    def grid(self) -> OccupancyGrid:
        """The map: what scans say, and what pictures say where no scan says anything."""
        pictures = [
            Picture(one.part.floor.grid, np.array(one.pose))
            for one in self.placed
            if one.part.graph is None
        ]
        if self.graph is not None:
            pictures.insert(0, Picture(draw_days(self.graph), np.zeros(3)))
        if len(pictures) == 1:
            return pictures[0].grid
        first = self.placed[0].part
        is_drawn = first.graph is not None
        return paint(pictures, pictures[0].grid.frame if is_drawn else first.floor.grid.frame)


@dataclass(frozen=True)
class Refusal:
    """Maps that aren't merged."""

    merged: Merged
    """What belongs together."""
    part: Part
    """A map that belongs to it least badly, and yet isn't sure to."""
    verdict: JointVerdict


def merge_parts(
    parts: Sequence[Part], guess: bool = False, odds: Odds = UNKNOWN_BUILDINGS
) -> Merged | Refusal:
    """Merge maps.

    Args:
        parts: Two or more; the frame of the first is that of the result.
        guess: Take the best place of each, sure or not.
        odds: What is known of them.

    Returns:
        The merged map; or the first that can't be merged with those that can, if one isn't sure to belong to them.
    """
    first, *left = parts
    merged = Merged((_first_placed(first),), first.graph)
    base = first
    while left:
        found: list[tuple[Part, JointVerdict]] = []
        for part in left:
            verdict = compare_parts(base, part, odds)
            found.append((part, verdict))
            if not verdict.doubt:
                break
        part, verdict = max(found, key=lambda pair: _rank(pair[1]))
        if verdict.best is None or (verdict.doubt and not guess):
            return Refusal(merged, part, verdict)
        merged = _added(merged, base, part, verdict)
        left = [other for other in left if other is not part]
        if left:
            base = _as_part(merged, first.name)
    return merged


def _rank(verdict: JointVerdict) -> tuple[bool, float]:
    return not verdict.doubt, -np.inf if verdict.best is None else verdict.best.evidence


def _first_placed(part: Part) -> Placed:
    count = 0 if part.graph is None else len(part.graph.poses)
    return Placed(part, slice(0, count), Pose2D(0.0, 0.0, 0.0), np.zeros((3, 3)), None)


def _added(merged: Merged, base: Part, part: Part, verdict: JointVerdict) -> Merged:
    """A merged map with one more part."""
    best = verdict.best
    assert best is not None
    pose = Pose2D(*best.pose.tolist())
    covariance = best.covariance
    if part.graph is None:
        placed = Placed(part, slice(0, 0), pose, covariance, verdict)
        return Merged((*merged.placed, placed), merged.graph)
    count = 0 if base.graph is None else len(base.graph.poses)
    nodes = slice(count, count + len(part.graph.poses))
    if best.joint is not None:
        graph = best.joint.graph
        covariance = best.joint.covariance
    elif base.graph is not None:
        graph = tied_loosely(base.graph, part.graph, best.pose, covariance)
    else:
        graph = part.graph.moved(transform_poses(pose, part.graph.poses))
    added = Placed(part, nodes, pose, covariance, verdict)
    every = [_moved(one, graph) for one in (*merged.placed, added)]
    return Merged(tuple(every), graph)


def _moved(placed: Placed, graph: MapGraph) -> Placed:
    """A part where the joint graph has it now."""
    own = placed.part.graph
    if own is None or placed.verdict is None:
        return placed
    pose = align_se2(own.poses[:, :2], graph.poses[placed.nodes, :2])
    if len(own.poses) < 2:  # a point has no heading
        pose = compose(Pose2D(*graph.poses[placed.nodes.start]), inverse(Pose2D(*own.poses[0])))
    return replace(placed, pose=pose)


def _as_part(merged: Merged, name: str) -> Part:
    """What was merged as one map, to which more is added."""
    if merged.graph is not None and all(one.part.graph is not None for one in merged.placed):
        return Part.of_graph(name, merged.graph)
    return replace(Part.of_picture(name, merged.grid()), graph=merged.graph)
