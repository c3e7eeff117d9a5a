"""Verdicts on the paper's claims, by 95 % intervals."""

from typing import Any, Literal, NamedTuple

from slamgym.core.intervals import Interval

ClaimVerdict = Literal[
    "better than the paper",
    "reproduced",
    "less than the paper",
    "too few maps to say",
    "worse than the paper",
]


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


def exact(value: float) -> Interval:
    """A figure without a spread."""
    return Interval(value, value, value)


def intervals_of(found: dict[str, Any]) -> dict[str, Any]:
    """The same with intervals in place of their JSON form."""
    return {name: _as_interval(value) for name, value in found.items()}


def _as_interval(value: Any) -> Any:
    if not isinstance(value, dict):
        return value
    return Interval(value["value"], value["low"], value["high"])


def with_interval(interval: Interval, digits: int = 2) -> str:
    """A figure with its interval, as tables show it."""
    return f"{interval.value:.{digits}f} [{interval.low:.{digits}f}, {interval.high:.{digits}f}]"


def counted_share(share: Interval, count: int) -> str:
    """A share as ``14 of 21: 67 % [45, 83]``."""
    low, value, high = (f"{100 * part:.0f}" for part in (share.low, share.value, share.high))
    return f"{share.value * count:,.0f} of {count:,}: {value} % [{low}, {high}]"
