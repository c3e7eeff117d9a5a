"""The report of a reproduction: verdicts on the paper's claims, its tables and figures, all in one HTML file."""

from __future__ import annotations

import html
import itertools
from collections.abc import Iterator
from pathlib import Path

from slamgym import __version__
from slamgym.commands.doctor import installed
from slamgym.commands.reproduce.claims import judge_claims, table_one_beside
from slamgym.commands.reproduce.steps import Reproduction
from slamgym.core.config import to_dict
from slamgym.core.documents import read_json
from slamgym.core.files import read_bytes, read_text, write_text
from slamgym.core.pictures import decode_picture
from slamgym.dataset.statistics import dataset_statistics
from slamgym.viz.pages import figure, inline_picture, make_page, make_table, paragraph

_STYLE = """.better, .reproduced { background: #d3f9d8 } .less { background: #fff3bf } .worse { background: #ffe3e3 }
pre { overflow-x: auto }"""
_TITLE = "From SLAM to CAD maps and back: a reproduction"
_CAPTIONS = {
    "evaluation/maps.png": "As Figure 4: SLAM map, translations, CAD map.",
    "evaluation/overlays.png": "As Figure 5: each laid over the CAD map.",
    "evaluation/differences.png": "As Figure 6: what translation gains on each map.",
    "evaluation/cad2slam.png": "As Figures 7 and 9: SLAM maps generated from CAD maps, and simulated ones.",
    "deformed/*.png": "As Figures 7 to 9: CAD maps, and the SLAM maps that {name} makes of them.",
    "drawings/**/*.png": "Drawn as vectors from the SLAM map.",
}


def write_reproduction(run: Reproduction) -> Path:
    """Write ``report.html``; returns its path.

    Raises:
        InputFileError: If a result is missing or damaged; delete ``state.json`` to have all made again.
    """
    evaluation = read_json(run.out / "evaluation" / "evaluation.json")
    statistics = to_dict(dataset_statistics(run.out / "pairs"))
    claims = judge_claims(evaluation, statistics, read_text(run.out / "logs" / "deformed.txt"))
    commands = [
        [command, name, f"{step['seconds']:.0f}", f"{step['cpu_seconds']:.0f}"]
        for name, step in run.steps.items()
        for command in step["commands"]
    ]
    # By the first word of its verdict, each claim is coloured.
    colours = [claim.verdict.split()[0] for claim in claims]
    parts = [
        f"<h1>{_TITLE}</h1>",
        paragraph(
            f"{statistics['whole']['pairs']} explorations of {statistics['whole']['plans']} floor plans by the recipe "
            f"{run.scale['recipe']}, {evaluation['maps']} test maps of {evaluation['plans']} plans that no training of "
            "this run has seen. model32 and modelprog are networks as the paper's; pretrained ones have seen some of "
            f"HouseExpo's plans, none of the bundled. Seed {run.seed}, slamgym {__version__}. Intervals are 95 %. "
            "Reproduced: true here, and both intervals overlap. Less than the paper: true, but below its interval."
        ),
        "<h2>How the paper's claims fared</h2>",
        make_table(["question", "the paper", "this run", "verdict"], claims, colours),
        "<h2>Table I beside the paper's</h2>",
        make_table(*table_one_beside(evaluation["methods"])),
        "<h2>SLAM to CAD and back: Tables I and II, Figures 4 to 9</h2>",
        *_text(run.out / "evaluation" / "tables.md"),
        *_pictures(run.out),
        "<h2>Explorers</h2>",
        *_text(run.out / "explorers" / "results.md"),
        "<h2>The dataset</h2>",
        *_text(run.out / "logs" / "cleaning.txt"),
        "<h2>Commands</h2>",
        make_table(["command", "step", "time of the step [s]", "CPU [s]"], commands),
        "<h2>Versions</h2>",
        make_table(["packages", "versions"], [(found.what, found.found) for found in installed()]),
    ]
    path = run.out / "report.html"
    write_text(path, make_page(_TITLE, parts, _STYLE))
    return path


def _text(path: Path) -> Iterator[str]:
    """The tables of a text in Markdown as tables, all else as it stands."""
    for is_table, lines in itertools.groupby(
        read_text(path).splitlines(), lambda line: line.startswith("|")
    ):
        if is_table:
            headings, _, *rows = (
                [cell.strip() for cell in line.strip("|").split("|")] for line in lines
            )
            yield make_table(headings, rows)
        elif text := "\n".join(lines).strip():
            yield f"<pre>{html.escape(text)}</pre>"


def _pictures(out: Path) -> Iterator[str]:
    for pattern, caption in _CAPTIONS.items():
        for path in sorted(out.glob(pattern)):
            picture = inline_picture(decode_picture(path, read_bytes(path)))
            yield figure(f'<img alt="" src="{picture}">', caption.format(name=path.stem))
