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
"""Maps in the paper's Table I."""
_MAIN_MEASURES = (
    "wall_f1_10cm",
    "wall_f1_20cm",
    "free_iou",
    "hausdorff_95",
    "room_error",
    "room_f1",
)
"""Measures that :func:`main_table` shows beside the errors."""
_NO_GAINS = {
    "MSE1 / MSE2": "1",
    "improved": "-",
    "sign p": "-",
    "Wilcoxon p": "-",
    "grey MSE1 / MSE2": "1",
    "improved by grey": "-",
}
"""What :func:`main_table` shows of the SLAM maps themselves."""


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
            interval = mean_interval(_column(rows, measure), groups=plans)
            entry[measure] = asdict(interval)
        entry["dimensions"] = summarise_dimensions(rows)
        if method != RAW:
            entry |= _improvements(rows, scores[RAW])
        summary[method] = entry
    return summary


def _improvements(rows: Sequence[MapScore], raw: Sequence[MapScore]) -> dict[str, Any]:
    """A method's errors against those of the SLAM maps, of which greys have no error of their own."""

    def compared(measure: str, of_raw: str, chosen: Sequence[int]) -> dict[str, Any]:
        errors = _column(rows, measure)[chosen]
        raw_errors = _column(raw, of_raw)[chosen]
        plans = [rows[i].plan_id for i in chosen]
        return asdict(improvement(errors, raw_errors, plans))

    everything = range(len(rows))
    some = evenly_spaced(len(rows), TABLE_I_MAPS)
    return {
        "improvement": compared("mse", "mse", everything),
        "improvement_rigid": compared("mse_rigid", "mse_rigid", everything),
        "improvement_grey": compared("mse_grey", "mse", everything),
        "improvement_table_one": compared("mse", "mse", some),
    }


def _column(rows: Sequence[MapScore], measure: str) -> FloatArray:
    return np.array([row[measure] for row in rows], dtype=np.float64)


def summarise_dimensions(rows: Sequence[MapScore]) -> dict[str, Any]:
    """Errors of lengths and openings of all maps together, in metres; None where nothing was measured."""
    dimensions = [row.dimensions for row in rows]
    openings = [row.openings for row in rows]
    return {
        "room_width": _length_summary([found.room_width for found in dimensions]),
        "wall_length": _length_summary([found.wall_length for found in dimensions]),
        "wall_thickness": _length_summary([found.wall_thickness for found in dimensions]),
        "door_width": _length_summary([found.door_width for found in openings]),
        "doors": sum(found.doors for found in openings),
        "doors_kept": sum(found.doors_kept for found in openings),
        "doors_closed": sum(found.doors_closed for found in openings),
        "doors_invented": sum(found.doors_invented for found in openings),
        "walls": sum(found.walls for found in openings),
        "walls_opened": sum(found.walls_opened for found in openings),
    }


def _length_summary(errors_by_map: Sequence[FloatArray]) -> dict[str, Any]:
    """Number, median, median of the absolute value, and the shares within the tolerances."""
    errors = np.concatenate(errors_by_map)
    if len(errors) == 0:
        return {"count": 0}
    sizes = np.abs(errors)
    summary = {
        "count": len(errors),
        "median": float(np.median(errors)),
        "median_absolute": float(np.median(sizes)),
    }
    for tolerance in LENGTH_TOLERANCES:
        name = f"within_{round(100 * tolerance)}cm"
        summary[name] = float((sizes <= tolerance).mean())
    return summary


def dimensions_table(summary: dict[str, dict[str, Any]]) -> tuple[list[str], list[list[str]]]:
    """Headings and rows: what is left after a rigid alignment, and the dimensions."""
    rows = []
    columns: dict[str, str] = {}
    for method, entry in summary.items():
        columns = _dimensions_row(method, entry)
        rows.append(list(columns.values()))
    return list(columns), rows


def _dimensions_row(method: str, entry: dict[str, Any]) -> dict[str, str]:
    """A method's cells by their headings."""
    found = entry["dimensions"]
    width = found["room_width"]
    length = found["wall_length"]
    ratio = "1"
    if method != RAW:
        ratio = _interval(entry["improvement_rigid"]["ratio_of_means"], 2)
    return {
        "method": method,
        "MSE ratio, rigid": ratio,
        "F1 5 cm": f"{entry['wall_f1_5cm_rigid']['value']:.2f}",
        "F1 10 cm": f"{entry['wall_f1_10cm_rigid']['value']:.2f}",
        "room F1": f"{entry['room_f1_rigid']['value']:.2f}",
        "room width [cm]": _cm(width, "median"),
        "in 2 / 5 / 10 cm": " / ".join(_share(width, f"within_{cm}cm") for cm in (2, 5, 10)),
        "wall length [cm]": _cm(length, "median"),
        "in 5 cm": _share(length, "within_5cm"),
        "thickness [cm]": _cm(found["wall_thickness"], "median"),
        "area": f"{entry['area_ratio']['value']:.3f}",
        "doors kept": _of(found["doors_kept"], found["doors"]),
        "door width [cm]": _cm(found["door_width"], "median_absolute"),
        "walls opened": _of(found["walls_opened"], found["walls"]),
        "doors invented": str(found["doors_invented"]),
        "never seen": f"{100 * entry['unseen_share']['value']:.1f} %",
    }


def _cm(lengths: dict[str, Any], name: str) -> str:
    return f"{100 * lengths[name]:+.1f}" if lengths["count"] else "-"


def _share(lengths: dict[str, Any], name: str) -> str:
    return f"{lengths[name]:.2f}" if lengths["count"] else "-"


def _of(part: int, whole: int) -> str:
    return f"{part} of {whole}"


def main_table(summary: dict[str, dict[str, Any]]) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of the table that goes into the terminal and the documentation."""
    rows = []
    columns: dict[str, str] = {}
    for method, entry in summary.items():
        columns = {"method": method, "MSE1": f"{entry['mse']['value']:.4f}"}
        columns |= _gains(entry) if method != RAW else _NO_GAINS
        for measure in _MAIN_MEASURES:
            columns[MEASURES[measure]] = _interval(entry[measure], 2)
        rows.append(list(columns.values()))
    return list(columns), rows


def _gains(entry: dict[str, Any]) -> dict[str, str]:
    """A method's cells about its improvement on the SLAM maps, by their headings."""
    masks = entry["improvement"]
    greys = entry["improvement_grey"]
    return {
        "MSE1 / MSE2": _interval(masks["ratio_of_means"], 2),
        "improved": _percentage(masks["share_improved"]),
        "sign p": _p_value(masks["sign_p"]),
        "Wilcoxon p": _p_value(masks["wilcoxon_p"]),
        "grey MSE1 / MSE2": _interval(greys["ratio_of_means"], 2),
        "improved by grey": _percentage(greys["share_improved"]),
    }


def table_one(scores: dict[str, list[MapScore]]) -> tuple[list[str], list[list[str]]]:
    """As the paper's Table I: the errors of 21 maps, one by one, chosen evenly over the sorted names."""
    raw = scores[RAW]
    chosen = evenly_spaced(len(raw), TABLE_I_MAPS)
    names = [raw[i].name for i in chosen]
    headings = ["map"]
    columns = [[*names, "mean"]]
    for method, maps in scores.items():
        headings.append(f"MSE2: {method}" if method == RAW else f"MSE1: {method}")
        errors = [f"{maps[i].mse:.4f}" for i in chosen]
        mean = np.mean([float(error) for error in errors])
        columns.append([*errors, f"{mean:.4f}"])
    return headings, [list(row) for row in zip(*columns, strict=True)]


def scores_csv(scores: dict[str, list[MapScore]]) -> str:
    """All scores, one line per method and map."""
    names = list(scores[RAW][0].measures)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    headings = ["method", "name", "plan_id", "metres_per_px", *names]
    writer.writerow(headings)
    for method, rows in scores.items():
        for row in rows:
            values = [row.metres_per_px, *row.measures.values()]
            numbers = [f"{value:.6g}" if isinstance(value, float) else value for value in values]
            writer.writerow([method, row.name, row.plan_id, *numbers])
    return text.getvalue()


def _interval(interval: dict[str, float], digits: int) -> str:
    value, low, high = (f"{interval[name]:.{digits}f}" for name in ("value", "low", "high"))
    return f"{value} [{low}, {high}]"


def _percentage(share: dict[str, float]) -> str:
    value, low, high = (f"{100 * share[name]:.1f}" for name in ("value", "low", "high"))
    return f"{value} % [{low}, {high}]"


def _p_value(p: float) -> str:
    return f"{p:.2g}" if p >= 1e-4 else "< 0.0001"
