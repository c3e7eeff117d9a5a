"""Verdict of the cleaning about each map: ``clean.jsonl`` in the folder that was cleaned."""

import dataclasses
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from slamgym.core.config import from_dict
from slamgym.core.documents import json_text, parse_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import replace_if_changed, text_lines
from slamgym.dataset.faults import MapFault

VERDICTS_FILE = "clean.jsonl"
Which = Literal["doubtful", "disagreements", "dropped", "kept", "all"]
"""Maps of a page of review."""
SUMMARY_FILE = "clean.json"


@dataclass(frozen=True)
class Verdict:
    """One line of ``clean.jsonl``."""

    name: str
    keep: bool
    """True if the map belongs in a clean dataset."""
    reason: str
    """Why: ``complete``, ``coverage 0.81 < 0.95: time limit``, ``dropped by a person``, ..."""
    by: str
    """Who decided: ``truth``, ``classifier``, ``trees``, ``person``, ``file`` (it can't be read)."""
    probability: float | None
    """Probability of being complete, by the classifier; none if the map can't be read."""
    is_doubtful: bool
    """True if the probability lies in the band that goes to a person."""
    is_complete: bool | None
    """By the true coverage, if it is known."""
    coverage: float | None
    ate: float | None
    """[m]"""
    map_error: float | None
    """[m]"""

    faults: tuple[MapFault, ...]
    """Faults that make up the reason; empty for decisions of a person."""

    @property
    def kind(self) -> str:
        """Under what the map is counted: the kind of its first fault, or that a person dropped it."""
        return self.faults[0].reason if self.faults else self.reason


def write_verdicts(root: Path, verdicts: Iterable[Verdict], summary: Mapping[str, Any]) -> None:
    """Write ``clean.json`` and ``clean.jsonl``; files that would not change are left as they are.

    Raises:
        StorageError: If the folder can't be written.
    """
    records = (dataclasses.asdict(verdict) for verdict in verdicts)
    lines = "".join(json.dumps(record) + "\n" for record in records)
    replace_if_changed(root / SUMMARY_FILE, json_text(summary).encode())
    replace_if_changed(root / VERDICTS_FILE, lines.encode())


def read_verdicts(root: Path | str) -> dict[str, Verdict]:
    """Read what the last cleaning said, by the maps' names, in the order of the file.

    Raises:
        InputFileError: If the folder wasn't cleaned or a line is malformed.
    """
    return {verdict.name: verdict for verdict in iterate_verdicts(root)}


def iterate_verdicts(root: Path | str) -> Iterator[Verdict]:
    """The same one by one, for folders of a million maps.

    Raises:
        InputFileError: If the folder wasn't cleaned or a line is malformed.
    """
    path = Path(root) / VERDICTS_FILE
    if not path.is_file():
        raise InputFileError(
            root, f"holds no {VERDICTS_FILE}; run `slamgym dataset clean {root}` first"
        )
    for line, where in text_lines(path):
        entry = parse_json(line, where, fix=f"run `slamgym dataset clean {root}` again")
        try:
            yield from_dict(Verdict, entry)
        except ConfigError as error:
            raise InputFileError(
                where, f"is not a verdict ({error}); run `slamgym dataset clean {root}` again"
            ) from error
