"""Tables of an evaluation: each method over all maps, with 95 % intervals, as JSON, CSV and Markdown."""

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from slamgym.core.intervals import mean_interval
from slamgym.core.types import FloatArray
from slamgym.gan.evaluation.evaluate import RAW, MapScore, evenly_spaced
from slamgym.metrics import improvement
from slamgym.metrics.dimensions import LENGTH_TOLERANCES

MEASURES: dict[str, str] = {
    "mse": "aligned MSE",
    "mse_grey": "aligned MSE of the image as drawn",
    "wall_f1_10cm": "wall F1 10 cm",
    "wall_f1_20cm": "wall F1 20 cm",
    "free_iou": "free-space IoU",
    "hausdorff_95": "wall 95 % Hausdorff distance [m]",
    "room_error": "room count error",
    "room_f1": "room F1",
    "mse_rigid": "rigidly aligned MSE",
    "wall_f1_5cm_rigid": "wall F1 5 cm, rigid",
    "wall_f1_10cm_rigid": "wall F1 10 cm, rigid",
    "room_f1_rigid": "room F1, rigid",
    "area_ratio": "floor area ratio",
    "unseen_share": "floor never seen",
    "seconds": "CPU seconds per map",
}
"""Name of a measure to the heading of its column."""

TABLE_I_MAPS = 21
_IMPROVEMENTS = (
    ("", "mse", "mse"),
    ("_rigid", "mse_rigid", "mse_rigid"),
    ("_grey", "mse_grey", "mse"),
)
"""Which error of a translation is compared with which of the SLAM map."""


def summarise_scores(scores: dict[str, list[MapScore]]) -> dict[str, dict[str, Any]]:
    """Means with intervals for each method, and its errors against those of the SLAM maps.

    Args:
        scores: By method, the maps in the same order; the raw SLAM map must be among the methods.

    Returns:
        JSON form, by method: ``maps``, ``plans``, one interval for each of :data:`MEASURES`, ``dimensions`` and, but
        for the raw map, ``improvement`` (of the masks), ``improvement_rigid``, ``improvement_grey`` (of the images as
        drawn) and ``improvement_table_one`` (of the masks, over the maps of :func:`table_one`).
    """
    summary: dict[str, dict[str, Any]] = {}
    for method, rows in scores.items():
        plans = [row.plan_id for row in rows]
        entry: dict[str, Any] = {"maps": len(rows), "plans": len(set(plans))}
        for measure in MEASURES:
            entry[measure] = asdict(mean_interval(_column(rows, measure), groups=plans))
        entry["dimensions"] = summarise_dimensions(rows)
        if method != RAW:
            for suffix, measure, of_raw in _IMPROVEMENTS:
                better = improvement(_column(rows, measure), _column(scores[RAW], of_raw), plans)
                entry[f"improvement{suffix}"] = asdict(better)
            some = evenly_spaced(len(rows), TABLE_I_MAPS)
            mse1, mse2 = (_column(of, "mse")[some] for of in (rows, scores[RAW]))
            entry["improvement_table_one"] = asdict(
                improvement(mse1, mse2, [plans[i] for i in some])
            )
        summary[method] = entry
    return summary


def _column(rows: Sequence[MapScore], measure: str) -> FloatArray:
    return np.array([row[measure] for row in rows], dtype=np.float64)


def summarise_dimensions(rows: Sequence[MapScore]) -> dict[str, Any]:
    """Errors of lengths and openings of all maps together, in metres; None where nothing was measured."""
    summary: dict[str, Any] = {}
    for name in ("room_width", "wall_length", "wall_thickness"):
        summary[name] = _length_summary(
            np.concatenate([getattr(row.dimensions, name) for row in rows])
        )
    summary["door_width"] = _length_summary(
        np.concatenate([row.openings.door_width for row in rows])
    )
    for name in ("doors", "doors_kept", "doors_closed", "doors_invented", "walls", "walls_opened"):
        summary[name] = sum(getattr(row.openings, name) for row in rows)
    return summary


def _length_summary(errors: FloatArray) -> dict[str, Any]:
    """Number, median, median of the absolute value, and the shares within the tolerances."""
    if len(errors) == 0:
        return {"count": 0}
    within = {
        f"within_{round(100 * t)}cm": float((np.abs(errors) <= t).mean()) for t in LENGTH_TOLERANCES
    }
    return {
        "count": len(errors),
        "median": float(np.median(errors)),
        "median_absolute": float(np.median(np.abs(errors))),
        **within,
    }


def dimensions_table(summary: dict[str, dict[str, Any]]) -> tuple[list[str], list[list[str]]]:
    """Headings and rows: what is left after a rigid alignment, and the dimensions."""
    headings = ["method", "MSE ratio, rigid", "F1 5 cm", "F1 10 cm", "room F1", "room width [cm]"]
    headings += ["in 2 / 5 / 10 cm"]
    headings += [
        "wall length [cm]",
        "in 5 cm",
        "thickness [cm]",
        "area",
        "doors kept",
        "door width [cm]",
    ]
    headings += ["walls opened", "doors invented", "never seen"]
    rows = []
    for method, entry in summary.items():
        found = entry["dimensions"]
        width, length = found["room_width"], found["wall_length"]
        ratio = "1" if method == RAW else _interval(entry["improvement_rigid"]["ratio_of_means"], 2)
        row = [method, ratio]
        row += [
            f"{entry[f'{m}_rigid']['value']:.2f}"
            for m in ("wall_f1_5cm", "wall_f1_10cm", "room_f1")
        ]
        row += [
            _cm(width, "median"),
            " / ".join(_share(width, f"within_{n}cm") for n in (2, 5, 10)),
        ]
        row += [
            _cm(length, "median"),
            _share(length, "within_5cm"),
            _cm(found["wall_thickness"], "median"),
        ]
        row += [f"{entry['area_ratio']['value']:.3f}", _of(found["doors_kept"], found["doors"])]
        row += [
            _cm(found["door_width"], "median_absolute"),
            _of(found["walls_opened"], found["walls"]),
        ]
        row += [str(found["doors_invented"]), f"{100 * entry['unseen_share']['value']:.1f} %"]
        rows.append(row)
    return headings, rows


def _cm(lengths: dict[str, Any], name: str) -> str:
    return f"{100 * lengths[name]:+.1f}" if lengths["count"] else "-"


def _share(lengths: dict[str, Any], name: str) -> str:
    return f"{lengths[name]:.2f}" if lengths["count"] else "-"


def _of(part: int, whole: int) -> str:
    return f"{part} of {whole}"


def main_table(summary: dict[str, dict[str, Any]]) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of the table that goes into the terminal and the documentation."""
    headings = ["method", "MSE1", "MSE1 / MSE2", "improved", "sign p", "Wilcoxon p"]
    headings += ["grey MSE1 / MSE2", "improved by grey"]
    shown = ["wall_f1_10cm", "wall_f1_20cm", "free_iou", "hausdorff_95", "room_error", "room_f1"]
    rows = []
    for method, entry in summary.items():
        row = [method, f"{entry['mse']['value']:.4f}"]
        if method == RAW:
            row += ["1", "-", "-", "-", "1", "-"]
        else:
            better, grey = entry["improvement"], entry["improvement_grey"]
            row += [_interval(better["ratio_of_means"], 2), _percentage(better["share_improved"])]
            row += [_p_value(better["sign_p"]), _p_value(better["wilcoxon_p"])]
            row += [_interval(grey["ratio_of_means"], 2), _percentage(grey["share_improved"])]
        row += [_interval(entry[measure], 2) for measure in shown]
        rows.append(row)
    return headings + [MEASURES[measure] for measure in shown], rows


def table_one(scores: dict[str, list[MapScore]]) -> tuple[list[str], list[list[str]]]:
    """As the paper's Table I: the errors of 21 maps, one by one, chosen evenly over the sorted names."""
    methods = list(scores)
    rows = [
        [scores[RAW][i].name, *(f"{scores[method][i].mse:.4f}" for method in methods)]
        for i in evenly_spaced(len(scores[RAW]), TABLE_I_MAPS)
    ]
    means = [np.mean([float(row[k + 1]) for row in rows]) for k in range(len(methods))]
    rows.append(["mean", *(f"{mean:.4f}" for mean in means)])
    return ["map", *(f"MSE2: {m}" if m == RAW else f"MSE1: {m}" for m in methods)], rows


def scores_csv(scores: dict[str, list[MapScore]]) -> str:
    """All scores, one line per method and map."""
    names = list(scores[RAW][0].measures)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["method", "name", "plan_id", "metres_per_px", *names])
    for method, rows in scores.items():
        for row in rows:
            values = [row.name, row.plan_id, row.metres_per_px, *row.measures.values()]
            writer.writerow([method, *(f"{v:.6g}" if isinstance(v, float) else v for v in values)])
    return text.getvalue()


def _interval(interval: dict[str, float], digits: int) -> str:
    return f"{interval['value']:.{digits}f} [{interval['low']:.{digits}f}, {interval['high']:.{digits}f}]"


def _percentage(share: dict[str, float]) -> str:
    return f"{100 * share['value']:.1f} % [{100 * share['low']:.1f}, {100 * share['high']:.1f}]"


def _p_value(p: float) -> str:
    return f"{p:.2g}" if p >= 1e-4 else "< 0.0001"
