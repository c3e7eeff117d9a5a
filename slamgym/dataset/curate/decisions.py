"""Decisions of people about doubtful maps: the file that the review page saves and cleaning applies."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slamgym.core.documents import read_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import replace_file

DECISIONS_FILE = "decisions.json"
DECISIONS_FORMAT = "slamgym-decisions"
DECISIONS_VERSION = 1
_SHOWN = 5
"""So many names are shown in an error."""


@dataclass(frozen=True)
class Decision:
    """What a person said about a map."""

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
    document = read_json(path)
    if not isinstance(document, dict) or document.get("format") != DECISIONS_FORMAT:
        raise InputFileError(path, "is no file of decisions; save one with `slamgym dataset review`")
    if document.get("version") != DECISIONS_VERSION:
        raise InputFileError(
            path, f"has version {document.get('version')!r} of the format, {DECISIONS_VERSION} is read here"
        )
    entries = document.get("decisions")
    if not isinstance(entries, list):
        raise InputFileError(path, "has no list 'decisions'")
    decisions = [_decision(path, number, entry) for number, entry in enumerate(entries, start=1)]
    return list(combine([decisions], [str(path)]).values())


def combine(groups: Sequence[Iterable[Decision]], names: Sequence[str] | None = None) -> dict[str, Decision]:
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
    conflicts: dict[str, None] = {}
    for group in groups:
        for decision in group:
            before = combined.setdefault(decision.name, decision)
            if before != decision:
                conflicts[decision.name] = None
    if conflicts:
        where = " and ".join(names or []) or "the decisions"
        raise ConfigError(
            f"{where}: conflicting decisions about {_listed(conflicts)}; take all but one of each out"
        )
    return combined


def check_decisions(decisions: Iterable[Decision], digests: Mapping[str, str], where: str) -> None:
    """Refuse decisions that don't belong to the maps at hand.

    Args:
        decisions: The decisions.
        digests: Name of each map to the SHA-256 of its file.
        where: The file that they come from.

    Raises:
        ConfigError: If there is no map of a name, or it isn't the map that the person saw.
    """
    decisions = list(decisions)
    unknown = [decision.name for decision in decisions if decision.name not in digests]
    if unknown:
        raise ConfigError(f"{where}: no such maps: {_listed(unknown)}; is it a file of another dataset?")
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
    return (
        json.dumps({"format": DECISIONS_FORMAT, "version": DECISIONS_VERSION, "decisions": entries}, indent=1)
        + "\n"
    )


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
