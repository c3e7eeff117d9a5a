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
    return _verdict(
        beats_paper=own.low > paper.high,
        holds=own.low > bound,
        may_hold=own.high >= bound,
        reaches_paper=own.high >= paper.low,
    )


def judge_error(own: Interval, paper: Interval, bound: float) -> ClaimVerdict:
    """Compare a figure of which less is better with the paper's.

    Args:
        own: The run's.
        paper: The paper's; a point where it gives no spread.
        bound: Below it the claim is true.
    """
    return _verdict(
        beats_paper=own.high < paper.low,
        holds=own.high < bound,
        may_hold=own.low <= bound,
        reaches_paper=own.low <= paper.high,
    )


def _verdict(
    *, beats_paper: bool, holds: bool, may_hold: bool, reaches_paper: bool
) -> ClaimVerdict:
    """The verdict on a claim.

    Args:
        beats_paper: All of the run's interval is better than the paper's.
        holds: The claim is true in all of the run's interval.
        may_hold: It is true in a part of it, or at its end.
        reaches_paper: A part of the run's interval is as good as the paper's.
    """
    if beats_paper:
        return "better than the paper"
    if holds:
        return "reproduced" if reaches_paper else "less than the paper"
    if may_hold and reaches_paper:
        return "too few maps to say"
    return "worse than the paper"


def judge_claims(
    evaluation: Mapping[str, Any], statistics: Mapping[str, Any], deformed: str
) -> list[Claim]:
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
    """Headings and rows: the summary of the paper's Table I, then the run's, over as many maps and over all.

    Args:
        methods: Those of ``evaluation.json``.
    """
    rows = [["the paper", "21", "0.114", "0.087", "0.763", _counted(wilson_interval(14, 21), 21)]]
    for name, entry in _networks(methods):
        for part in ("improvement_table_one", "improvement"):
            found = _intervals(entry[part])
            means = [
                _shown(found[figure], 3) for figure in ("mean_mse2", "mean_mse1", "ratio_of_means")
            ]
            row = [
                name,
                str(found["count"]),
                *means,
                _counted(found["share_improved"], found["count"]),
            ]
            # Of few test maps both parts are the same.
            rows += [] if row in rows else [row]
    return [
        "",
        "maps",
        "mean MSE2 (SLAM map)",
        "mean MSE1 (translation)",
        "MSE1 / MSE2",
        "improved",
    ], rows


def _networks(methods: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Translators from SLAM to CAD map."""
    return (
        (name, methods[name]) for name in (PAPER_NETWORK, OWN_NETWORK, TRAINED) if name in methods
    )


def _translation(methods: Mapping[str, Any]) -> Iterator[Claim]:
    """Table I and Figure 6."""
    paper = wilson_interval(14, 21)
    for name, entry in _networks(methods):
        found = _intervals(entry["improvement"])
        share = found["share_improved"]
        yield Claim(
            f"Table I: does {name} improve most maps?",
            _counted(paper, 21),
            _counted(share, found["count"]),
            judge(share, paper, 0.5),
        )
        ratio = found["ratio_of_means"]
        yield Claim(
            f"Table I: does {name} lower the error (MSE1 / MSE2)?",
            "0.76",
            _shown(ratio),
            judge_error(ratio, _point(0.087 / 0.114), 1.0),
        )


def _drawing_back(realism: Mapping[str, Any] | None) -> Iterator[Claim]:
    """Figures 7 and 9: the paper shows pictures; a two-sample test says whether the eye is right."""
    tests = [] if realism is None else [_intervals(test) for test in realism["tests"]]
    null = {test["first"]: test["accuracy"] for test in tests if test["is_null"]}
    for test in tests:
        name = test["second"]
        is_translator = name.startswith(TO_SLAM) and not name.endswith("bent")
        if name not in REDRAWN and not is_translator:
            continue
        accuracy = test["accuracy"]
        halves = null[test["first"]]
        # As alike as the halves are, or nearly: by the map generator's goal, an accuracy of 0.65.
        alike = Interval(halves.value, 0.0, halves.high)
        yield Claim(
            f"Figures 7 and 9: do maps that {name} makes from CAD maps look like SLAM maps?",
            "yes, by eye",
            f"told apart with accuracy {_shown(accuracy)}; two halves of the SLAM maps {_shown(halves)}",
            judge_error(accuracy, alike, 0.65),
        )


def _conversion(found: list[tuple[str, str]]) -> Iterator[Claim]:
    """Table II."""
    seconds: dict[str, list[float]] = {}
    for method, text in found:
        seconds.setdefault(method, []).append(float(text))
    if len(seconds) == 2:
        # The first map of a method waits for its kernels.
        ekf = min(seconds["ekf_schur"])
        fast = min(seconds["two_phase"])
        any_faster = Interval(1.0, 1.0, math.inf)
        yield Claim(
            "Table II: is two_phase faster than the EKF?",
            "2.6-3.6 s against 15-94 s",
            f"{fast:.2g} s against {ekf:.2g} s",
            judge(_point(ekf / fast), any_faster, 1.0),
        )


def _making(whole: Mapping[str, Any]) -> Iterator[Claim]:
    """The cost of a dataset."""
    rate = 3600.0 / whole["cpu_seconds"]
    paper_rate = 86.0
    yield Claim(
        "How many explorations an hour?",
        f"{paper_rate:.0f} on a cluster",
        f"{rate:,.0f} on one core",
        judge(_point(rate), _point(paper_rate), paper_rate),
    )
    paper_share = wilson_interval(4225, 35_000)
    kept = wilson_interval(round(whole["kept"] * whole["pairs"]), whole["pairs"])
    yield Claim(
        "How many are good enough to learn from?",
        _counted(paper_share, 35_000),
        _counted(kept, whole["pairs"]),
        judge(kept, paper_share, 0.0),
    )


def _intervals(found: Mapping[str, Any]) -> dict[str, Any]:
    """The same with intervals in place of their JSON form."""
    return {name: _as_interval(value) for name, value in found.items()}


def _as_interval(value: Any) -> Any:
    if not isinstance(value, dict):
        return value
    return Interval(value["value"], value["low"], value["high"])


def _point(value: float) -> Interval:
    return Interval(value, value, value)


def _shown(interval: Interval, digits: int = 2) -> str:
    return f"{interval.value:.{digits}f} [{interval.low:.{digits}f}, {interval.high:.{digits}f}]"


def _counted(share: Interval, count: int) -> str:
    low, value, high = (f"{100 * part:.0f}" for part in (share.low, share.value, share.high))
    return f"{share.value * count:,.0f} of {count:,}: {value} % [{low}, {high}]"
