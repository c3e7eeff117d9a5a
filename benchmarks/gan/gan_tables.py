"""Keep an evaluation of translators as the result that the table of docs/gan.md shows.

Run: ``python benchmarks/gan/gan_tables.py OUT``, where OUT is a folder that `slamgym gan evaluate` wrote: its figures
are kept as ``benchmarks/results/gan/gan_evaluation.json``, the table's as ``gan_table.json``. Then: ``make figures``.
"""

import argparse
import json
import shutil
import sys
from pathlib import Path

from slamgym.gan.evaluation.summary import main_table

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import RESULTS, print_and_save

MODULES = ("gan/translation", "slamgym/metrics")
"""What is measured."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("evaluation", type=Path, help="folder that `slamgym gan evaluate` wrote")
    path = parser.parse_args().evaluation / "evaluation.json"
    result = json.loads(path.read_text())
    scale = result["metres_per_px"]
    title = (
        f"{result['maps']} maps of {result['plans']} plans at {result['size_px']} px, "
        f"{scale['p5']:.3f} to {scale['p95']:.3f} m/px (median {scale['p50']:.3f})"
    )
    try:
        columns, rows = main_table(result["methods"])
    except KeyError as missing:
        raise SystemExit(
            f"{path} lacks {missing}, as an earlier version wrote it: run `slamgym gan evaluate` again"
        ) from missing
    shutil.copy(path, RESULTS / "gan" / "gan_evaluation.json")
    print_and_save("gan/gan_table", title, rows, columns, MODULES)


if __name__ == "__main__":
    main()
