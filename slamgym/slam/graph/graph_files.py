"""A map's graph as files: ``graph.g2o`` for every tool that reads g2o, and ``scans.npz`` with what the nodes saw.

``graph.g2o`` has a line ``VERTEX_SE2 id x y theta`` for each node and ``EDGE_SE2 id id x y theta`` with the upper
triangle of the information for each edge (Kuemmerle et al., *g2o: A General Framework for Graph Optimization*, ICRA
2011).
"""

import json
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.core.config import from_dict, to_dict
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import require_file, staged, text_lines, write_text
from slamgym.core.limits import FILE_BYTES
from slamgym.core.types import FloatArray, LaserGeometry, Pose2D
from slamgym.slam.config import SlamConfig
from slamgym.slam.graph.map_graph import DriveScans, MapGraph
from slamgym.slam.graph.solver import Edges

GRAPH = "graph.g2o"
NODE_SCANS = "scans.npz"
VERSION = 1
"""Of both files; others are refused."""
_UPPER = np.triu_indices(3)
_NODE = "VERTEX_SE2"
_EDGE = "EDGE_SE2"


def write_graph(folder: Path, graph: MapGraph) -> None:
    """Write both files.

    Raises:
        StorageError: If they can't be written.
    """
    drives = []
    arrays: dict[str, Any] = {"submaps": graph.submaps, "widths": graph.edges.width}
    for number, drive in enumerate(graph.drives):
        config = to_dict(drive.config)
        drives.append({"first": drive.first, "laser": drive.geometry, "config": config})
        arrays[f"stamps_{number}"] = drive.stamps
        arrays[f"ranges_{number}"] = drive.ranges
    arrays["head"] = np.array(json.dumps({"version": VERSION, "drives": drives}))
    with staged(folder / NODE_SCANS) as part, part.open("wb") as file:
        np.savez_compressed(file, **arrays)
    # The graph goes last: where it is, the scans are complete.
    write_text(folder / GRAPH, "".join(_g2o_lines(graph)))


def _g2o_lines(graph: MapGraph) -> Iterator[str]:
    yield f"# slamgym graph {VERSION}\n"
    for node, (x, y, heading) in enumerate(graph.poses.tolist()):
        yield f"{_NODE} {node} {x:.9g} {y:.9g} {heading:.9g}\n"
    yield "FIX 0\n"
    edges = graph.edges
    rows, cols = _UPPER
    numbers = np.hstack([edges.measured, edges.information[:, rows, cols]])
    for first, second, values in zip(edges.first, edges.second, numbers.tolist(), strict=True):
        text = " ".join(f"{value:.9g}" for value in values)
        yield f"{_EDGE} {first} {second} {text}\n"


def read_graph(folder: Path) -> MapGraph:
    """Read what :func:`write_graph` wrote.

    Raises:
        InputFileError: If a file is missing, broken or of another version, or both don't belong together.
    """
    poses, ends, values = _read_g2o(folder / GRAPH)
    path = folder / NODE_SCANS
    require_file(path)
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(info.file_size for info in archive.infolist())
        if size > FILE_BYTES.value:
            raise InputFileError(
                path, f"holds {size} bytes, more than {FILE_BYTES.variable} allows"
            )
        with np.load(path, allow_pickle=False) as held:
            head = json.loads(str(held["head"]))
            if head["version"] != VERSION:
                raise InputFileError(
                    path, f"is of version {head['version']}, not {VERSION}; map the log anew"
                )
            submaps = held["submaps"].astype(np.int64)
            widths = held["widths"].astype(np.float64)
            drives = tuple(
                _drive(entry, number, held) for number, entry in enumerate(head["drives"])
            )
    except (zipfile.BadZipFile, OSError, KeyError, ValueError, TypeError, ConfigError) as error:
        raise InputFileError(
            path, f"holds no scans of slamgym ({error}); map the log anew"
        ) from error
    count = sum(len(drive.stamps) for drive in drives)
    if (
        count != len(poses)
        or len(widths) != len(ends)
        or not _is_whole(drives, submaps, ends, count)
    ):
        raise InputFileError(path, f"doesn't belong to {folder / GRAPH}; map the log anew")
    information = np.empty((len(ends), 3, 3))
    rows, cols = _UPPER
    information[:, rows, cols] = values[:, 3:]
    information[:, cols, rows] = values[:, 3:]
    edges = Edges(
        first=ends[:, 0],
        second=ends[:, 1],
        measured=values[:, :3].copy(),
        information=information,
        design=np.zeros_like(information),
        width=widths,
    )
    return MapGraph(poses, edges, submaps, drives)


def _is_whole(
    drives: tuple[DriveScans, ...], submaps: np.ndarray, ends: np.ndarray, count: int
) -> bool:
    """True if all numbers of nodes are those of nodes, and the drives follow each other."""
    first = 0
    for drive in drives:
        if drive.first != first or drive.ranges.shape != (
            len(drive.stamps),
            drive.geometry.num_beams,
        ):
            return False
        first += len(drive.stamps)
    numbers = np.concatenate([ends.ravel(), submaps[:, 0], submaps[:, 1] - 1])
    return count > 0 and bool(((numbers >= 0) & (numbers < count)).all())


def _drive(entry: Any, number: int, held: Any) -> DriveScans:
    beams, *numbers, mount, each = entry["laser"]
    first, step, nearest, farthest = map(float, numbers)
    place = Pose2D(*map(float, mount))
    geometry = LaserGeometry(int(beams), first, step, nearest, farthest, place, float(each))
    return DriveScans(
        first=int(entry["first"]),
        stamps=held[f"stamps_{number}"].astype(np.float64),
        ranges=held[f"ranges_{number}"].astype(np.float32),
        geometry=geometry,
        config=from_dict(SlamConfig, entry["config"]),
    )


def _read_g2o(path: Path) -> tuple[FloatArray, np.ndarray, FloatArray]:
    """Poses (N, 3) of the nodes, ends (E, 2) of the edges, and their measurements and information (E, 9)."""
    poses: list[list[float]] = []
    ends: list[tuple[int, int]] = []
    values: list[list[float]] = []
    for line, where in text_lines(path):
        word, *rest = line.split() or ["#"]
        if word.startswith("#") and "slamgym graph" in line and rest[-1] != str(VERSION):
            raise InputFileError(path, f"is of version {rest[-1]}, not {VERSION}; map the log anew")
        try:
            if word == _NODE and int(rest[0]) == len(poses):
                poses.append(_numbers(rest[1:], 3))
            elif word == _EDGE:
                ends.append((int(rest[0]), int(rest[1])))
                values.append(_numbers(rest[2:], 9))
            elif not word.startswith("#") and word != "FIX":
                raise ValueError
        except (ValueError, IndexError) as error:
            raise InputFileError(
                where,
                f"is no line of a planar g2o graph whose nodes are numbered from 0: {line[:60].strip()!r}",
            ) from error
    return (
        np.array(poses, dtype=np.float64).reshape(-1, 3),
        np.array(ends, dtype=np.int64).reshape(-1, 2),
        np.array(values, dtype=np.float64).reshape(-1, 9),
    )


def _numbers(words: list[str], count: int) -> list[float]:
    numbers = [float(word) for word in words]
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise ValueError
    return numbers
