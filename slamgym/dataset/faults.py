"""What makes a map unfit for a dataset, as records; :attr:`MapFault.sentence` alone puts them into words."""

from dataclasses import dataclass
from typing import Literal

MapFaultKind = Literal[
    "coverage", "map_error", "position_error", "hardly_driven", "no_free_space", "few_walls", "many_walls",
    "one_view", "incomplete", "doubtful", "unreadable", "low_coverage", "not_clean", "too_large",
]  # fmt: skip

_ENDINGS = {
    "explored": "the explorer saw nothing left that it could reach",
    "time_limit": "time limit",
    "coverage": "coverage goal",
}
_WORDS: dict[MapFaultKind, tuple[str, str]] = {
    "coverage": ("coverage", "coverage {below} < {limit:.2f}"),
    "map_error": ("map error", "map error {value:.2f} m > {limit:.2f} m"),
    "position_error": ("position error", "position error {value:.2f} m > {limit:.2f} m"),
    "hardly_driven": ("stuck", "stuck: drove {value:.1f} m"),
    "no_free_space": ("stuck", "stuck: the map shows no free space"),
    "few_walls": ("stuck", "stuck: few occupied cells for the free ones ({value:.3f})"),
    "many_walls": ("stuck", "stuck: many occupied cells for the free ones ({value:.3f})"),
    "one_view": ("stuck", "stuck: {value:.0f} m2 seen, no more than from one place, with a way on"),
    "incomplete": ("incomplete", "incomplete: probability {value:.2f} of being complete < {limit:.2f}"),
    "doubtful": ("doubtful", "doubtful: probability {value:.2f} of being complete < {limit:.2f}"),
    "unreadable": ("unreadable", "{detail}"),
    "low_coverage": ("low coverage", "low coverage: {value:.3f} < {limit:g}, ended by {detail}"),
    "not_clean": ("not clean", "not clean: {detail}"),
    "too_large": ("too large", "too large: {value:.1f} m long but the image shows {limit:.1f} m"),
}
"""Of each kind, the reason under which it is counted, and its sentence."""


@dataclass(frozen=True)
class MapFault:
    """Why a map is not fit, or not surely."""

    kind: MapFaultKind
    value: float = 0.0
    """What was measured, where something was."""
    limit: float = 0.0
    """What would have been good enough, where there is such a limit."""
    detail: str = ""
    """Of a low coverage: how the exploration ended; else what the figures don't say."""

    @property
    def reason(self) -> str:
        """Under what it is counted: the kind without figures, but with how the exploration ended."""
        name = _WORDS[self.kind][0]
        return f"{name}: {self._ending}" if self.kind == "coverage" and self.detail else name

    @property
    def sentence(self) -> str:
        """The fault in words."""
        text = _WORDS[self.kind][1].format(
            value=self.value, limit=self.limit, detail=self.detail, below=_below(self.value, self.limit)
        )
        return f"{text}: {self._ending}" if self.kind == "coverage" and self.detail else text

    @property
    def is_stuck(self) -> bool:
        """Whether it means that the robot got stuck."""
        return self.reason == "stuck"

    @property
    def _ending(self) -> str:
        return _ENDINGS.get(self.detail, self.detail)


def _below(value: float, limit: float) -> str:
    """A value less than a limit, with as many digits as it takes to see that."""
    for digits in (2, 3, 4):
        text = f"{value:.{digits}f}"
        if float(text) < limit:
            return text
    return f"{value:.6f}"
