"""``slamgym dataset review``: a page on which a person judges doubtful maps."""

import shlex
from pathlib import Path
from typing import Annotated

import tyro

from slamgym.core.config import Arguments, Count
from slamgym.core.documents import read_json
from slamgym.core.errors import InputFileError
from slamgym.core.files import write_text
from slamgym.core.progress import counted, say, tell
from slamgym.dataset.curate.review import Which


class ReviewArguments(Arguments):
    """Write one HTML file in which a person keeps or drops maps by a key each.

    The file holds everything: send it, open it from a disk, come back to it later. What it saves as
    decisions.json is applied by `slamgym dataset clean DATASET --apply decisions.json`.
    """

    dataset: tyro.conf.Positional[Path]
    """A dataset or a folder of maps that `slamgym dataset clean` has judged."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("review.html")
    """The page."""
    which: Which = "doubtful"
    """``doubtful``: in the classifier's band; ``disagreements``: the classifier and the truth differ;
    ``dropped``, ``kept`` or ``all``."""
    limit: Count = 500
    """Maps on the page at most; each takes some 10 kB."""


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    arguments = tyro.cli(ReviewArguments, args=argv, prog="slamgym dataset review")
    from slamgym.dataset.curate.map_items import open_items
    from slamgym.dataset.curate.review import choose_entries, make_review_page, stored_decisions
    from slamgym.dataset.curate.verdicts import VERDICTS_FILE, read_verdicts

    root = arguments.dataset
    items = open_items(root)
    verdicts = read_verdicts(root)
    missing = sum(item.name not in verdicts for item in items)
    if missing:
        say(
            f"{counted(missing, 'map')} came after {root / VERDICTS_FILE}; run `slamgym dataset clean {root}` for them."
        )
    entries = choose_entries(items, verdicts, arguments.which)
    if not entries:
        tell(f"{root}: no map is {_words(arguments.which)}; there is nothing to review.")
        return 0
    if len(entries) > arguments.limit:
        say(f"The first {arguments.limit} of {len(entries)} maps; raise --limit to see more.")
    entries = entries[: arguments.limit]
    page = make_review_page(
        f"Review of {root.resolve().name}",
        f"slamgym dataset clean {shlex.quote(str(root))} --apply decisions.json",
        entries,
        _band(root),
        stored_decisions(root),
    )
    write_text(arguments.out, page)
    tell(f"{arguments.out}: {counted(len(entries), 'map')}, {len(page) / 1e6:.1f} MB")
    return 0


def _band(root: Path) -> tuple[float, float]:
    """The band that the last cleaning used."""
    from slamgym.dataset.curate.cleaning import CleanConfig
    from slamgym.dataset.curate.verdicts import SUMMARY_FILE

    path = root / SUMMARY_FILE
    if not path.is_file():
        return CleanConfig().band
    try:
        summary = read_json(path)
        low, high = (float(value) for value in summary["settings"]["band"])
    except (ValueError, KeyError, TypeError, OverflowError) as error:
        raise InputFileError(
            path, f"is malformed ({error}); run `slamgym dataset clean {root}` again"
        ) from error
    return low, high


def _words(which: Which) -> str:
    return {"disagreements": "judged differently by truth and classifier", "all": "there"}.get(which, which)
