"""Two maps, or more, become one: where they lie on each other, whether that is sure, and the joint map."""

from dataclasses import dataclass

import numpy as np

from slamgym.core.errors import SlamgymError
from slamgym.core.geometry import wrap_angle
from slamgym.core.types import FloatArray, OccupancyGrid
from slamgym.metrics.trajectory import align_se2
from slamgym.slam.graph.map_graph import MapGraph
from slamgym.slam.graph.relative import moved_by
from slamgym.slam.graph.submaps import Submap
from slamgym.slam.merge.floor import Floor, draw_submaps, graph_floor, picture_floor
from slamgym.slam.merge.joint import join
from slamgym.slam.merge.overlay import COARSE, FINE, FloorFields, agreement
from slamgym.slam.merge.search import find_transforms
from slamgym.slam.merge.verdict import JointVerdict, Odds, Overlay, judge_joint

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
        """A map with its graph.

        Raises:
            SlamgymError: If it shows no wall.
        """
        submaps = draw_submaps(graph)
        floor = graph_floor(graph, submaps)
        return Part(name, graph, submaps, _fields(name, floor))

    @staticmethod
    def of_picture(name: str, grid: OccupancyGrid) -> "Part":
        """A bare map.

        Raises:
            SlamgymError: If it shows no wall.
        """
        return Part(name, None, [], _fields(name, picture_floor(grid)))


def _fields(name: str, floor: Floor) -> FloorFields:
    if len(floor.surfaces.points) == 0:
        raise SlamgymError(
            f"{name}: has no wall beside free floor: nothing can be laid on it; check its thresholds"
        )
    return FloorFields(floor)


def compare_parts(first: Part, second: Part, odds: Odds) -> JointVerdict:
    """Find where one map lies on another, and judge it."""
    transforms = find_transforms(first.floor, second.floor)
    aligned = []
    for hypothesis in _placed_roughly(first, second, odds, transforms):
        pose, covariance = first.fields.align(second.floor.surfaces, hypothesis.pose)
        aligned.append(_rigid(first, second, odds, pose, covariance, FINE))
    best = best_places(aligned, second, odds, MOST_JOINED)
    join_at = _joined if first.submaps and second.submaps else _bent
    joined = [join_at(first, second, odds, hypothesis) for hypothesis in best]
    return judge_joint(best_places(joined, second, odds, MOST_JOINED), odds)  # some have met


def _bent(first: Part, second: Part, odds: Odds, hypothesis: Overlay) -> Overlay:
    """The same with each part of a picture laid by itself."""
    said = agreement(first.fields, second.fields, hypothesis.pose, FINE, is_bent=True)
    return hypothesis._replace(agreement=said, evidence=odds.evidence(said))


def _placed_roughly(
    first: Part, second: Part, odds: Odds, transforms: list[FloatArray]
) -> list[Overlay]:
    """The best of some places (3,); as few as possible are looked at closely."""
    fields = (first.fields, second.fields)
    said = [agreement(*fields, pose, COARSE, tells_walls=False) for pose in transforms]
    bounds = np.array([odds.bound(one) for one in said])
    unknown = np.zeros((3, 3))
    judged: list[Overlay] = []
    for count, number in enumerate(np.argsort(-bounds, kind="stable").tolist()):
        if count % MOST_ALIGNED == 0:
            best = best_places(judged, second, odds, MOST_ALIGNED)
            if len(best) >= MOST_ALIGNED and best[MOST_ALIGNED - 1].evidence > bounds[number]:
                break
        judged.append(_rigid(first, second, odds, transforms[number], unknown, COARSE))
    return best_places(judged, second, odds, MOST_ALIGNED)


def _rigid(
    first: Part, second: Part, odds: Odds, pose: FloatArray, covariance: FloatArray, tolerance: int
) -> Overlay:
    said = agreement(first.fields, second.fields, pose, tolerance)
    return Overlay(pose, covariance, said, odds.evidence(said))


def best_places(hypotheses: list[Overlay], second: Part, odds: Odds, most: int) -> list[Overlay]:
    """The best of some ways, each clearly different from those before, and that with most agreement.

    The walls of large maps that bend contradict each other even where the maps belong, until these are joined.
    """
    ranked = sorted(hypotheses, key=lambda hypothesis: -hypothesis.evidence)
    kept = _distinct(ranked, second, most)
    favoured = sorted(hypotheses, key=lambda hypothesis: -odds.bound(hypothesis.agreement))
    return _distinct(kept + favoured[:1], second, most + 1)


def _distinct(ranked: list[Overlay], second: Part, most: int) -> list[Overlay]:
    """The first of some ways, each clearly different from those before."""
    middle = np.array([*second.floor.surfaces.points.mean(axis=0), 0.0])
    kept: list[Overlay] = []
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


def _joined(first: Part, second: Part, odds: Odds, hypothesis: Overlay) -> Overlay:
    """The same once the graphs are one; nothing speaks for it if no submap can be aligned there."""
    assert first.graph is not None
    assert second.graph is not None
    submaps = (first.submaps, second.submaps)
    joint = join(first.graph, second.graph, submaps, hypothesis.pose)
    if joint is None:
        return hypothesis._replace(evidence=min(hypothesis.evidence, 0.0))
    parts = joint.parts(first.graph, second.graph)
    one, other = (
        FloorFields(graph_floor(graph, own, has_views=False))
        for graph, own in zip(parts, submaps, strict=True)
    )
    said = agreement(one, other, np.zeros(3), FINE)
    pose = np.array(align_se2(second.graph.poses[:, :2], parts[1].poses[:, :2]))
    return hypothesis._replace(pose=pose, agreement=said, evidence=odds.evidence(said), joint=joint)
