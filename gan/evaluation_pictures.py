"""Which pictures an evaluation draws: chosen by the order of names or by the worst results, never by the best."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gan.data import PairSet
from gan.evaluate import RAW, THRESHOLD, MapScore, Method, aligned_mask, evenly_spaced
from gan.figures import draw_grid, draw_overlay, write_box_plot, write_picture
from slamgym.metrics import aligned_error
from slamgym.types import FREE, OCCUPIED, BoolArray, ByteArray

WORST = 10


def write_pictures(
    folder: Path, pairs: PairSet, methods: Sequence[Method], scores: dict[str, list[MapScore]], count: int
) -> None:
    """Write the pictures of an evaluation.

    ``maps.png`` (as the paper's Fig. 4) shows SLAM map, every method and the CAD map; ``overlays.png`` (Fig. 5) each
    method laid over the CAD map; ``differences.png`` (Fig. 6) the box plot; ``worst_<method>.png`` the maps at which
    a translator gained least.

    Args:
        folder: Where to.
        pairs: The pairs.
        methods: What was measured.
        scores: By method, in the order of the pairs.
        count: Rows of the first two.
    """
    chosen = evenly_spaced(len(pairs), count)
    _write_grid(folder / "maps.png", pairs, methods, scores, chosen)
    _write_overlays(folder / "overlays.png", pairs, methods, scores, chosen)
    raw = np.array([score.mse for score in scores[RAW]])
    others = {name: raw - np.array([s.mse for s in rows]) for name, rows in scores.items() if name != RAW}
    write_box_plot(folder / "differences.png", others)
    for method in methods:
        if method.learned:
            worst = [int(i) for i in np.argsort(others[method.name], kind="stable")[:WORST]]
            _write_grid(folder / f"worst_{_file_name(method.name)}.png", pairs, methods, scores, worst)


def write_generated_grid(path: Path, pairs: PairSet, maps: dict[str, ByteArray], count: int) -> None:
    """CAD map, every kind of generated map, simulated map (as the paper's Fig. 7 and 9).

    Args:
        path: PNG file.
        pairs: The pairs.
        maps: By kind (N, S, S), black where there is none.
        count: Rows.
    """
    chosen = evenly_spaced(len(pairs), count)
    rows = [[pairs.cad[i], *(kind[i] for kind in maps.values()), pairs.slam[i]] for i in chosen]
    captions = [_caption(pairs, i) for i in chosen]
    write_picture(path, draw_grid(["CAD map", *maps, "simulated SLAM map"], rows, captions))


def _write_grid(
    path: Path,
    pairs: PairSet,
    methods: Sequence[Method],
    scores: dict[str, list[MapScore]],
    chosen: Sequence[int],
) -> None:
    shown = [method for method in methods if method.name != RAW]
    rows, captions = [], []
    for i in chosen:
        masks = [_mask(method, pairs, i) for method in shown]
        drawn = [np.where(mask, FREE, OCCUPIED).astype(np.uint8) for mask in masks]
        rows.append([pairs.slam[i], *drawn, pairs.cad[i]])
        errors = ", ".join(f"{m.name} {scores[m.name][i].mse:.4f}" for m in methods)
        captions.append(f"{_caption(pairs, i)}; aligned MSE: {errors}")
    write_picture(path, draw_grid([RAW, *(m.name for m in shown), "CAD map"], rows, captions))


def _write_overlays(
    path: Path,
    pairs: PairSet,
    methods: Sequence[Method],
    scores: dict[str, list[MapScore]],
    chosen: Sequence[int],
) -> None:
    rows, captions = [], []
    for i in chosen:
        truth: BoolArray = pairs.cad[i] > 127
        row = []
        for method in methods:
            mask = _mask(method, pairs, i)
            found = aligned_error(mask.astype(np.float64), truth.astype(np.float64))
            row.append(draw_overlay(aligned_mask(mask, found.similarity), truth))
        rows.append(row)
        f1 = ", ".join(f"{m.name} {scores[m.name][i].wall_f1_10cm:.2f}" for m in methods)
        captions.append(f"{_caption(pairs, i)}; wall F1 10 cm: {f1}")
    write_picture(path, draw_grid([method.name for method in methods], rows, captions))


def _mask(method: Method, pairs: PairSet, index: int) -> BoolArray:
    mask: BoolArray = np.asarray(method.predict(pairs, index)) >= THRESHOLD
    return mask


def _caption(pairs: PairSet, index: int) -> str:
    return f"{pairs.names[index][:14]}, {pairs.metres_per_px[index]:.3f} m/px"


def _file_name(name: str) -> str:
    return "".join(c if c.isalnum() or c in "-_" else "_" for c in name)
