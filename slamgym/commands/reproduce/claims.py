"""What Daher et al. claim, what a run found, and a verdict on each claim.

Figures of Daher, Chakhachiro and Asmar, *From SLAM to CAD Maps and Back Using Generative Models*: 14 of 21 maps
improved with mean MSE2 0.114 and MSE1 0.087 (Table I), 17 days on a cluster for some 35,000 plans at 7 minutes each,
4,225 pairs left after cleaning, 15-94 s for the EKF at 64 px and 2.6-3.6 s for the two-phase method at 256 px in
Matlab (Table II).
"""

import math
import re
from collections.abc import Iterator, Mapping
from typing import Any, Literal, NamedTuple

from slamgym.commands.reproduce.steps import OWN_NETWORK, PAPER_NETWORK, REDRAWN, TO_SLAM, TRAINED
from slamgym.core.intervals import Interval, wilson_interval

ClaimVerdict = Literal[
    "better than the paper",
    "reproduced",
    "less than the paper",
    "too few maps to say",
    "worse than the paper",
]
_SECONDS = re.compile(r"\b(ekf_schur|two_phase) took ([0-9.]+) s")


class Claim(NamedTuple):
    """A question, and how the paper and the run answer it."""

    question: str
    paper: str
    own: str
    verdict: ClaimVerdict


def judge(own: Interval, paper: Interval, bound: float) -> ClaimVerdict:
    """Compare a figure of which more is better with the paper's.

    Args:
        own: The run's.
        paper: The paper's; a point where it gives no spread.
        bound: Above it the claim is true.
    """
    if own.low > paper.high:
        return "better than the paper"
    if own.low > bound:
        return "reproduced" if own.high >= paper.low else "less than the paper"
    return "too few maps to say" if own.high >= max(bound, paper.low) else "worse than the paper"


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
        *_conversion(_SECONDS.findall(deformed)),
        *_making(statistics["whole"]),
    ]


def table_one_beside(methods: Mapping[str, Any]) -> tuple[list[str], list[list[str]]]:
    """Headings and rows: the summary of the paper's Table I, and of the run's, over as many maps and over all.

    Args:
        methods: Those of ``evaluation.json``.
    """
    tables = [("the paper", _table_one())]
    for name, entry in _networks(methods):
        of_all, of_some = entry["improvement"], entry["improvement_table_one"]
        # Of few test maps both are the same.
        tables += [
            (name, _intervals(found)) for found in ([of_some] if of_some == of_all else [of_some, of_all])
        ]
    rows = [
        [
            name,
            str(found["count"]),
            _shown(found["mean_mse2"], 3),
            _shown(found["mean_mse1"], 3),
            _shown(found["ratio_of_means"]),
            _counted(found["share_improved"], found["count"]),
        ]
        for name, found in tables
    ]
    return ["", "maps", "mean MSE2 (SLAM maps)", "mean MSE1 (translated)", "MSE1 / MSE2", "improved"], rows


def _table_one() -> dict[str, Any]:
    """The paper's, in the form of :class:`slamgym.metrics.Improvement`."""
    return {
        "count": 21,
        "mean_mse2": _point(0.114),
        "mean_mse1": _point(0.087),
        "ratio_of_means": _point(0.087 / 0.114),
        "share_improved": wilson_interval(14, 21),
    }


def _networks(methods: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Networks from SLAM to CAD map, by the name that is shown."""
    for name in (PAPER_NETWORK, OWN_NETWORK, TRAINED):
        if name in methods:
            yield f"{name}, the paper's network" if name == PAPER_NETWORK else name, methods[name]


def _translation(methods: Mapping[str, Any]) -> Iterator[Claim]:
    """Table I and Figure 6."""
    paper = _table_one()
    share, ratio = paper["share_improved"], paper["ratio_of_means"]
    for name, entry in _networks(methods):
        found = _intervals(entry["improvement"])
        yield Claim(
            f"Table I: are most maps nearer to the CAD map after {name}?",
            _counted(share, paper["count"]),
            f"{_counted(found['share_improved'], found['count'])}; sign test p = {found['sign_p']:.2g}",
            judge(found["share_improved"], share, 0.5),
        )
        yield Claim(
            f"Table I: is the mean squared error lower after {name} (MSE1 / MSE2)?",
            _shown(ratio),
            f"{_shown(found['ratio_of_means'])}; Wilcoxon p = {found['wilcoxon_p']:.2g}",
            judge(_less_is_more(found["ratio_of_means"]), _less_is_more(ratio), -1.0),
        )


def _drawing_back(realism: Mapping[str, Any] | None) -> Iterator[Claim]:
    """Figures 7 and 9: the paper shows pictures; a two-sample test says whether the eye is right."""
    tests = [] if realism is None else [test | _intervals(test) for test in realism["tests"]]
    null = {test["first"]: test["accuracy"] for test in tests if test["is_null"]}
    for test in tests:
        name, halves = test["second"], null[test["first"]]
        if name in REDRAWN or (name.startswith(TO_SLAM) and not name.endswith("bent")):
            yield Claim(
                f"Figures 7 and 9: do the maps that {name} makes from CAD maps look like SLAM maps?",
                "yes, by eye",
                f"told apart with accuracy {_shown(test['accuracy'])}; two halves of SLAM maps {_shown(halves)}",
                # As alike as two halves, or by less: up to the map generator's goal of 0.65.
                judge(_less_is_more(test["accuracy"]), Interval(-halves.value, -halves.high, 0.0), -0.65),
            )


def _conversion(found: list[tuple[str, str]]) -> Iterator[Claim]:
    """Table II."""
    # The first map of a method waits for its kernels.
    own = {method: min(float(text) for name, text in found if name == method) for method, _ in found}
    if len(own) == 2:
        ekf, two_phase = own["ekf_schur"], own["two_phase"]
        yield Claim(
            "Table II: is the two-phase method faster than the EKF?",
            "2.6-3.6 s against 15-94 s",
            f"{two_phase:.2g} s against {ekf:.2g} s",
            judge(_point(ekf / two_phase), Interval(1.0, 1.0, math.inf), 1.0),
        )


def _making(whole: Mapping[str, Any]) -> Iterator[Claim]:
    """The cost of a dataset."""
    if whole["cpu_seconds"]:
        rate, paper = 3600.0 / whole["cpu_seconds"], 86.0
        yield Claim(
            "How many explorations does an hour give?",
            f"about {paper:.0f} on a cluster",
            f"{rate:,.0f} on one core ({whole['cpu_seconds']:.1f} CPU s each)",
            judge(_point(rate), _point(paper), paper),
        )
    if whole["kept"] is not None:
        share = wilson_interval(4225, 35_000)
        kept = wilson_interval(round(whole["kept"] * whole["pairs"]), whole["pairs"])
        yield Claim(
            "How many explorations are good enough to learn from?",
            _counted(share, 35_000),
            _counted(kept, whole["pairs"]),
            judge(kept, share, 0.0),
        )


def _intervals(found: Mapping[str, Any]) -> dict[str, Any]:
    """The same with intervals in place of their JSON form."""
    return {name: Interval(**value) if isinstance(value, dict) else value for name, value in found.items()}


def _point(value: float) -> Interval:
    return Interval(value, value, value)


def _less_is_more(interval: Interval) -> Interval:
    return Interval(-interval.value, -interval.high, -interval.low)


def _shown(interval: Interval, digits: int = 2) -> str:
    value, low, high = (f"{figure:.{digits}f}" for figure in (interval.value, interval.low, interval.high))
    return value if interval.low == interval.high else f"{value} [{low}, {high}]"


def _counted(share: Interval, count: int) -> str:
    low, high = 100 * share.low, 100 * share.high
    return f"{share.value * count:,.0f} of {count:,}: {100 * share.value:.0f} % [{low:.0f}, {high:.0f}]"
