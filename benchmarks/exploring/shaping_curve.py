"""Draw the curves of ``slamgym agents shape``: ``python benchmarks/exploring/shaping_curve.py OUT PNG``.

Left: share of the floor seen in the latest hundred episodes of training, of 60 to 600 s each. Right: contacts in one of
them. A line for each seed, with exploration noise.
"""

import argparse
import csv
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
from matplotlib import pyplot as plt

COLUMNS = {
    "rollout/coverage": "share of the floor seen",
    "rollout/collisions": "contacts in an episode",
}
COLOURS = ("#1971c2", "#e03131", "#2f9e44", "#f08c00", "#7048e8", "#0c8599", "#868e96")


def curve(run: Path, column: str) -> tuple[list[float], list[float]]:
    """Thousands of decisions, and a column of the log then."""
    rows: list[dict[str, str]] = []
    for path in sorted(run.glob("log/*/progress.csv")):
        rows += csv.DictReader(path.read_text(encoding="utf-8").splitlines())
    kept = [row for row in rows if row.get(column) and row.get("time/total_timesteps")]
    kept.sort(key=lambda row: float(row["time/total_timesteps"]))
    return [float(row["time/total_timesteps"]) / 1000.0 for row in kept], [
        float(row[column]) for row in kept
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path, help="folder of the experiment")
    parser.add_argument("png", type=Path, help="picture to write")
    arguments = parser.parse_args()
    presets = sorted({path.parent for path in arguments.out.glob("*/seed_*")})
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
    for axis, (column, title) in zip(axes, COLUMNS.items(), strict=True):
        for preset, colour in zip(presets, COLOURS, strict=False):
            for number, run in enumerate(sorted(preset.glob("seed_*"))):
                label = None if number else preset.name
                axis.plot(*curve(run, column), color=colour, lw=1.2, alpha=0.8, label=label)
        axis.set(xlabel="thousands of decisions", title=title)
        axis.set_ylim(bottom=0.0)
        axis.grid(alpha=0.25)
    axes[1].legend(frameon=False)
    arguments.png.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(arguments.png, dpi=110)
    print(f"{arguments.png}: {', '.join(preset.name for preset in presets)}")


if __name__ == "__main__":
    main()
