"""Lay SLAM maps over their CAD maps before a translator learns from them.

A SLAM map starts where the robot starts, and drift shifts, turns and scales it as a whole. No network can know from
the map how far it is off, and the evaluation doesn't ask (it aligns every translation by a similarity); unaligned
pairs only teach it to blur walls over all the places where they might be. Of the error of simulated pairs two fifths
are of this kind (docs/gan_training.md).
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load, save

from slamgym.core.files import write_bytes
from slamgym.core.progress import show_progress
from slamgym.core.types import FREE, ByteArray, FloatArray
from slamgym.gan.data import PairSet
from slamgym.gan.translation.derotation import transformed
from slamgym.metrics.alignment import IDENTITY, Similarity, apply_similarity, search_similarities
from slamgym.metrics.maps import squared_error

MAX_SCALING = 0.04
"""Logarithm of the largest scaling that is believed. A laser measures metres, so drift hardly scales a map; what asks
for more is a map that was broken off, stretched over rooms that it doesn't show."""


def registered(pairs: PairSet, cache: Path | None = None, checksum: str = "") -> PairSet:
    """The pairs with each SLAM map moved onto its CAD map by the similarity that brings the free spaces nearest.

    Args:
        pairs: Rendered pairs; CAD maps stay as they are.
        cache: File to keep the similarities in (20 ms each to find); None keeps nothing.
        checksum: Of the pairs: a file of others is replaced.
    """
    found = _cached(cache, checksum, len(pairs))
    if found is None:
        rows = []
        with show_progress("alignments", 0, len(pairs)) as advance:
            for cad, slam in zip(pairs.cad, pairs.slam, strict=True):
                rows.append(nearest_similarity(slam, cad))
                advance()
        found = np.array(rows, dtype=np.float64).reshape(len(pairs), 4)
        if cache is not None:
            write_bytes(cache, save({checksum: found}))
    slam = [moved(cells, Similarity(*row)) for cells, row in zip(pairs.slam, found.tolist(), strict=True)]
    return replace(pairs, slam=np.stack(slam)) if slam else pairs


def nearest_similarity(slam: ByteArray, cad: ByteArray) -> Similarity:
    """The similarity that brings a SLAM map nearest to its CAD map; the identity where none does better.

    Drift is small, so the search starts from the maps as they lie, unlike that of the evaluation, which must find
    any turn; and what scales the map by more than :data:`MAX_SCALING` isn't taken.

    Args:
        slam: (S, S): 0, 205, 254.
        cad: (S, S): 0 walls and outside, 254 inside.
    """
    free, inside = (slam == FREE).astype(np.float64), (cad > FREE // 2).astype(np.float64)
    best, error = IDENTITY, squared_error(free, inside)
    if free.any() and inside.any():
        for similarity in search_similarities(free, inside, start_angles=1, coarse_starts=0, fine_starts=1):
            if abs(similarity.log_scale) > MAX_SCALING:
                continue
            candidate = squared_error(apply_similarity(free, similarity), inside)
            if candidate < error:
                best, error = similarity, candidate
    return best


def moved(slam: ByteArray, similarity: Similarity) -> ByteArray:
    """A SLAM map after a similarity: nearest cells, unknown from beyond the border."""
    if similarity == IDENTITY:
        return slam
    return np.asarray(transformed(slam, similarity.matrix(*slam.shape)), dtype=np.uint8)


def _cached(cache: Path | None, checksum: str, count: int) -> FloatArray | None:
    """The similarities in a file, (N, 4), if it was written for the same pairs."""
    if cache is None or not cache.is_file():
        return None
    try:
        found = load(cache.read_bytes()).get(checksum)
    except (SafetensorError, OSError, KeyError):
        return None  # whatever it is, finding them again is right
    if found is None or found.dtype != np.float64 or found.shape != (count, 4):
        return None
    return found if np.isfinite(found).all() else None
