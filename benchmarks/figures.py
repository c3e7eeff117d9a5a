"""Figures of the documentation, each from its file in ``benchmarks/results``.

A comment in a page says where a figure comes from; what follows, up to ``<!-- end -->``, is what it gives::

    takes <!-- figure exploring/explorations part=all gives {CPU [s]:.1f} -->1.9<!-- end --> CPU s

``part=all`` chooses the row, ``{CPU [s]:.1f}`` a column and its format. A comment of several lines gives the rows of a
table, whose head stands in the page; each line gives one for every row of its file that fits::

    <!-- table
    slam/mapping_demo gives | {mode} | {RMSE [m]:.3f} |
    -->
    | mode | RMSE [m] |
    |---|---|
    | pose_graph | 0.090 |
    <!-- end -->

A row also has its times in loops and kernels, and the ``date`` and ``cpu`` of its file. ``make figures`` fills all
pages, and ``tests/test_figures.py`` holds them to their files. Where git knows of a later change of a module that was
measured, its tables and its first figure in a page say so; that depends on the history, so no test looks at it.
"""

import functools
import json
import re
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).parent))
from report import RESULTS, UNCOMMITTED, git

ROOT = RESULTS.parents[1]
LEADERBOARD = "leaderboard"
"""Name of docs/leaderboard.json, which ``slamgym bench leaderboard`` writes beside its page."""

_MARK = re.compile(
    r"(?P<comment><!-- (?P<kind>figure|table)\s(?P<sources>.*?)\s?-->)(?P<shown>.*?)<!-- end -->",
    re.DOTALL,
)
_FIELD = re.compile(r"\{(?P<column>[^{}:]+)(?::(?P<format>[^{}]*))?\}")
_NOTE = re.compile(r" \(measured before [0-9a-f]+\)|\n\*Measured before [^*]*\*\n")


def pages() -> list[Path]:
    """The pages that are filled."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


class Source(NamedTuple):
    """Where figures come from, and how they are shown."""

    name: str
    """File below ``benchmarks/results``, without its ending."""
    conditions: dict[str, str]
    """Columns that choose rows, and their values."""
    template: str

    @staticmethod
    def read(line: str) -> "Source":
        """From a line of a comment.

        Raises:
            ValueError: If the line isn't ``FILE COLUMN=VALUE ... gives TEMPLATE``.
        """
        head, gives, template = line.partition(" gives ")
        if not gives:
            raise ValueError(f"{line!r} isn't FILE COLUMN=VALUE ... gives TEMPLATE")
        name, *conditions = shlex.split(head)
        return Source(name, dict(one.split("=", 1) for one in conditions), template.strip())

    def texts(self) -> Iterator[str]:
        """The template filled by each row that fits.

        Raises:
            ValueError: If no row fits, or a column doesn't exist.
        """
        rows = [row for row in rows_of(self.name) if self._fits(row)]
        if not rows:
            raise ValueError(f"{self.name}: no row has {self.conditions}")
        for row in rows:
            yield _FIELD.sub(functools.partial(self._value, row), self.template)

    def _fits(self, row: dict[str, Any]) -> bool:
        return all(str(row.get(column, "")) == value for column, value in self.conditions.items())

    def _value(self, row: dict[str, Any], field: re.Match[str]) -> str:
        column = field["column"]
        if column not in row:
            raise ValueError(f"{self.name}: no column {column!r}; there are {', '.join(row)}")
        value = row[column]
        return "-" if value is None else format(value, field["format"] or "")


def fill(page: str, notes: bool = True) -> str:
    """A page with its figures as the results files have them.

    Args:
        page: Its text, in Markdown.
        notes: Whether to say what was measured before a change.

    Raises:
        ValueError: If a comment names what no results file has.
    """
    noted: set[str] = set()

    def renew(mark: re.Match[str]) -> str:
        sources = [Source.read(line) for line in mark["sources"].strip().splitlines()]
        texts = [text for source in sources for text in source.texts()]
        names = {one.name for one in sources} if notes else set()
        if mark["kind"] == "table":
            head = mark["shown"].strip().splitlines()[:2]
            shown = "\n".join(["", *head, *texts, _table_note(_changes(names))])
        elif len(texts) == 1:
            changes = _changes(names - noted)
            shown = texts[0] + "".join(f" (measured before {one})" for one in changes)
        else:
            raise ValueError(f"{mark['sources']!r} gives {len(texts)} figures")
        noted.update(names)
        return f"{mark['comment']}{shown}<!-- end -->"

    return _MARK.sub(renew, page)


def without_notes(page: str) -> str:
    """A page without what depends on the history."""
    return _NOTE.sub("", page)


def _changes(names: set[str]) -> dict[str, list[str]]:
    """Files whose modules have changed, by the first commit that did."""
    files: dict[str, list[str]] = {}
    for name in sorted(names):
        if change := changed_since(name):
            files.setdefault(change, []).append(Path(name).name)
    return files


def _table_note(changes: dict[str, list[str]]) -> str:
    """What stands below a table; empty where nothing has changed."""
    if not changes:
        return ""
    parts = (f"{change} ({', '.join(names)})" for change, names in changes.items())
    return f"\n*Measured before {', '.join(parts)}.*\n"


@functools.cache
def load(name: str) -> dict[str, Any]:
    """A results file."""
    path = (ROOT / "docs" if name == LEADERBOARD else RESULTS) / f"{name}.json"
    if not path.is_file():
        raise ValueError(f"the results file {path} doesn't exist")
    document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return document


def rows_of(name: str) -> list[dict[str, Any]]:
    """The rows of a results file, with their times in loops and kernels."""
    document = load(name)
    if name == LEADERBOARD:
        return [standing for board in document["boards"] for standing in _standings(board)]
    of_file = {"date": document["date"][:10], "cpu": document["machine"]["cpu"]}
    rows: list[dict[str, Any]] = [of_file | row for row in document["rows"]]
    for unit in ("in loops", "in kernels"):
        for row, times in zip(rows, document.get(unit, []), strict=False):
            row.update(times)
    return rows


def _standings(board: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The entries of a track of the leaderboard, each with its time over that of the others."""
    for place, standing in enumerate(board["standings"], start=1):
        ratios = {f"/ {other}": _interval(ratio) for other, ratio in standing["against"].items()}
        for other, ratio in standing["where_both"].items():
            ratios[f"both / {other}"] = _interval(ratio)
        yield {
            "track": board["track"],
            "explorations": board["explorations"],
            "entry": standing["entry"],
            "rank": place if standing["passed"] and not board["quick"] else "-",
            "score": _interval(standing["score"]),
            "success [%]": _interval(standing["success"], 100.0, 0),
            "map error [m]": standing["map_error"],
            **ratios,
        }


def _interval(found: dict[str, float], factor: float = 1.0, digits: int = 2) -> str:
    """A figure with its interval, as on the leaderboard."""
    value, low, high = (f"{factor * found[end]:.{digits}f}" for end in ("value", "low", "high"))
    return f"{value} [{low}, {high}]"


@functools.cache
def changed_since(name: str) -> str:
    """The first commit after a measurement that changed a module that it measured; empty where git knows of none."""
    document = load(name)
    commit, modules = document.get("commit"), document.get("modules")
    if not commit or not modules:
        return ""
    since = f"{commit.removesuffix(UNCOMMITTED)}..HEAD"
    log = git("log", "--reverse", "--format=%h", "--abbrev=8", since, "--", *modules)
    changes = log.splitlines()
    # What was measured uncommitted came with the next commit.
    later = changes[1:] if commit.endswith(UNCOMMITTED) else changes
    return later[0] if later else ""


def main() -> None:
    wrong = []
    for page in pages():
        text = page.read_text(encoding="utf-8")
        try:
            filled = fill(text)
        except ValueError as error:
            wrong.append(f"{page.relative_to(ROOT)}: {error}")
            continue
        if filled != text:
            page.write_text(filled, encoding="utf-8")
            print(page.relative_to(ROOT))
    if wrong:
        raise SystemExit("\n".join(wrong))


if __name__ == "__main__":
    main()
