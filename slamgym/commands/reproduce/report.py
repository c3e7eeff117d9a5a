"""The report of a reproduction: verdicts on the paper's claims, its tables and figures, all in one HTML file."""

from __future__ import annotations

import html
import itertools
from collections.abc import Iterator
from pathlib import Path

from slamgym import __version__
from slamgym.commands.doctor import installed
from slamgym.commands.reproduce.claims import Findings, judge_claims
from slamgym.commands.reproduce.conversions import read_seconds, table_two
from slamgym.commands.reproduce.figures import NEARNESS, OTHER_FIGURES, paper_figures, pictures
from slamgym.commands.reproduce.nearness import measure_nearness, nearness_table, plot_nearness
from slamgym.commands.reproduce.own_claims import own_claims, read_scores
from slamgym.commands.reproduce.protocol import alignment_table, read_map_errors, table_one_beside
from slamgym.commands.reproduce.steps import PAPER_NETWORK, TO_SLAM, Reproduction
from slamgym.core.config import to_dict
from slamgym.core.documents import read_json
from slamgym.core.files import read_text, write_text
from slamgym.dataset.statistics import dataset_statistics
from slamgym.viz.pages import make_page, make_table, paragraph

_STYLE = """.better, .reproduced { background: #d3f9d8 } .less { background: #fff3bf } .worse { background: #ffe3e3 }
pre { overflow-x: auto }"""
PAPER_RECIPE = "paper"
"""The recipe of explorations as the paper's."""
_TITLE = "From SLAM to CAD maps and back: a reproduction"


def write_reproduction(run: Reproduction) -> Path:
    """Write ``report.html``; returns its path.

    Raises:
        InputFileError: If a result is missing or damaged; delete ``state.json`` to have all made again.
    """
    found = _find(run)
    parts = [
        f"<h1>{_TITLE}</h1>",
        paragraph(_introduction(run, found)),
        *_verdicts(found),
        *_table_one(run, found),
        "<h2>Table II: the conversions of the parametric model</h2>",
        paragraph(
            "CPU seconds of a map, timed in one run, the first map left out: it waits for its kernels. ekf_schur is "
            "no EKF: it solves at once for what an EKF would find step by step."
        ),
        make_table(*table_two(found.seconds)),
        "<h2>Figures 4 to 9</h2>",
        *_nearness(run.out, found),
        *paper_figures(run.out, (PAPER_NETWORK, TO_SLAM)),
        *_own(run.out),
        *_appendix(run),
    ]
    path = run.out / "report.html"
    write_text(path, make_page(_TITLE, parts, _STYLE))
    return path


def _find(run: Reproduction) -> Findings:
    """Read what the steps have made."""
    out = run.out
    return Findings(
        protocol=read_json(out / "protocol" / "evaluation" / "evaluation.json"),
        true_faces=read_json(out / "evaluation" / "evaluation.json"),
        statistics=to_dict(dataset_statistics(out / "pairs")),
        seconds=read_seconds(read_text(out / "logs" / "deformed.txt")),
        nearness=measure_nearness(out / "pairs", out / "images", out / "redrawn"),
    )


def _introduction(run: Reproduction, found: Findings) -> str:
    whole = found.statistics["whole"]
    tested = found.protocol
    clean = found.true_faces
    return (
        f"{whole['pairs']} explorations of {whole['plans']} floor plans by the recipe {run.scale['recipe']}. Table I "
        f"is judged on {tested['maps']} test maps of {tested['plans']} plans by the paper's protocol: walls of 10 px "
        "of 256, maps of which the robot saw at least 0.7 of the floor. This package's own claims are judged on the "
        f"{clean['maps']} test maps of {clean['plans']} plans that pass cleaning, with true faces. No training of "
        "this run has seen these plans. model32 and modelprog are networks as the paper's; pretrained ones have "
        f"seen some of HouseExpo's plans, none of the bundled. Seed {run.seed}, slamgym {__version__}. Intervals are "
        "95 %."
    )


def _verdicts(found: Findings) -> Iterator[str]:
    claims = judge_claims(found)
    # By the first word of its verdict, each claim is coloured.
    colours = [claim.verdict.split()[0] for claim in claims]
    yield "<h2>How the paper's claims fared</h2>"
    yield paragraph(
        "Reproduced: true here, and both intervals overlap. Better than the paper: the run's interval lies beyond the "
        "paper's. Less than the paper: true, but below its interval."
    )
    yield make_table(["question", "the paper", "this run", "verdict"], claims, colours)


def _table_one(run: Reproduction, found: Findings) -> Iterator[str]:
    protocol = run.out / "protocol"
    errors = read_map_errors(protocol / "images", protocol / "evaluation")
    yield "<h2>Table I by the paper's protocol</h2>"
    yield make_table(*table_one_beside(found.protocol["methods"], errors))
    yield paragraph(
        "The error rewards thick walls: merely thickening those of the SLAM map until they are as thick as the CAD "
        "map's lowers it, and brings faces nearer to those of thick walls. A translator has learnt more than "
        "thickness where it beats that row in wall F1 and in the number of rooms."
    )
    if run.scale["recipe"] != PAPER_RECIPE:
        yield paragraph(
            f"The maps are by the recipe {run.scale['recipe']}, not by {PAPER_RECIPE}, which explores and maps as the "
            "paper did: compare MSE2 with the paper's before the verdicts on Table I."
        )
    yield "<h3>What alignment and coverage do to MSE2</h3>"
    yield paragraph(
        "The better of aligned and unaligned counts. Unknown and outside are black in both maps. On 60 maps the "
        "feature matching of SIFT left 0.113 where the best similarity left 0.037 (docs/notes/translators.md): a "
        "weaker alignment raises MSE2."
    )
    yield make_table(*alignment_table(errors))
    yield "<h3>All tables of the evaluation</h3>"
    yield from _text(protocol / "evaluation" / "tables.md")


def _nearness(out: Path, found: Findings) -> Iterator[str]:
    if found.nearness is None:
        yield paragraph("Too few test maps to draw them again: no distances for Figures 7 and 9.")
        return
    plot_nearness(out / NEARNESS, found.nearness)
    yield paragraph(
        "Distances of made maps from the simulated maps of the same explorations, for Figures 7 and 9; less is nearer."
    )
    yield make_table(*nearness_table(found.nearness))


def _own(out: Path) -> Iterator[str]:
    evaluation = out / "evaluation"
    yield "<h2>This package's own claims, with true faces</h2>"
    yield make_table(*own_claims(read_scores(evaluation)))
    yield from _text(evaluation / "tables.md")
    yield from pictures(out, OTHER_FIGURES)


def _appendix(run: Reproduction) -> Iterator[str]:
    commands = [
        [command, name, f"{step['seconds']:.0f}", f"{step['cpu_seconds']:.0f}"]
        for name, step in run.steps.items()
        for command in step["commands"]
    ]
    yield "<h2>Explorers</h2>"
    yield from _text(run.out / "explorers" / "results.md")
    yield "<h2>The dataset</h2>"
    yield from _text(run.out / "logs" / "cleaning.txt")
    yield "<h2>Commands</h2>"
    yield make_table(["command", "step", "time of the step [s]", "CPU [s]"], commands)
    yield "<h2>Versions</h2>"
    versions = [(found.what, found.found) for found in installed()]
    yield make_table(["packages", "versions"], versions)


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
