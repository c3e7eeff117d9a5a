"""Two maps, or more, become one: where they lie on each other, whether that is sure, and the joint map."""

from dataclasses import dataclass

import numpy as np

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray, OccupancyGrid
from slamgym.slam.graph.map_graph import MapGraph
from slamgym.slam.graph.relative import moved_by
from slamgym.slam.graph.submaps import Submap
from slamgym.slam.merge.floor import Floor, draw_submaps, graph_floor, picture_floor
from slamgym.slam.merge.joint import join
from slamgym.slam.merge.overlay import FloorFields, agreement
from slamgym.slam.merge.search import find_transforms
from slamgym.slam.merge.verdict import Hypothesis, Verdict, judge

COARSE = 0.2
"""Walls agree that are so near, before two maps are aligned [m]."""
FINE = 0.1
"""Walls agree that are so near, once they are [m]: a cell of a submap."""
MOST_ALIGNED = 24
"""So many places are aligned ..."""
MOST_JOINED = 4
"""... and of so many the graph is made."""
OTHER_METRES = 0.5
"""A place is another if the second map's middle lies so far away [m] ..."""
OTHER_TURN = 0.15
"""... or it is turned by so much [rad]."""


@dataclass(frozen=True)
class Part:
    """A map that is to become a part of another."""

    name: str
    graph: MapGraph | None
    """None of a bare picture."""
    submaps: list[Submap]
    fields: FloorFields

    @property
    def floor(self) -> Floor:
        """Its walls and floor."""
        return self.fields.floor

    @staticmethod
    def of_graph(name: str, graph: MapGraph) -> "Part":
        """A map with its graph."""
        submaps = draw_submaps(graph)
        return Part(name, graph, submaps, FloorFields(graph_floor(graph, submaps)))

    @staticmethod
    def of_picture(name: str, grid: OccupancyGrid) -> "Part":
        """A bare map."""
        return Part(name, None, [], FloorFields(picture_floor(grid)))


def compare(first: Part, second: Part) -> Verdict:
    """Find where one map lies on another, and judge it."""
    unknown = np.zeros((3, 3))
    transforms = find_transforms(first.floor, second.floor)
    coarse = [_rigid(first, second, pose, unknown, COARSE) for pose in transforms]
    aligned = []
    for hypothesis in _distinct(coarse, second, MOST_ALIGNED):
        pose, covariance = first.fields.align(second.floor.surfaces, hypothesis.pose)
        aligned.append(_rigid(first, second, pose, covariance, FINE))
    best = _distinct(aligned, second, MOST_JOINED)
    if first.submaps and second.submaps:
        best = [_joined(first, second, hypothesis) for hypothesis in best]
    return judge(best)


def _rigid(
    first: Part, second: Part, pose: FloatArray, covariance: FloatArray, tolerance: float
) -> Hypothesis:
    said = agreement(first.fields, second.fields, pose, tolerance)
    return Hypothesis(pose, said, None, covariance)


def _distinct(hypotheses: list[Hypothesis], second: Part, most: int) -> list[Hypothesis]:
    """The best of some ways, each clearly different from those before."""
    middle = np.array([*second.floor.surfaces.points.mean(axis=0), 0.0])
    ranked = sorted(hypotheses, key=lambda hypothesis: -hypothesis.evidence)
    kept: list[Hypothesis] = []
    places = np.zeros((0, 3))
    for hypothesis in ranked:
        place = moved_by(hypothesis.pose, middle)
        away = np.hypot(*(places - place)[:, :2].T)
        turns = np.abs(wrap_angle(places[:, 2] - place[2]))
        if not ((away < OTHER_METRES) & (turns < OTHER_TURN)).any():
            kept.append(hypothesis)
            places = np.vstack([places, place])
        if len(kept) == most:
            break
    return kept


def _joined(first: Part, second: Part, hypothesis: Hypothesis) -> Hypothesis:
    """The same once the graphs are one; as it was if no submap can be aligned there."""
    assert first.graph is not None
    assert second.graph is not None
    submaps = (first.submaps, second.submaps)
    joint = join(first.graph, second.graph, submaps, hypothesis.pose)
    if joint is None:
        return hypothesis
    parts = joint.parts(first.graph, second.graph)
    one, other = (FloorFields(graph_floor(graph, draw_submaps(graph))) for graph in parts)
    said = agreement(one, other, np.zeros(3), FINE)
    return hypothesis._replace(agreement=said, joint=joint)
