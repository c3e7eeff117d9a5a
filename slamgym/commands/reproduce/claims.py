"""What the paper claims, and how each claim fared in one's own run.

Figures of Daher, Chakhachiro and Asmar, *From SLAM to CAD Maps and Back Using Generative Models*: 14 of 21 maps
improved with mean MSE2 0.114 and MSE1 0.087 (Table I), 17 days on a cluster for some 35,000 plans at 7 minutes each,
4,225 pairs left after cleaning, 15-94 s for the EKF at 64 px and 2.6-3.6 s for the two-phase method at 256 px in
Matlab (Table II).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, Literal, NamedTuple

from slamgym.commands.reproduce.steps import OWN_NETWORK, PAPER_NETWORK, REDRAWN, TO_SLAM, TRAINED

PAPER_MAPS_AN_HOUR = 86.0
PAPER_SECONDS = {"ekf": "15-94", "two_phase": "2.6-3.6"}
_NULL = "simulated, other maps"
_SECONDS = re.compile(r"^\|[^|]+\| *(\w+) \| *\d+ \| *([0-9.]+) \|", re.MULTILINE)

ClaimVerdict = Literal["holds", "does not hold", "too few maps to say"]


class Claim(NamedTuple):
    """One claim of the paper beside one's own figure."""

    what: str
    paper: str
    own: str
    verdict: ClaimVerdict


def judge_claims(
    evaluation: Mapping[str, Any], statistics: Mapping[str, Any], conversions: Mapping[str, list[float]]
) -> list[Claim]:
    """All claims.

    Args:
        evaluation: ``evaluation.json`` of ``slamgym gan evaluate``.
        statistics: ``slamgym dataset stats --json``.
        conversions: Seconds of the parametric model by method, one for each map.
    """
    return [
        *_translation(evaluation["methods"]),
        *_drawing_back(evaluation["realism"]),
        _speed_of_conversion(conversions),
        *_making(statistics["whole"]),
    ]


def conversion_seconds(table: str) -> dict[str, list[float]]:
    """CPU times by conversion, from the ``table2.md`` of ``slamgym deform --figures``."""
    times: dict[str, list[float]] = {}
    for conversion, seconds in _SECONDS.findall(table):
        times.setdefault(conversion, []).append(float(seconds))
    return times


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
            f"{round(share['value'] * found['count'])} of {found['count']}: {_percent(share)}; "
            f"sign test p = {found['sign_p']:.2g}",
            _above(share, 0.5),
        )
        yield Claim(
            f"Table I: {network} lowers the mean squared error (ratio of the means)",
            "0.76 (0.087 / 0.114)",
            f"{ratio['value']:.2f} [{ratio['low']:.2f}, {ratio['high']:.2f}]; Wilcoxon p = {found['wilcoxon_p']:.2g}",
            _below(ratio, 1.0),
        )


def _drawing_back(realism: Mapping[str, Any] | None) -> Iterator[Claim]:
    """Figures 7 and 9: the paper shows pictures; a two-sample test says whether the eye is right."""
    if realism is None:
        return
    null = next(x["extra_trees"]["accuracy"] for x in realism["kinds"] if x["name"] == _NULL)
    for entry in realism["kinds"]:
        name = entry["name"]
        if name in REDRAWN or (name.startswith(TO_SLAM) and not name.endswith("bent")):
            found = entry["extra_trees"]
            yield Claim(
                f"Figures 7 and 9: maps made from CAD maps look like SLAM maps, by {name}",
                "by eye",
                f"a classifier tells {found['accuracy']:.2f} [{found['low']:.2f}, {found['high']:.2f}] apart "
                f"(0.5: it can't; between simulated maps {null:.2f})",
                "does not hold" if found["low"] > 0.5 else "too few maps to say",
            )


def _speed_of_conversion(conversions: Mapping[str, list[float]]) -> Claim:
    """Table II."""
    own = {method: sum(values) / len(values) for method, values in conversions.items()}
    return Claim(
        "Table II: the two-phase method is faster than the EKF, at sixteen times the cells",
        ", ".join(f"{method} {seconds} s" for method, seconds in PAPER_SECONDS.items()),
        ", ".join(f"{method} {seconds:.2g} s" for method, seconds in own.items()),
        "holds" if own["two_phase"] < own["ekf"] else "does not hold",
    )


def _making(whole: Mapping[str, Any]) -> Iterator[Claim]:
    """What a dataset costs."""
    if whole["cpu_seconds"]:
        rate = 3600.0 / whole["cpu_seconds"]
        yield Claim(
            "Explorations cost days on a cluster",
            f"about {PAPER_MAPS_AN_HOUR:.0f} maps an hour on a cluster",
            f"{rate:.0f} maps an hour on one core ({whole['cpu_seconds']:.1f} CPU s each)",
            "holds" if rate <= PAPER_MAPS_AN_HOUR else "does not hold",
        )
    if whole["kept"] is not None:
        yield Claim(
            "Few explorations are good enough to learn from",
            "12 % (4,225 of some 35,000)",
            f"{100 * whole['kept']:.0f} % of {whole['pairs']}",
            "holds" if whole["kept"] < 0.5 else "does not hold",
        )


def _percent(share: Mapping[str, float]) -> str:
    return f"{100 * share['value']:.0f} % [{100 * share['low']:.0f}, {100 * share['high']:.0f}]"


def _above(interval: Mapping[str, float], limit: float) -> ClaimVerdict:
    if interval["low"] > limit:
        return "holds"
    return "does not hold" if interval["high"] < limit else "too few maps to say"


def _below(interval: Mapping[str, float], limit: float) -> ClaimVerdict:
    if interval["high"] < limit:
        return "holds"
    return "does not hold" if interval["low"] > limit else "too few maps to say"
