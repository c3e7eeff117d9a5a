"""The report of a reproduction: one HTML file with everything in it."""

from __future__ import annotations

import html
import importlib.metadata
import platform
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2

from slamgym import __version__
from slamgym.commands.reproduce.claims import Claim, conversion_seconds, judge_claims
from slamgym.commands.reproduce.steps import Reproduction, ReproductionState
from slamgym.core.config import to_dict
from slamgym.core.documents import read_json
from slamgym.core.files import read_bytes, read_text, write_text
from slamgym.core.pictures import decode_picture
from slamgym.core.text import markup
from slamgym.dataset.statistics import dataset_statistics
from slamgym.viz.pages import figure, inline_picture, make_page, make_table, paragraph

PACKAGES = ("numpy", "numba", "scipy", "shapely", "opencv-python-headless", "torch", "scikit-learn")
_MOST_WIDE = 1600
"""Pictures are shrunk to so many pixels."""
_STYLE = ".holds { background: #d3f9d8 } .does { background: #ffe3e3 } pre { overflow-x: auto }"


def write_reproduction(run: Reproduction, state: ReproductionState) -> Path:
    """Write ``report.html``; returns its path.

    Raises:
        InputFileError: If a result is missing or damaged; delete ``state.json`` to have all made again.
    """
    evaluation = read_json(run.out / "evaluation" / "evaluation.json")
    statistics = to_dict(dataset_statistics(run.pairs))
    times = conversion_seconds(read_text(run.out / "parametric" / "table2.md"))
    claims = judge_claims(evaluation, statistics, times)
    parts = [
        "<h1>From SLAM to CAD maps and back: a reproduction</h1>",
        paragraph(
            f"{statistics['whole']['pairs']} explorations of {statistics['whole']['plans']} floor plans by the recipe "
            f"{run.scale.recipe}, {evaluation['maps']} test maps of {evaluation['plans']} plans that no training of "
            f"this run has seen; the pretrained networks have seen some of HouseExpo's, none of the bundled ones. "
            f"Seed {run.seed}, slamgym {__version__}. Intervals are 95 %."
        ),
        "<h2>How the paper's claims fared</h2>",
        claims_table(claims),
        "<h2>SLAM to CAD: Table I and Figures 4 to 6</h2>",
        *markdown_parts(read_text(run.out / "evaluation" / "tables.md")),
        *_pictures(run),
        "<h2>Parametric model: Table II</h2>",
        *markdown_parts(read_text(run.out / "parametric" / "table2.md")),
        "<h2>Explorers</h2>",
        *markdown_parts(read_text(run.out / "explorers" / "results.md")),
        "<h2>The dataset</h2>",
        f"<pre>{html.escape(read_text(run.out / 'logs' / 'cleaning.txt'))}</pre>",
        "<h2>Commands</h2>",
        _commands_table(state),
        "<h2>Versions</h2>",
        make_table(["package", "version"], list(_versions())),
    ]
    path = run.out / "report.html"
    write_text(path, make_page("From SLAM to CAD maps and back: a reproduction", parts, _STYLE))
    return path


def claims_table(claims: list[Claim]) -> str:
    """What was claimed, what was found, and the verdict in colour."""
    classes = [["", "", "", claim.verdict.split()[0]] for claim in claims]
    return make_table(["claim", "the paper", "this run", "verdict"], claims, cell_classes=classes)


def markdown_parts(text: str) -> Iterator[str]:
    """Headings, tables and lines of Markdown that slamgym itself has written, as HTML."""
    rows: list[list[str]] = []
    for line in [*text.splitlines(), ""]:
        if line.startswith("|"):
            cells = [cell.strip().strip("`") for cell in line.strip("|").split("|")]
            if any(cell.strip("-: ") for cell in cells):
                rows.append(cells)
            continue
        if rows:
            yield make_table(rows[0], rows[1:])
            rows = []
        if line.startswith("#"):
            yield f"<h3>{markup(line.lstrip('# '))}</h3>"
        elif line.strip():
            yield paragraph(line.replace("`", ""))


def _pictures(run: Reproduction) -> Iterator[str]:
    evaluation = run.out / "evaluation"
    shown = [
        (evaluation / "maps.png", "As Figure 4: SLAM map, translations, CAD map."),
        (evaluation / "overlays.png", "As Figure 5: each laid over the CAD map."),
        (evaluation / "differences.png", "As Figure 6: what translation gains on each map."),
        (
            evaluation / "cad2slam.png",
            "As Figures 7 and 9: SLAM maps generated from CAD maps, and simulated ones.",
        ),
        (run.out / "parametric" / "figure7.png", "As Figure 7: the paper's network from CAD to SLAM."),
        (run.out / "parametric" / "figure8.png", "As Figure 8: the parametric model's conversions."),
        (
            run.out / "parametric" / "figure9.png",
            "As Figure 9: every way from CAD to SLAM beside the simulated map.",
        ),
        *(
            (path, "Drawn as vectors from the SLAM map.")
            for path in sorted((run.out / "drawings").rglob("*.png"))
        ),
    ]
    for path, caption in shown:
        if path.is_file():
            yield figure(f'<img alt="" src="{_inline(path)}">', caption)


def _inline(path: Path) -> str:
    picture = decode_picture(path, read_bytes(path))
    if picture.shape[1] > _MOST_WIDE:
        size = (_MOST_WIDE, round(picture.shape[0] * _MOST_WIDE / picture.shape[1]))
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return inline_picture(picture)


def _commands_table(state: ReproductionState) -> str:
    rows: list[list[Any]] = [
        [
            command,
            name,
            f"{step['seconds']:.0f}" if first else "",
            f"{step['cpu_seconds']:.0f}" if first else "",
        ]
        for name, step in state.steps.items()
        for first, command in zip([True, *[False] * len(step["commands"])], step["commands"], strict=False)
    ]
    return make_table(["command", "step", "time [s]", "CPU [s]"], rows)


def _versions() -> Iterator[list[str]]:
    yield ["Python", platform.python_version()]
    yield ["slamgym", __version__]
    for name in PACKAGES:
        try:
            yield [name, importlib.metadata.version(name)]
        except importlib.metadata.PackageNotFoundError:
            yield [name, "not installed"]
