"""What Daher et al. claim, what a run found, and a verdict on each claim.

Figures of Daher, Chakhachiro and Asmar, *From SLAM to CAD Maps and Back Using Generative Models*: Table I
(:mod:`slamgym.commands.reproduce.protocol`), Table II (:mod:`slamgym.commands.reproduce.conversions`), 17 days on a
cluster for some 35,000 plans at 7 minutes each, 4,225 pairs left after cleaning.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from slamgym.commands.reproduce.conversions import conversion_claims
from slamgym.commands.reproduce.nearness import Nearness, nearness_claims
from slamgym.commands.reproduce.protocol import table_one_claims
from slamgym.commands.reproduce.steps import REDRAWN, TO_SLAM, TRAINED
from slamgym.commands.reproduce.verdicts import (
    Claim,
    counted_share,
    exact,
    intervals_of,
    judge,
    judge_error,
    with_interval,
)
from slamgym.core.intervals import Interval, wilson_interval

TELLING = 0.65
"""Accuracy from which maps count as unlike simulated ones: the goal of the map generator."""
PAPER_RATE = 3600.0 * 35_000 / (17 * 24 * 3600.0)
"""Explorations an hour on the paper's cluster: some 35,000 in 17 days."""


class Findings(NamedTuple):
    """What a run found."""

    protocol: Mapping[str, Any]
    """``evaluation.json`` of the images by the paper's protocol."""
    true_faces: Mapping[str, Any]
    """``evaluation.json`` of the images with true faces."""
    statistics: Mapping[str, Any]
    """``slamgym dataset stats --json``."""
    seconds: dict[str, list[float]]
    """Of each conversion, by its folder."""
    nearness: Nearness | None
    """Distances of made maps from simulated ones."""


def judge_claims(found: Findings) -> list[Claim]:
    """All claims."""
    return [
        *table_one_claims(found.protocol["methods"]),
        *_drawing_back(found.true_faces["realism"]),
        *nearness_claims(found.nearness),
        *conversion_claims(found.seconds),
        *_making(found.statistics["whole"]),
    ]


def _drawing_back(realism: Mapping[str, Any] | None) -> list[Claim]:
    """Figures 7 and 9: the paper shows pictures; a two-sample test says whether the eye is right."""
    tests = [] if realism is None else [intervals_of(test) for test in realism["tests"]]
    null = {test["first"]: test["accuracy"] for test in tests if test["is_null"]}
    claims = []
    for test in tests:
        name = test["second"]
        if name not in (*REDRAWN, TO_SLAM, TRAINED[TO_SLAM]):
            continue
        accuracy = test["accuracy"]
        halves = null[test["first"]]
        # As alike as the halves are, or nearly.
        alike = Interval(halves.value, 0.0, halves.high)
        claim = Claim(
            f"Figures 7 and 9: do maps that {name} makes from CAD maps look like SLAM maps?",
            "yes, by eye",
            f"told apart with accuracy {with_interval(accuracy)}; two halves of the SLAM maps {with_interval(halves)}",
            judge_error(accuracy, alike, TELLING),
        )
        claims.append(claim)
    return claims


def _making(whole: Mapping[str, Any]) -> list[Claim]:
    """The cost of a dataset."""
    rate = 3600.0 / whole["cpu_seconds"]
    explored = Claim(
        "How many explorations an hour?",
        f"{PAPER_RATE:.0f} on a cluster",
        f"{rate:,.0f} on one core",
        judge(exact(rate), exact(PAPER_RATE), PAPER_RATE),
    )
    paper_share = wilson_interval(4225, 35_000)
    kept = wilson_interval(round(whole["kept"] * whole["pairs"]), whole["pairs"])
    usable = Claim(
        "How many are good enough to learn from?",
        counted_share(paper_share, 35_000),
        counted_share(kept, whole["pairs"]),
        judge(kept, paper_share, 0.0),
    )
    return [explored, usable]
