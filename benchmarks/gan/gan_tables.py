"""Write the measured tables of docs/gan.md again from the results in benchmarks/results.

A table stands in the page between ``<!-- table: NAME -->`` and ``<!-- end -->``; NAME is ``evaluation``
or the stem of a benchmark's JSON file. A place whose results don't exist stays as it is.

Run: ``python benchmarks/gan/gan_tables.py [--evaluation OUT]``, where OUT is a folder that `slamgym gan evaluate`
wrote: its evaluation.json is kept as gan_evaluation.json first.
"""

import argparse
import json
import re
import sys
from pathlib import Path
from typing import Any

from slamgym.core.text import markdown
from slamgym.gan.evaluation.summary import main_table

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import RESULTS

PAGE = Path(__file__).parents[2] / "docs" / "gan.md"
PLACE = re.compile(r"<!-- table: (?P<name>\w+) -->\n.*?<!-- end -->", re.DOTALL)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--evaluation", type=Path, help="folder that `slamgym gan evaluate` wrote")
    arguments = parser.parse_args()
    if arguments.evaluation is not None:
        (RESULTS / "gan/gan_evaluation.json").write_text(
            (arguments.evaluation / "evaluation.json").read_text()
        )
    page = PAGE.read_text()
    written: list[str] = []

    def fill(match: re.Match[str]) -> str:
        table = render(match["name"])
        if table is None:
            return match[0]
        written.append(match["name"])
        return f"<!-- table: {match['name']} -->\n{table}<!-- end -->"

    PAGE.write_text(PLACE.sub(fill, page))
    print(f"{PAGE.name}: {', '.join(written) or 'nothing to write'}")


def render(name: str) -> str | None:
    """A table in Markdown, None if its results don't exist."""
    if name == "evaluation":
        path = RESULTS / "gan/gan_evaluation.json"
        if not path.exists():
            return None
        try:
            return from_evaluation(json.loads(path.read_text()))
        except KeyError as missing:
            raise SystemExit(
                f"{path} lacks {missing}, as an earlier version wrote it: run `slamgym gan evaluate` again and "
                "pass its folder with --evaluation"
            ) from missing
    path = RESULTS / "gan" / f"{name}.json"
    if not path.exists():
        return None
    result = json.loads(path.read_text())
    rows = [[_text(row[column]) for column in result["columns"]] for row in result["rows"]]
    return markdown(result["columns"], rows) + f"\n{result['title']}.\n"


def from_evaluation(result: dict[str, Any]) -> str:
    scale = result["metres_per_px"]
    return markdown(*main_table(result["methods"])) + (
        f"\n{result['maps']} maps of {result['plans']} plans at {result['size_px']} px, "
        f"{scale['p5']:.3f} to {scale['p95']:.3f} m/px (median {scale['p50']:.3f}).\n"
    )


def _text(value: Any) -> str:
    return "-" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    main()
