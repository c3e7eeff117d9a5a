"""Tables of an evaluation: each method over all maps, with 95 % intervals, as JSON, CSV and Markdown."""

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from slamgym.core.intervals import mean_interval
from slamgym.gan.evaluation.evaluate import RAW, MapScore, evenly_spaced
from slamgym.metrics import improvement

MEASURES: dict[str, str] = {
    "mse": "aligned MSE",
    "mse_grey": "aligned MSE of the image as drawn",
    "mse_unaligned": "unaligned MSE",
    "wall_f1_10cm": "wall F1 10 cm",
    "wall_f1_20cm": "wall F1 20 cm",
    "wall_precision_10cm": "wall precision 10 cm",
    "wall_recall_10cm": "wall recall 10 cm",
    "wall_f1_10cm_unaligned": "wall F1 10 cm, unaligned",
    "free_iou": "free-space IoU",
    "chamfer": "wall Chamfer distance [m]",
    "hausdorff_95": "wall 95 % Hausdorff distance [m]",
    "room_error": "room count error",
    "room_f1": "room F1",
    "seconds": "CPU seconds per map",
}
"""Name of a measure to the heading of its column."""

TABLE_I_MAPS = 21


def summarise_scores(scores: dict[str, list[MapScore]]) -> dict[str, dict[str, Any]]:
    """Means with intervals for each method, and its errors against those of the SLAM maps.

    Args:
        scores: By method, the maps in the same order; the raw SLAM map must be among the methods.

    Returns:
        JSON form, by method: ``maps``, ``plans``, one interval for each of :data:`MEASURES`, ``rooms_right`` and,
        but for the raw map, ``improvement`` (of the masks) and ``improvement_grey`` (of the images as drawn).
    """
    raw = np.array([score.mse for score in scores[RAW]])
    summary: dict[str, dict[str, Any]] = {}
    for method, rows in scores.items():
        plans = [row.plan_id for row in rows]
        entry: dict[str, Any] = {"maps": len(rows), "plans": len(set(plans))}
        for measure in MEASURES:
            values = np.array([row[measure] for row in rows], dtype=np.float64)
            entry[measure] = asdict(mean_interval(values, groups=plans))
        entry["rooms_right"] = float(np.mean([row["room_error"] == 0 for row in rows]))
        if method != RAW:
            entry["improvement"] = asdict(improvement(np.array([row.mse for row in rows]), raw, plans))
            grey = np.array([row["mse_grey"] for row in rows])
            entry["improvement_grey"] = asdict(improvement(grey, raw, plans))
        summary[method] = entry
    return summary


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


def markdown(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = ["| " + " | ".join(headings) + " |", "|" + "---|" * len(headings)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)]) + "\n"


def _interval(interval: dict[str, float], digits: int) -> str:
    return f"{interval['value']:.{digits}f} [{interval['low']:.{digits}f}, {interval['high']:.{digits}f}]"


def _percentage(share: dict[str, float]) -> str:
    return f"{100 * share['value']:.1f} % [{100 * share['low']:.1f}, {100 * share['high']:.1f}]"


def _p_value(p: float) -> str:
    return f"{p:.2g}" if p >= 1e-4 else "< 0.0001"
