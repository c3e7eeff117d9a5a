"""Which pictures an evaluation draws: chosen by the order of names, never by the results.

Maps of real robots are shown next to their translations, only to be looked at, since they have no CAD maps.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slamgym.core.types import FREE, OCCUPIED, BoolArray, ByteArray, FloatArray
from slamgym.gan.data import PairSet
from slamgym.gan.evaluation.evaluate import (
    RAW,
    THRESHOLD,
    MapScore,
    TranslationMethod,
    aligned_mask,
    evenly_spaced,
)
from slamgym.gan.evaluation.generated_maps import GeneratedMaps
from slamgym.metrics import aligned_error
from slamgym.viz.canvas import write_picture
from slamgym.viz.plots import plot_boxes
from slamgym.viz.sheets import draw_agreement, draw_grid


@dataclass(frozen=True)
class Results:
    """Measured pairs, methods, and their scores."""

    pairs: PairSet
    methods: Sequence[TranslationMethod]
    """Those to be shown; the raw SLAM map is the first."""
    scores: dict[str, list[MapScore]]
    """By method, in the order of the pairs."""

    def caption(self, index: int, measure: str, title: str) -> str:
        """Name and scale of a pair, and what the methods reached on it."""
        values = []
        for method in self.methods:
            score = self.scores[method.name][index]
            values.append(f"{method.name} {score[measure]:.3g}")
        return f"{_caption(self.pairs, index)}; {title}: {', '.join(values)}"


def write_pictures(folder: Path, results: Results, count: int) -> None:
    """Write the pictures of an evaluation.

    ``maps.png`` (as the paper's Fig. 4) shows SLAM map, every method and the CAD map; ``overlays.png`` (Fig. 5) each
    method laid over the CAD map; ``differences.png`` (Fig. 6) the box plot.

    Args:
        folder: Where to.
        results: What to show.
        count: Rows of the first two.
    """
    chosen = evenly_spaced(len(results.pairs), count)
    _write_grids(folder, results, chosen)
    errors_of_raw = _errors(results.scores[RAW])
    gains = {}
    for method in results.methods[1:]:
        gains[method.name] = errors_of_raw - _errors(results.scores[method.name])
    label = "MSE2 - MSE1 (positive: nearer to the CAD map than the SLAM map is)"
    plot_boxes(folder / "differences.png", gains, label)


def _write_grids(folder: Path, results: Results, chosen: Sequence[int]) -> None:
    """Write ``maps.png`` and ``overlays.png`` of the chosen pairs."""
    pairs = results.pairs
    names = [method.name for method in results.methods]
    maps = []
    overlays = []
    for i in chosen:
        truth: BoolArray = pairs.cad[i] > 127
        masks = [np.asarray(method.predict(pairs, i)) >= THRESHOLD for method in results.methods]
        drawings = [_drawn(mask) for mask in masks[1:]]
        maps.append([pairs.slam[i], *drawings, pairs.cad[i]])
        aligned = [_aligned(mask, truth) for mask in masks]
        overlays.append([draw_agreement(mask, truth) for mask in aligned])
    captions = [results.caption(i, "mse", "aligned MSE") for i in chosen]
    grid = draw_grid([*names, "CAD map"], maps, captions)
    write_picture(folder / "maps.png", grid)
    captions = [results.caption(i, "wall_f1_10cm", "wall F1 10 cm") for i in chosen]
    grid = draw_grid(names, overlays, captions)
    write_picture(folder / "overlays.png", grid)


def _errors(scores: Sequence[MapScore]) -> FloatArray:
    return np.array([score.mse for score in scores])


def write_generated_grid(
    path: Path, pairs: PairSet, kinds: dict[str, GeneratedMaps], count: int
) -> None:
    """CAD map, every kind of generated map, simulated map (as the paper's Fig. 7 and 9).

    Args:
        path: PNG file.
        pairs: The pairs.
        kinds: By name; black where a pair has none.
        count: Rows.
    """
    chosen = evenly_spaced(len(pairs), count)
    black = np.zeros_like(pairs.cad[0])
    rows = []
    for i in chosen:
        generated = [maps.get(i, black) for maps in kinds.values()]
        rows.append([pairs.cad[i], *generated, pairs.slam[i]])
    headings = ["CAD map", *kinds, "simulated SLAM map"]
    captions = [_caption(pairs, i) for i in chosen]
    write_picture(path, draw_grid(headings, rows, captions))


def _aligned(mask: BoolArray, truth: BoolArray) -> BoolArray:
    found = aligned_error(mask.astype(np.float64), truth.astype(np.float64))
    return aligned_mask(mask, found.similarity)


def _caption(pairs: PairSet, index: int) -> str:
    return f"{pairs.names[index][:14]}, {pairs.metres_per_px[index]:.3f} m/px"


def _drawn(free: np.ndarray) -> ByteArray:
    return np.where(free, FREE, OCCUPIED).astype(np.uint8)
