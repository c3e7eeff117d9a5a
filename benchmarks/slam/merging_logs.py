"""Recorded logs cut in two and merged again: what the relations of the whole log come to.

    python benchmarks/slam/merging_logs.py LOGS CACHE

The halves have no scan in common, and start where nothing is known. *Together* are the relations between the poses of
the merged graph, *uncut* those of the whole log, both at the moments of its nodes. ACES and CSAIL have none of their
own: there the mean distance between the two paths stands, laid on each other. Maps are kept in the cache.
"""

import argparse
import dataclasses
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

from slamgym.core.geometry import transform_points
from slamgym.core.types import FloatArray, Trajectory
from slamgym.interop import Log, Relations, open_log, read_relations
from slamgym.metrics import relation_error
from slamgym.metrics.trajectory import align_se2
from slamgym.slam import SlamConfig
from slamgym.slam.graph.graph_files import GRAPH, read_graph, write_graph
from slamgym.slam.graph.map_graph import MapGraph
from slamgym.slam.merge.merged import Merged, merge_parts
from slamgym.slam.merge.merging import Part
from slamgym.slam.replay import replay

MODULES = ("slamgym/slam/merge", "slamgym/slam/graph")
"""What is measured."""
LOGS = ("intel", "freiburg-079", "aces", "csail")
COLUMNS = (
    "log", "sure", "uncut [m]", "together [m]", "together / uncut", "relations", "paths apart [m]", "evidence [nats]",
    "margin [nats]", "CPU s",
)  # fmt: skip


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("logs", type=Path)
    parser.add_argument("cache", type=Path)
    arguments = parser.parse_args()
    rows = [log_row(arguments.logs, name, arguments.cache) for name in LOGS]
    title = "logs cut in two and merged"
    print_and_save("slam/merging_logs", title, rows, COLUMNS, MODULES, times=("CPU s",))


def mapped(log: Log, folder: Path) -> MapGraph:
    """The graph of a log, from the cache, or made and put there."""
    if not (folder / GRAPH).exists():
        config = SlamConfig.for_log(log.geometry.range_max, log.geometry.num_beams)
        graph = replay(log, config, np.random.default_rng(0)).graph
        assert graph is not None
        folder.mkdir(parents=True, exist_ok=True)
        write_graph(folder, graph)
    return read_graph(folder)


def log_row(logs: Path, name: str, cache: Path) -> dict[str, Any]:
    """A recorded log cut in two, and merged."""
    log = open_log(logs / f"{name}.log.gz")
    half = len(log) // 2
    cuts = (log.records[:half], log.records[half:])
    whole = path_of(mapped(log, cache / f"{name}_whole"))
    graphs = [
        mapped(dataclasses.replace(log, records=cut, recorded_track=None), cache / f"{name}_{part}")
        for part, cut in enumerate(cuts)
    ]
    begin = time.process_time()
    parts = [Part.of_graph(str(number), graph) for number, graph in enumerate(graphs)]
    merged = merge_parts(parts, guess=True)
    seconds = time.process_time() - begin
    assert isinstance(merged, Merged)
    assert merged.graph is not None
    verdict = merged.placed[1].verdict
    assert verdict is not None
    assert verdict.best is not None
    joint = path_of(merged.graph)
    found: dict[str, Any] = {
        "log": name,
        "sure": not verdict.doubt,
        "paths apart [m]": round(apart(joint, whole), 3),
        "evidence [nats]": round(verdict.best.evidence, 1),
        "margin [nats]": round(min(verdict.best.evidence - verdict.rival, 1e3), 1),
        "CPU s": round(seconds, 1),
    }
    if (logs / f"{name}.relations").exists():
        known = read_relations(logs / f"{name}.relations")
        (uncut, _), (together, count) = (mean_error(path, known) for path in (whole, joint))
        found |= {
            "uncut [m]": round(uncut, 4),
            "together [m]": round(together, 4),
            "together / uncut": round(together / uncut, 3),
            "relations": count,
        }
    print(found, file=sys.stderr, flush=True)
    return {column: found.get(column) for column in COLUMNS}


def path_of(graph: MapGraph) -> Trajectory:
    """The nodes of a graph in the order of time."""
    stamps = np.concatenate([drive.stamps for drive in graph.drives])
    return Trajectory(stamps, graph.poses)


def mean_error(path: Trajectory, known: Relations) -> tuple[float, int]:
    """Mean error of relations [m], and how many there are."""
    error = relation_error(path, known.start_stamps, known.end_stamps, known.relative).translation
    return error.mean, error.count


def apart(path: Trajectory, reference: Trajectory) -> float:
    """Mean distance of a path from another at the same moments, once it is laid on it [m]."""
    there = at_times(reference, path.stamps)
    placed = transform_points(align_se2(path.poses[:, :2], there), path.poses[:, :2])
    return float(np.hypot(*(placed - there).T).mean())


def at_times(path: Trajectory, stamps: FloatArray) -> FloatArray:
    """Places (N, 2) of a path at some times."""
    x, y = (np.interp(stamps, path.stamps, path.poses[:, axis]) for axis in (0, 1))
    return np.column_stack([x, y])


if __name__ == "__main__":
    main()
