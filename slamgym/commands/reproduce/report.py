"""The report of a reproduction: what the paper claims, how each claim fared, and everything in one HTML file.

Figures of Daher, Chakhachiro and Asmar, *From SLAM to CAD Maps and Back Using Generative Models*: 14 of 21 maps
improved with mean MSE2 0.114 and MSE1 0.087 (Table I), 17 days on a cluster for some 35,000 plans at 7 minutes each,
4,225 pairs left after cleaning, 15-94 s for the EKF at 64 px and 2.6-3.6 s for the two-phase method at 256 px in
Matlab (Table II).
"""

from __future__ import annotations

import html
import itertools
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple

import cv2

from slamgym import __version__
from slamgym.commands.doctor import installed
from slamgym.commands.reproduce.steps import (
    OWN_NETWORK,
    PAPER_NETWORK,
    REDRAWN,
    TO_SLAM,
    TRAINED,
    Reproduction,
)
from slamgym.core.config import to_dict
from slamgym.core.documents import read_json
from slamgym.core.files import read_bytes, read_text, write_text
from slamgym.core.pictures import decode_picture
from slamgym.dataset.statistics import dataset_statistics
from slamgym.viz.pages import figure, inline_picture, make_page, make_table, paragraph

PAPER_MAPS_AN_HOUR = 86.0
_SECONDS = re.compile(r"\b(ekf_schur|two_phase) took ([0-9.]+) s")
_MOST_WIDE = 1600
"""Pictures are shrunk to so many pixels."""
_STYLE = ".holds { background: #d3f9d8 } .does { background: #ffe3e3 } pre { overflow-x: auto }"
_TITLE = "From SLAM to CAD maps and back: a reproduction"
_CAPTIONS = {
    "evaluation/maps.png": "As Figure 4: SLAM map, translations, CAD map.",
    "evaluation/overlays.png": "As Figure 5: each laid over the CAD map.",
    "evaluation/differences.png": "As Figure 6: what translation gains on each map.",
    "evaluation/cad2slam.png": "As Figures 7 and 9: SLAM maps generated from CAD maps, and simulated ones.",
    "deformed/*.png": "As Figures 7 to 9: CAD maps, and the SLAM maps that {name} makes of them.",
    "drawings/**/*.png": "Drawn as vectors from the SLAM map.",
}

ClaimVerdict = Literal["holds", "does not hold", "too few maps to say"]


class Claim(NamedTuple):
    """A claim of the paper and one's own figure."""

    what: str
    paper: str
    own: str
    verdict: ClaimVerdict


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
    parts = [
        f"<h1>{_TITLE}</h1>",
        paragraph(
            f"{statistics['whole']['pairs']} explorations of {statistics['whole']['plans']} floor plans by the recipe "
            f"{run.scale['recipe']}, {evaluation['maps']} test maps of {evaluation['plans']} plans that no training of "
            f"this run has seen; the pretrained networks have seen some of HouseExpo's, none of the bundled ones. "
            f"Seed {run.seed}, slamgym {__version__}. Intervals are 95 %."
        ),
        "<h2>How the paper's claims fared</h2>",
        claims_table(claims),
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


def judge_claims(evaluation: Mapping[str, Any], statistics: Mapping[str, Any], deformed: str) -> list[Claim]:
    """All claims.

    Args:
        evaluation: ``evaluation.json`` of ``slamgym gan evaluate``.
        statistics: ``slamgym dataset stats --json``.
        deformed: What ``slamgym deform`` printed, with the seconds of each map.
    """
    return [
        *_translation(evaluation["methods"]),
        *_drawing_back(evaluation["realism"]),
        *_speed_of_conversion(_SECONDS.findall(deformed)),
        *_making(statistics["whole"]),
    ]


def claims_table(claims: list[Claim]) -> str:
    """The table of claims and findings, with the verdicts in colour."""
    classes = [["", "", "", claim.verdict.split()[0]] for claim in claims]
    return make_table(["claim", "the paper", "this run", "verdict"], claims, cell_classes=classes)


def _translation(methods: Mapping[str, Any]) -> Iterator[Claim]:
    """Table I and Figure 6."""
    for name in (PAPER_NETWORK, OWN_NETWORK, TRAINED):
        if name not in methods:
            continue
        found = methods[name]["improvement"]
        share, ratio = found["share_improved"], found["ratio_of_means"]
        network = "the paper's network" if name == PAPER_NETWORK else f"the network `{name}`"
        yield Claim(
            f"Table I: {network} brings most maps nearer to the CAD map",
            "14 of 21: 67 % [45, 83]",
            f"{round(share['value'] * found['count'])} of {found['count']}: {100 * share['value']:.0f} % "
            f"[{100 * share['low']:.0f}, {100 * share['high']:.0f}]; sign test p = {found['sign_p']:.2g}",
            _verdict(share["low"] > 0.5, share["high"] < 0.5),
        )
        yield Claim(
            f"Table I: {network} lowers the mean squared error (ratio of the means)",
            "0.76 (0.087 / 0.114)",
            f"{ratio['value']:.2f} [{ratio['low']:.2f}, {ratio['high']:.2f}]; Wilcoxon p = {found['wilcoxon_p']:.2g}",
            _verdict(ratio["high"] < 1.0, ratio["low"] > 1.0),
        )


def _drawing_back(realism: Mapping[str, Any] | None) -> Iterator[Claim]:
    """Figures 7 and 9: the paper shows pictures; a two-sample test says whether the eye is right."""
    tests = [] if realism is None else realism["tests"]
    null = {test["first"]: test["accuracy"] for test in tests if test["is_null"]}
    for test in tests:
        name, found = test["second"], test["accuracy"]
        if name in REDRAWN or (name.startswith(TO_SLAM) and not name.endswith("bent")):
            yield Claim(
                f"Figures 7 and 9: maps made from CAD maps look like SLAM maps, by {name}",
                "by eye",
                f"a classifier tells {found['value']:.2f} [{found['low']:.2f}, {found['high']:.2f}] apart "
                f"(0.5: it can't; halves of the simulated maps {null[test['first']]['value']:.2f})",
                _verdict(False, found["low"] > 0.5),
            )


def _speed_of_conversion(found: list[tuple[str, str]]) -> Iterator[Claim]:
    """Table II."""
    own = {}
    for method in ("ekf_schur", "two_phase"):
        seconds = [float(text) for name, text in found if name == method]
        if not seconds:
            return
        own[method] = min(seconds)  # the first map waits for its kernels
    yield Claim(
        "Table II: the two-phase method is faster than the EKF",
        "ekf 15-94 s, two_phase 2.6-3.6 s",
        ", ".join(f"{method} {seconds:.2g} s" for method, seconds in own.items()),
        _verdict(own["two_phase"] < own["ekf_schur"]),
    )


def _making(whole: Mapping[str, Any]) -> Iterator[Claim]:
    """The cost of a dataset."""
    if whole["cpu_seconds"]:
        rate = 3600.0 / whole["cpu_seconds"]
        yield Claim(
            "Explorations cost days on a cluster",
            f"about {PAPER_MAPS_AN_HOUR:.0f} maps an hour on a cluster",
            f"{rate:.0f} maps an hour on one core ({whole['cpu_seconds']:.1f} CPU s each)",
            _verdict(rate <= PAPER_MAPS_AN_HOUR),
        )
    if whole["kept"] is not None:
        yield Claim(
            "Few explorations are good enough to learn from",
            "12 % (4,225 of some 35,000)",
            f"{100 * whole['kept']:.0f} % of {whole['pairs']}",
            _verdict(whole["kept"] < 0.5),
        )


def _verdict(holds: bool, fails: bool = True) -> ClaimVerdict:
    if holds:
        return "holds"
    return "does not hold" if fails else "too few maps to say"


def _text(path: Path) -> Iterator[str]:
    """The tables of a text in Markdown as tables, all else as it stands."""
    for is_table, lines in itertools.groupby(read_text(path).splitlines(), lambda line: line.startswith("|")):
        if is_table:
            headings, _, *rows = ([cell.strip() for cell in line.strip("|").split("|")] for line in lines)
            yield make_table(headings, rows)
        elif text := "\n".join(lines).strip():
            yield f"<pre>{html.escape(text)}</pre>"


def _pictures(out: Path) -> Iterator[str]:
    for pattern, caption in _CAPTIONS.items():
        for path in sorted(out.glob(pattern)):
            picture = decode_picture(path, read_bytes(path))
            shrunk = min(1.0, _MOST_WIDE / picture.shape[1])
            picture = cv2.resize(picture, None, fx=shrunk, fy=shrunk, interpolation=cv2.INTER_AREA)
            yield figure(f'<img alt="" src="{inline_picture(picture)}">', caption.format(name=path.stem))
