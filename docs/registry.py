"""The registry of terms and measures, from which docs/glossary.md and docs/metrics.md are made.

``python docs/registry.py`` writes both pages; ``tests/test_docs.py`` holds them to this file and each home to the code.
"""

from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent


@dataclass(frozen=True)
class Term:
    """A word of the field as slamgym uses it."""

    name: str
    meaning: str
    home: str
    """Where it lives in the code: ``module:name``."""


@dataclass(frozen=True)
class Measure:
    """A number that results are judged by."""

    name: str
    formula: str
    unit: str
    better: str
    """``lower`` or ``higher``; empty where neither is."""
    home: str
    """The function or the field that holds it: ``module:name``."""
    source: str = ""


TERMS = [
    Term("CAD map", "rasterised floor plan: walls and outside black, floor white; image A of a pair", "slamgym.dataset.record:MapPair"),
    Term("completion detector", "decides from the robot's own map that no reachable place is left to explore", "slamgym.envs.completion:CompletionDetector"),
    Term("costmap", "occupancy grid with obstacles inflated by the robot's radius", "slamgym.planning.costmap:Costmap"),
    Term("coverage", "share of the reachable floor that the scanner has seen", "slamgym.envs.coverage:Coverage"),
    Term("coverage tour", "short tour of viewpoints that shows a whole building, planned on the true plan", "slamgym.agents.coverage_tour:TourSearch"),
    Term("discriminator", "network that separates real outputs from generated ones", "slamgym.gan.networks.discriminators"),
    Term("episode", "one exploration from start to end, with its records", "slamgym.envs.episode:Episode"),
    Term("exploration loop", "offers frontiers, drives to the chosen one, and decides when to choose again and when to stop", "slamgym.planning.exploration_loop:ExplorationLoop"),
    Term("explorer", "policy that drives a robot through an unknown building", "slamgym.agents.registry:make_explorer"),
    Term("fault", "reason why a pair is unfit: kind, value and limit", "slamgym.dataset.faults:MapFault"),
    Term("floor share", "share of a cell that is floor: grey values place walls within cells", "slamgym.cad.floorplan:floor_share"),
    Term("frontier", "border between reachable known space and unknown space (Yamauchi 1997)", "slamgym.planning.frontiers:find_frontiers"),
    Term("frontier candidate", "part of a frontier with a path to it, offered as a choice", "slamgym.planning.frontier_candidates:FrontierCandidate"),
    Term("hit-count map", "counts, per cell, the beams that ended in it and crossed it; the published map", "slamgym.slam.hit_counts:HitCountMap"),
    Term("map frame", "frame of the robot's belief: origin at the start, axes parallel to the world's", "slamgym.core.types:GridFrame"),
    Term("map pair", "a CAD map (A) and a SLAM map (B) of the same building in one frame", "slamgym.dataset.record:MapPair"),
    Term("mapper", "SLAM method that processes scans one by one", "slamgym.slam.mapper:Mapper"),
    Term("odometry level", "named size of wheel odometry errors", "slamgym.sim.wheel_odometry:odometry_level"),
    Term("oracle", "lower bound of the time that a robot with the floor plan needs", "slamgym.agents.oracle:bound_exploration"),
    Term("parametric model", "the paper's: bends a CAD map as SLAM would, without scans", "slamgym.parametric.model:deform"),
    Term("plan cache", "floor plans prepared for exploration, and the source of the next one", "slamgym.envs.plan_cache:PlanCache"),
    Term("pose graph", "scans as nodes, matches as edges, solved by least squares; closes loops globally", "slamgym.slam.graph.mapper:PoseGraphMapper"),
    Term("promise", "a stopping criterion: least share of the floor seen, with its certainty: `98%:95%`", "slamgym.planning.promise:Promise"),
    Term("RBPF", "Rao-Blackwellised particle filter: each particle has its own path and map, as in GMapping", "slamgym.slam.particle_filter:ParticleFilter"),
    Term("recipe", "distributions from which each exploration's settings are sampled", "slamgym.dataset.generate.recipe:Recipe"),
    Term("recovery behaviour", "action tried before an exploration ends because no candidate is left", "slamgym.planning.recovery:RecoveryBehaviours"),
    Term("rule", "function that scores the candidates of the exploration loop", "slamgym.agents.rules"),
    Term("SLAM map", "the robot's map: 0 occupied, 205 unknown, 254 free; image B of a pair", "slamgym.core.types:OccupancyGrid"),
    Term("tail", "time from 99 % of the floor seen until the explorer is done", "slamgym.agents.evaluation.summary:tail"),
]  # fmt: skip

MEASURES = [
    Measure("absolute trajectory error (ATE)", "rmse of |x_i - T y_i| over the moments i, T the best rigid motion", "m, rad", "lower", "slamgym.metrics.trajectory:absolute_trajectory_error", "Sturm et al. 2012"),
    Measure("relative pose error (RPE)", "rmse of the motions over a fixed time, estimated against true", "m, rad", "lower", "slamgym.metrics.trajectory:relative_pose_error", "Sturm et al. 2012"),
    Measure("NEES", "e^T P^-1 e of the pose error e and the reported covariance P; 3 on average if P is right", "", "", "slamgym.metrics.trajectory:normalised_estimation_error_squared", "Bar-Shalom, Li and Kirubarajan 2001, section 5.4"),
    Measure("relation error", "mean of |(x_j - x_i) - d_ij| over the given relations", "m, rad", "lower", "slamgym.metrics.trajectory:relation_error", "Kuemmerle et al. 2009"),
    Measure("mean squared error", "mean (a - b)^2 over the pixels of the free space, 1 where free", "", "lower", "slamgym.metrics.maps:squared_error", "the paper's Table I"),
    Measure("aligned error (MSE1, MSE2)", "the mean squared error after the best similarity transform", "", "lower", "slamgym.metrics.alignment:aligned_error", "the paper's Table I"),
    Measure("improvement", "MSE2 - MSE1: how much nearer the translated map lies to the CAD map than the SLAM map", "", "higher", "slamgym.metrics.improvement:improvement", "the paper's Fig. 6"),
    Measure("wall F1", "harmonic mean of the shares of the map's walls near a true wall and of the true walls near one of the map's", "", "higher", "slamgym.metrics.maps:wall_score"),
    Measure("boundary F1 at 5, 10 cm", "wall F1 of the boundaries of the free space", "", "higher", "slamgym.metrics.maps:boundary_score"),
    Measure("Hausdorff 95", "95th percentile of the distances between two sets of walls", "m", "lower", "slamgym.metrics.maps:boundary_distance"),
    Measure("intersection over union", "free in both / free in either", "", "higher", "slamgym.metrics.maps:intersection_over_union"),
    Measure("room F1", "F1 of the rooms that have a counterpart with an intersection over union above 0.5", "", "higher", "slamgym.metrics.rooms:room_score", "Zheng et al. 2020 (Structured3D)"),
    Measure("rigidly aligned error", "the mean squared error after the best rigid motion, which can't enlarge a drawing until it fits", "", "lower", "slamgym.metrics.alignment:aligned_error"),
    Measure("room width error", "distance of two facing walls of one room, drawn less true, along lines between them; faces within cells", "m", "", "slamgym.metrics.dimensions:Dimensions"),
    Measure("wall length error", "length of a straight face, drawn less true; holes shorten it", "m", "", "slamgym.metrics.dimensions:Dimensions"),
    Measure("wall thickness error", "thickness of a wall with floor on both sides, drawn less true", "m", "", "slamgym.metrics.dimensions:Dimensions"),
    Measure("floor area ratio", "drawn over true floor area", "", "", "slamgym.metrics.dimensions:Dimensions"),
    Measure("doors kept, door width error", "openings between two true rooms that the drawing leaves open; their clear width, drawn less true", ", m", "", "slamgym.metrics.openings:Openings"),
    Measure("walls opened", "pairs of rooms facing each other across a wall in which the drawing has a hole of 30 cm or more; the holes are invented doors", "", "lower", "slamgym.metrics.openings:Openings"),
    Measure("floor never seen", "share of the drawn floor where the robot's map is unknown", "", "lower", "slamgym.metrics.openings:unseen_share"),
    Measure("pace", "time until done over the par time of the plan, 60 s and 3 s for each m^2; a failure counts as the time limit", "", "lower", "slamgym.agents.bench.results:BenchRow"),
    Measure("interquartile mean", "mean of the middle half of all runs on all plans", "", "", "slamgym.core.intervals:interquartile_mean", "Agarwal et al. 2021"),
    Measure("probability of improvement", "share of the pairs of runs on the same plan in which ours is smaller, ties half", "", "higher", "slamgym.core.intervals:probability_of_improvement", "Agarwal et al. 2021"),
    Measure("wall error", "mean distance of a map's occupied cells from the nearest face of a CAD wall; furniture is no part of it", "m", "lower", "slamgym.metrics.map_error:wall_error"),
    Measure("obstacle distance (map error)", "mean distance of a map's occupied cells from the nearest true obstacle, furniture included", "m", "lower", "slamgym.metrics.map_error:ObstacleDistance"),
    Measure("open border", "share of the cells bordering free space (4-neighbours) that are unknown", "", "", "slamgym.metrics.map_statistics:open_border"),
    Measure("look statistics", "shares of free, occupied and unknown; blobs, holes and rays per 100 m2; wall thickness, tilt and straightness; 2 x 2 patterns; at 5 cm cells over the map cut to its largest free part", "", "", "slamgym.metrics.map_statistics:look_statistics"),
    Measure("free fragments", "connected parts (4-neighbours) of the free space beside the largest, per 100 m2", "1/100 m^2", "", "slamgym.metrics.map_statistics:free_fragments"),
    Measure("balanced accuracy (two-sample test)", "mean of the accuracies on both kinds, held out by building; 0.5 if a learner can't tell them apart", "", "", "slamgym.metrics.two_sample:distinguish", "Lopez-Paz and Oquab 2017"),
    Measure("null of a set", "balanced accuracy between halves of one set's buildings", "", "", "slamgym.metrics.two_sample:half_against_half"),
]  # fmt: skip


def glossary() -> str:
    """docs/glossary.md."""
    rows = "\n".join(
        f"| **{term.name}** | {term.meaning} | `{term.home.replace(':', '.')}` |" for term in TERMS
    )
    return (
        "# Glossary\n\nTerms as slamgym uses them, and their place in the code. Measures: [metrics.md](metrics.md).\n"
        f"Made by `python docs/registry.py`.\n\n| term | meaning | code |\n|---|---|---|\n{rows}\n"
    )


def metrics() -> str:
    """docs/metrics.md."""
    bar = "\\|"  # else it would end the cell
    rows = "\n".join(
        f"| **{m.name}** | {m.formula.replace('|', bar)} | {m.unit or '-'} | {m.better or '-'} | `{m.home.replace(':', '.')}` | {m.source} |"
        for m in MEASURES
    )
    return (
        "# Measures\n\nWhat results are judged by: each measure once. Made by `python docs/registry.py`.\n\n"
        f"| measure | formula | unit | better | function | source |\n|---|---|---|---|---|---|\n{rows}\n"
    )


PAGES = {"glossary.md": glossary, "metrics.md": metrics}

if __name__ == "__main__":
    for name, page in PAGES.items():
        (HERE / name).write_text(page())
