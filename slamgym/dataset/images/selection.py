"""Which pairs of a dataset are good enough to be used."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slamgym.core.errors import ConfigError
from slamgym.dataset.curate.verdicts import VERDICTS_FILE, read_verdicts
from slamgym.dataset.format import read_manifest
from slamgym.dataset.summary import GOOD_COVERAGE


@dataclass(frozen=True)
class Selection:
    """The pairs that are used, why the others are not, and by which rule."""

    kept: frozenset[str]
    left_out: Mapping[str, str]
    rule: dict[str, Any]
    """``{"by": "clean.jsonl"}`` or ``{"min_coverage": 0.95}``."""


def select_pairs(root: Path | str, min_coverage: float | None = None) -> Selection:
    """Take the pairs that ``slamgym dataset clean`` keeps, or those of a least coverage.

    Args:
        root: The dataset.
        min_coverage: Take pairs by their true coverage instead of by ``clean.jsonl``. Where there is no such
            file either, 0.95 is taken.

    Raises:
        ConfigError: If the coverage is no share.
        InputFileError: If a file is missing or malformed, or ``clean.jsonl`` doesn't know a pair.
    """
    records = list(read_manifest(root))
    if min_coverage is None and (Path(root) / VERDICTS_FILE).is_file():
        verdicts = read_verdicts(root)
        unexpected = [record.name for record in records if record.name not in verdicts]
        if unexpected:
            raise ConfigError(
                f"{Path(root) / VERDICTS_FILE} says nothing of {unexpected[0]} and {len(unexpected) - 1} more; "
                "run `slamgym dataset clean` again"
            )
        kept = frozenset(record.name for record in records if verdicts[record.name].keep)
        left_out = {r.name: f"not clean: {verdicts[r.name].reason}" for r in records if r.name not in kept}
        return Selection(kept, left_out, {"by": VERDICTS_FILE})
    least = GOOD_COVERAGE if min_coverage is None else min_coverage
    if not 0.0 <= least <= 1.0:
        raise ConfigError(f"the least coverage must lie in [0, 1], not {least}")
    kept = frozenset(record.name for record in records if record.coverage >= least)
    left_out = {
        r.name: f"low coverage: {r.coverage:.3f} < {least:g}, ended by {r.finished}"
        for r in records
        if r.name not in kept
    }
    return Selection(kept, left_out, {"min_coverage": least})
