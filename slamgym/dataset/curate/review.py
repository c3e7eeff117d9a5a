"""The page on which a person judges doubtful maps: one HTML file with everything in it."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from slamgym.core.text import markup
from slamgym.core.types import FREE, UNKNOWN, ByteArray
from slamgym.dataset.curate.decisions import DECISIONS_FORMAT, DECISIONS_VERSION, Decision
from slamgym.dataset.curate.map_items import MapItem
from slamgym.dataset.curate.verdicts import Verdict

if TYPE_CHECKING:
    from slamgym.dataset.record import PairRecord

Which = Literal["doubtful", "disagreements", "dropped", "kept", "all"]

_PARTS = Path(__file__).parent / "review_page"
_MARGIN_PX = 8
"""Border around what the images show."""


@dataclass(frozen=True)
class ReviewEntry:
    """A map on the page."""

    item: MapItem
    verdict: Verdict


def choose_entries(
    items: Sequence[MapItem], verdicts: Mapping[str, Verdict], which: Which
) -> list[ReviewEntry]:
    """The maps that a person shall see, in the order of the items.

    Args:
        items: All maps.
        verdicts: What cleaning said, by name; maps without a verdict, or that can't be read, are left out.
        which: ``doubtful``: in the classifier's band; ``disagreements``: the classifier and the truth differ;
            or by what became of them.
    """
    entries = [ReviewEntry(item, verdicts[item.name]) for item in items if item.name in verdicts]
    readable = [entry for entry in entries if entry.verdict.by != "file"]
    return [entry for entry in readable if _is_chosen(entry.verdict, which)]


def make_review_page(
    title: str,
    command: str,
    entries: Sequence[ReviewEntry],
    band: tuple[float, float],
    decisions: Mapping[str, Decision],
) -> str:
    """Make the page.

    Args:
        title: Its heading.
        command: How to apply the decisions, shown to the reader.
        entries: The maps; at least one.
        band: Of the probabilities that go to a person.
        decisions: What was decided before, by name; the page starts from it.

    Returns:
        The HTML text. It names no other file and no address.

    Raises:
        InputFileError: If a map can't be read.
    """
    maps = [_map_data(entry, decisions.get(entry.item.name)) for entry in entries]
    identity = "\n".join(f"{one['name']} {one['sha256']}" for one in maps)
    data = {
        "format": DECISIONS_FORMAT,
        "version": DECISIONS_VERSION,
        "title": title,
        "subtitle": f"{len(maps)} maps to judge. Keys: K keep, D drop, U undo, arrows, ? help.",
        "command": command,
        "band": list(band),
        "digest": hashlib.sha256(identity.encode()).hexdigest(),
        "maps": maps,
    }
    # In a script element only "<" could end the element early.
    text = json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
    parts = {
        "TITLE": markup(title),
        "STYLE": _part("page.css"),
        "SCRIPT": _part("page.js"),
        "DATA": text,
    }
    # In one pass: what is put in may hold anything.
    return re.sub(r"\{\{([A-Z]+)\}\}", lambda found: parts[found[1]], _part("page.html"))


def _is_chosen(verdict: Verdict, which: Which) -> bool:
    if which == "doubtful":
        return verdict.is_doubtful
    if which == "disagreements":
        likely = verdict.probability is not None and verdict.probability >= 0.5 and not verdict.looks_stuck
        return verdict.is_complete is not None and likely != verdict.is_complete
    return which == "all" or verdict.keep == (which == "kept")


def _map_data(entry: ReviewEntry, decision: Decision | None) -> dict[str, Any]:
    item, verdict = entry.item, entry.verdict
    slam = item.load().cells
    cad = item.load_cad() if item.load_cad else None
    shown = np.not_equal(slam, UNKNOWN) if cad is None else (slam != UNKNOWN) | (cad == FREE)
    rows, cols = _extent(shown, axis=1), _extent(shown, axis=0)
    slam = slam[rows, cols]
    return {
        "name": item.name,
        "plan": item.plan_id,
        "sha256": item.digest,
        "slam": _png(slam),
        "cad": None if cad is None else _png(cad[rows, cols]),
        "width": slam.shape[1],
        "height": slam.shape[0],
        "probability": verdict.probability,
        "decision": None if decision is None else "keep" if decision.keep else "drop",
        "figures": _figures(verdict, item.record),
    }


def _figures(verdict: Verdict, record: PairRecord | None) -> list[tuple[str, str]]:
    """Labels and values, in words."""
    verdict_word = "keep" if verdict.keep else "drop"
    figures = [("Verdict so far", verdict_word)]
    if verdict.reason != "complete":
        figures.append(("Reason", verdict.reason))
    if record is None:
        return figures
    return [
        ("True coverage", f"{100.0 * record.coverage:.1f} %"),
        ("Map error", f"{record.map_error:.3f} m"),
        ("Position error", f"{record.ate:.2f} m"),
        ("Robot time", f"{record.robot_seconds / 60.0:.1f} min"),
        ("Driven", f"{record.path_length:.0f} m"),
        ("Floor area", f"{record.area:.0f} m²"),
        ("Ended by", record.finished.replace("_", " ")),
        ("Explorer", record.explorer),
        ("Plan", record.plan_id),
        *figures,
    ]


def _extent(shown: np.ndarray, axis: int) -> slice:
    """Rows (axis 1) or columns (axis 0) that hold something, with a margin; all if nothing does."""
    found = np.flatnonzero(shown.any(axis=axis))
    if len(found) == 0:
        return slice(None)
    return slice(max(int(found[0]) - _MARGIN_PX, 0), int(found[-1]) + 1 + _MARGIN_PX)


def _png(image: ByteArray) -> str:
    import cv2

    encoded = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1]
    return base64.b64encode(encoded.tobytes()).decode()


def _part(name: str) -> str:
    return (_PARTS / name).read_text(encoding="utf-8")
