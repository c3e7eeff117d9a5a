"""What lies in a dataset, in words and in one picture."""

from array import array
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from slamgym.core.files import replace_file, storage_errors
from slamgym.core.png import encode_png
from slamgym.dataset.format import Layout, PairRecord, load_pair, read_manifest
from slamgym.interop import read_tum
from slamgym.viz.sheets import SheetEntry, draw_contact_sheet

GOOD_COVERAGE = 0.95
"""Share of the reachable area from which an exploration counts as complete."""


def describe_pairs(root: Path | str) -> str:
    """Summarise a dataset in a few lines of text.

    Raises:
        InputFileError: If the folder holds no dataset.
    """
    # A million records would not fit in memory; five numbers of each do.
    figures, plans, endings_count = array("d"), set[str](), Counter[str]()
    for record in read_manifest(root):
        figures.extend(
            (record.coverage, record.ate, record.odometry_ate, record.map_error, record.robot_seconds / 60.0)
        )
        plans.add(record.plan_id)
        endings_count[record.finished] += 1
    if not figures:
        return f"{root}: no pairs"
    coverage, ate, odometry, walls, minutes = np.frombuffer(figures).reshape(-1, 5).T
    complete = 100.0 * np.mean(coverage >= GOOD_COVERAGE)
    endings = ", ".join(f"{count} {reason}" for reason, count in endings_count.most_common())
    return "\n".join(
        [
            f"{root}: {len(coverage)} pairs of {len(plans)} plans",
            f"  coverage        median {100 * np.median(coverage):.1f} %, "
            f"{complete:.0f} % of the pairs at {100 * GOOD_COVERAGE:.0f} % or more",
            f"  robot time      median {np.median(minutes):.1f} min, longest {minutes.max():.1f} min",
            f"  ended by        {endings}",
            f"  position error  median {np.median(ate):.3f} m, worst {ate.max():.3f} m "
            f"(wheels alone: median {np.median(odometry):.3f} m)",
            f"  wall error      median {np.median(walls):.3f} m, worst {walls.max():.3f} m",
        ]
    )


def write_contact_sheet(root: Path | str, limit: int) -> Path:
    """Draw up to ``limit`` pairs, spread evenly over the dataset, into its ``contact_sheet.png``.

    Returns:
        The picture's path.

    Raises:
        InputFileError: If a file of the dataset is missing or malformed.
        StorageError: If the picture can't be written.
    """
    layout = Layout(Path(root))
    count = sum(1 for _ in read_manifest(root))
    places = set(np.linspace(0, count - 1, min(limit, count)).astype(int).tolist())
    chosen = [record for place, record in enumerate(read_manifest(root)) if place in places]
    heading = f"slamgym: {len(chosen)} of {count} pairs" if len(chosen) < count else "slamgym: map pairs"
    picture = draw_contact_sheet(heading, sheet_entries(root, chosen), columns=2)
    with storage_errors(layout.contact_sheet):
        replace_file(layout.contact_sheet, encode_png(picture[:, :, ::-1]))
    return layout.contact_sheet


def sheet_entries(root: Path | str, records: Sequence[PairRecord]) -> list[SheetEntry]:
    """Read the pairs of some records for a contact sheet."""
    layout = Layout(Path(root))
    entries = []
    for record in records:
        cad, slam = load_pair(root, record.name)
        path = read_tum(layout.episode(record.name) / "estimate.tum").poses[:, :2]
        entries.append(SheetEntry(record.plan_id, _details(record), cad, slam, record.frame, path))
    return entries


def _details(record: PairRecord) -> str:
    return (
        f"{100 * record.coverage:.1f} % covered in {record.robot_seconds / 60:.1f} min, "
        f"{record.path_length:.0f} m; errors: pose {record.ate:.2f} m (wheels {record.odometry_ate:.2f} m), "
        f"walls {record.map_error:.3f} m"
    )
