"""Lay SLAM maps over their CAD maps before a translator learns from them.

A SLAM map starts where the robot starts, and drift shifts and turns it as a whole. No network can know from the map
how far it is off, and the evaluation doesn't ask (it aligns every translation); unaligned pairs only teach it to blur
walls over all the places where they might be. Of the error of simulated pairs two fifths are of this kind
(docs/notes/translators.md).

The motion is rigid. A laser measures metres, and what a scaling would make up for is that a map's free space ends a
hit before the wall: exactly what the network shall learn to add.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load, save

from slamgym.core.errors import InputFileError
from slamgym.core.files import read_bytes, write_bytes
from slamgym.core.progress import show_progress
from slamgym.core.types import FREE, ByteArray, FloatArray
from slamgym.gan.data import PairSet
from slamgym.metrics.alignment import IDENTITY, Similarity, apply_similarity, search_similarities
from slamgym.metrics.maps import squared_error
from slamgym.metrics.wall_direction import transformed


def registered(pairs: PairSet, cache: Path | None = None, checksum: str = "") -> PairSet:
    """The pairs with each SLAM map moved onto its CAD map by the rigid motion that brings the free spaces nearest.

    Args:
        pairs: Rendered pairs; CAD maps stay as they are.
        cache: File to keep the motions in (50 ms each to find); None keeps nothing.
        checksum: Of the pairs: a file of others is replaced.
    """
    found = _cached(cache, checksum, len(pairs))
    if found is None:
        found = _nearest_motions(pairs)
        if cache is not None:
            write_bytes(cache, save({checksum: found}))
    if len(pairs) == 0:
        return pairs
    slam = []
    for cells, row in zip(pairs.slam, found.tolist(), strict=True):
        slam.append(moved(cells, Similarity(*row)))
    return replace(pairs, slam=np.stack(slam))


def _nearest_motions(pairs: PairSet) -> FloatArray:
    """The motion of each pair, (N, 4)."""
    rows = []
    with show_progress("alignments", 0, len(pairs)) as advance:
        for cad, slam in zip(pairs.cad, pairs.slam, strict=True):
            rows.append(nearest_motion(slam, cad))
            advance()
    return np.array(rows, dtype=np.float64).reshape(len(pairs), 4)


def nearest_motion(slam: ByteArray, cad: ByteArray) -> Similarity:
    """The rigid motion that brings a SLAM map nearest to its CAD map; the identity where none does better.

    Drift is small, so the search starts from the maps as they lie, unlike that of the evaluation, which must find
    any turn.

    Args:
        slam: (S, S): 0, 205, 254.
        cad: (S, S): 0 walls and outside, 254 inside.
    """
    free = (slam == FREE).astype(np.float64)
    inside = (cad > FREE // 2).astype(np.float64)
    best = IDENTITY
    error = squared_error(free, inside)
    if free.any() and inside.any():
        found = search_similarities(
            free, inside, start_angles=1, coarse_starts=0, fine_starts=1, scaling=False
        )
        for similarity in found:
            candidate = squared_error(apply_similarity(free, similarity), inside)
            if candidate < error:
                best = similarity
                error = candidate
    return best


def moved(slam: ByteArray, similarity: Similarity) -> ByteArray:
    """A SLAM map after a motion: nearest cells, unknown from beyond the border."""
    if similarity == IDENTITY:
        return slam
    rows, cols = slam.shape
    cells = transformed(slam, similarity.matrix(rows, cols))
    return np.asarray(cells, dtype=np.uint8)


def _cached(cache: Path | None, checksum: str, count: int) -> FloatArray | None:
    """The motions in a file, (N, 4), if it was written for the same pairs."""
    if cache is None or not cache.is_file():
        return None
    try:
        found = load(read_bytes(cache)).get(checksum)
    except (SafetensorError, InputFileError, KeyError):
        return None  # for any cause, finding them again is right
    if found is None or found.dtype != np.float64 or found.shape != (count, 4):
        return None
    if not np.isfinite(found).all():
        return None
    return found
