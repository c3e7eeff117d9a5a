"""Drawings that are small, or usual, and were slow to read as floor plans; each function writes one into a folder."""

import json
from pathlib import Path

import numpy as np


def open_ring(folder: Path, count: int = 1000) -> Path:
    """A hall round which the walls stand in short pieces, with a gap, as in a drawing of a map."""
    along, length = np.arange(0.0, 30.0, 120.0 / count), 118.0 / count
    along = along[abs(along - 20.0) > 0.5]
    boxes = np.stack([along, 0 * along, along + length, 0 * along + 0.12], axis=1)
    rings = boxes[:, [0, 1, 2, 1, 2, 3, 0, 3, 0, 1]].reshape(-1, 5, 2) - 15.0
    turns = [np.linalg.matrix_power([[0, 1], [-1, 0]], turn) for turn in range(4)]
    walls = np.vstack([rings @ turn for turn in turns]).round(4).tolist()
    return _geojson(folder, {"type": "MultiLineString", "coordinates": walls})


def _geojson(folder: Path, geometry: dict) -> Path:
    path = folder / "a.geojson"
    path.write_text(json.dumps(geometry))
    return path
