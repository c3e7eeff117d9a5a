"""Draw the learning curve of a training run: ``python benchmarks/exploring/training_curve.py RUN PNG``.

Left: duration of the episodes of training, with exploration noise. Right: time to 95 and 99 % of the floor and until
done on validation plans, the policy's best action taken.
"""

import argparse
import csv
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
from matplotlib import pyplot as plt


def read_curve(folder: Path) -> list[tuple[float, ...]]:
    """Steps, and the mean duration of the latest hundred episodes of training then [s]."""
    rows: list[dict[str, str]] = []
    for path in sorted(folder.glob("log/*/progress.csv")):
        rows += csv.DictReader(path.read_text(encoding="utf-8").splitlines())
    names = ("time/total_timesteps", "rollout/episode_seconds")
    return [tuple(float(row[name]) for name in names) for row in rows if all(map(row.get, names))]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path, help="folder of the training")
    parser.add_argument("png", type=Path, help="picture to write")
    arguments = parser.parse_args()
    folder = arguments.run
    target = arguments.png
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    curve = read_curve(folder)
    left.plot([steps for steps, _ in curve], [seconds for _, seconds in curve], color="#1971c2")
    left.set(xlabel="decisions", ylabel="s", title="latest 100 episodes of training")
    with (folder / "validation.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for name, label, colour in (
        ("time_95", "95 % seen", "#1971c2"),
        ("time_99", "99 % seen", "#e03131"),
        ("time", "done", "#2f9e44"),
    ):
        right.plot(
            [float(r["steps"]) for r in rows],
            [float(r[name]) for r in rows],
            "o-",
            color=colour,
            label=label,
        )
    right.set(xlabel="decisions", ylabel="s", title="validation plans: time until")
    right.legend(frameon=False)
    for axis in (left, right):
        axis.grid(alpha=0.25)
        axis.set_ylim(0.0, 1.1 * axis.get_ylim()[1])
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target, dpi=130)
    print(f"{target}: {len(curve)} updates, {len(rows)} evaluations")


if __name__ == "__main__":
    main()
