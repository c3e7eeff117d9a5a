"""Review of doubtful maps by people: the page that shows them, and the file of decisions that it saves."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from slamgym.core.documents import json_text, read_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import replace_file
from slamgym.core.limits import FILE_BYTES
from slamgym.core.pictures import encode_png
from slamgym.core.text import markup
from slamgym.core.types import FREE, UNKNOWN
from slamgym.dataset.curate.map_items import MapItem
from slamgym.dataset.curate.verdicts import Verdict, Which

if TYPE_CHECKING:
    from slamgym.dataset.record import PairRecord


_PARTS = Path(__file__).parent / "review_page"
_MARGIN_PX = 8
"""Border around what the images show."""
DECISIONS_FILE = "decisions.json"
DECISIONS_FORMAT = "slamgym-decisions"
DECISIONS_VERSION = 1
_SHOWN = 5
"""So many names are shown in an error."""


@dataclass(frozen=True)
class Decision:
    """Decision of a person about a map."""

    name: str
    keep: bool
    digest: str
    """SHA-256 of the map that the person saw."""


def read_decisions(path: Path | str) -> list[Decision]:
    """Read a file of decisions.

    It looks like this::

        {"format": "slamgym-decisions", "version": 1,
         "decisions": [{"name": "000007_home", "decision": "drop", "sha256": "..."}]}

    Raises:
        InputFileError: If the file can't be read or is no such file.
        ConfigError: If it says two things about one map.
    """
    document = read_json(path, limit=FILE_BYTES)
    if not isinstance(document, dict) or document.get("format") != DECISIONS_FORMAT:
        raise InputFileError(
            path, "is no file of decisions; save one with `slamgym dataset review`"
        )
    if document.get("version") != DECISIONS_VERSION:
        raise InputFileError(
            path,
            f"has version {document.get('version')!r} of the format, {DECISIONS_VERSION} is read here",
        )
    entries = document.get("decisions")
    if not isinstance(entries, list):
        raise InputFileError(path, "has no list 'decisions'")
    decisions = [_decision(path, number, entry) for number, entry in enumerate(entries, start=1)]
    return list(combine([decisions], [str(path)]).values())


def combine(
    groups: Sequence[Iterable[Decision]], names: Sequence[str] | None = None
) -> dict[str, Decision]:
    """Put the decisions of several people together.

    Args:
        groups: Decisions of each.
        names: What to call each of them in an error.

    Returns:
        The decisions by the maps' names.

    Raises:
        ConfigError: If two say different things about one map.
    """
    combined: dict[str, Decision] = {}
    every = [decision for group in groups for decision in group]
    conflicts = [one.name for one in every if combined.setdefault(one.name, one) != one]
    if conflicts:
        sources = " and ".join(names or []) or "the decisions"
        raise ConfigError(
            f"{sources}: conflicting decisions about {_listed(dict.fromkeys(conflicts))}; take all but one of each out"
        )
    return combined


def check_decisions(decisions: Sequence[Decision], digests: Mapping[str, str], where: str) -> None:
    """Refuse decisions that don't belong to the maps at hand.

    Args:
        decisions: The decisions.
        digests: Name of each map to the SHA-256 of its file.
        where: The file that they come from.

    Raises:
        ConfigError: If there is no map of a name, or it isn't the map that the person saw.
    """
    unknown = [decision.name for decision in decisions if decision.name not in digests]
    if unknown:
        raise ConfigError(
            f"{where}: no such maps: {_listed(unknown)}; is it a file of another dataset?"
        )
    changed = [decision.name for decision in decisions if decision.digest != digests[decision.name]]
    if changed:
        raise ConfigError(
            f"{where}: made for other maps of the same names: {_listed(changed)}; review them again"
        )


def stored_decisions(root: Path) -> dict[str, Decision]:
    """The decisions that were applied to a folder so far, by name.

    Raises:
        InputFileError: If their file is malformed.
    """
    path = root / DECISIONS_FILE
    return {decision.name: decision for decision in read_decisions(path)} if path.exists() else {}


def store_decisions(root: Path, decisions: Iterable[Decision]) -> None:
    """Keep the decisions with the folder that they are about.

    Raises:
        StorageError: If they can't be written.
    """
    replace_file(root / DECISIONS_FILE, decisions_document(decisions).encode())


def decisions_document(decisions: Iterable[Decision]) -> str:
    """The content of a file of decisions, in the order of the names."""
    entries = [
        {"name": d.name, "decision": "keep" if d.keep else "drop", "sha256": d.digest}
        for d in sorted(decisions, key=lambda decision: decision.name)
    ]
    document = {"format": DECISIONS_FORMAT, "version": DECISIONS_VERSION, "decisions": entries}
    return json_text(document)


def _decision(path: Path | str, number: int, entry: Any) -> Decision:
    fields = entry if isinstance(entry, dict) else {}
    name, word, digest = (fields.get(key) for key in ("name", "decision", "sha256"))
    if not (isinstance(name, str) and isinstance(digest, str) and word in ("keep", "drop")):
        raise InputFileError(
            path, f"decision {number} needs a name, 'keep' or 'drop' as its decision, and a sha256"
        )
    return Decision(name, word == "keep", digest)


def _listed(names: Iterable[str]) -> str:
    every = list(names)
    more = f" and {len(every) - _SHOWN} more" if len(every) > _SHOWN else ""
    return ", ".join(every[:_SHOWN]) + more


ReviewEntry = tuple[MapItem, Verdict]
"""A map on the page."""


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
    judged = [(item, verdicts[item.name]) for item in items if item.name in verdicts]
    return [entry for entry in judged if entry[1].by != "file" and _is_chosen(entry[1], which)]


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
    maps = [_map_data(entry, decisions.get(entry[0].name)) for entry in entries]
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
    style, script, page = (
        (_PARTS / f"page.{kind}").read_text(encoding="utf-8") for kind in ("css", "js", "html")
    )
    parts = {"TITLE": markup(title), "STYLE": style, "SCRIPT": script, "DATA": text}
    # In one pass: what is put in may hold anything.
    return re.sub(r"\{\{([A-Z]+)\}\}", lambda found: parts[found[1]], page)


def _is_chosen(verdict: Verdict, which: Which) -> bool:
    if which == "doubtful":
        return verdict.is_doubtful
    if which == "disagreements":
        likely = verdict.probability is not None and verdict.probability >= 0.5
        return verdict.is_complete is not None and likely != verdict.is_complete
    return which == "all" or verdict.keep == (which == "kept")


def _map_data(entry: ReviewEntry, decision: Decision | None) -> dict[str, Any]:
    item, verdict = entry
    slam = item.load().cells
    cad = item.load_cad() if item.load_cad else None
    shown = np.not_equal(slam, UNKNOWN) if cad is None else (slam != UNKNOWN) | (cad == FREE)
    rows = _extent(shown, axis=1)
    cols = _extent(shown, axis=0)
    slam = slam[rows, cols]
    return {
        "name": item.name,
        "plan": item.plan_id,
        "sha256": item.digest,
        "slam": base64.b64encode(encode_png(slam)).decode(),
        "cad": None if cad is None else base64.b64encode(encode_png(cad[rows, cols])).decode(),
        "width": slam.shape[1],
        "height": slam.shape[0],
        "probability": verdict.probability,
        "decision": None if decision is None else "keep" if decision.keep else "drop",
        "figures": _figures(verdict, item.record),
    }


def _figures(verdict: Verdict, record: PairRecord | None) -> list[tuple[str, str]]:
    """Labels and values, in words."""
    figures = [("Verdict so far", "keep" if verdict.keep else "drop")]
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
