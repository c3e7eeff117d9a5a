"""Schedule of a training: resolution, fade-in, batch and learning rate of each step.

The resolution grows from coarse to fine. Each new one is faded in linearly over its own passes, from one step's
share to exactly 1 at the last (the published code's fade hardly moves before it jumps). The learning rate is
constant and then falls linearly to 0, by the share of images seen: 70 % and 30 % in the paper.

A training for a span of time has its schedule stretched as a whole, so the learning rate has fallen to 0 when the time
is up, and stretched again as the real rate shows (other work on the machine comes and goes).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from slamgym.gan.config import OptimiserConfig, Stage

RESERVE = 0.97
"""Share of the time to plan for; the rest is for validation, checkpoints and the start."""
MIN_CORRECTION = 0.02
"""Smaller corrections aren't worth a new schedule."""


class Span(NamedTuple):
    """Steps that are alike."""

    resolution: int
    batch: int
    steps: int
    fading: bool


class Moment(NamedTuple):
    """Settings of one step."""

    resolution: int
    batch: int
    fade: float
    """Share of the newest head and entrances, in (0, 1]."""
    rate: float
    """Share of the full learning rate, in [0, 1]."""


@dataclass(frozen=True)
class Schedule:
    """The spans of a training, in order."""

    spans: tuple[Span, ...]
    warm_up: float = 0.0
    decay: float = 0.3

    @property
    def steps(self) -> int:
        """Steps of the whole training."""
        return sum(span.steps for span in self.spans)

    @property
    def images(self) -> int:
        """Pairs drawn in the whole training."""
        return sum(span.batch * span.steps for span in self.spans)

    def progress(self, step: int) -> list[tuple[Span, int]]:
        """Each span with how many of its steps are done before this step of the training."""
        first = 0
        parts = []
        for span in self.spans:
            parts.append((span, min(max(step - first, 0), span.steps)))
            first += span.steps
        return parts

    def images_before(self, step: int) -> int:
        """Pairs drawn before this step."""
        return sum(span.batch * done for span, done in self.progress(step))

    def moment(self, step: int) -> Moment:
        """Settings of a step, counted from 0.

        Raises:
            IndexError: If the training has no such step.
        """
        rate = self._rate(self.images_before(step) / max(1, self.images))
        for span, done in self.progress(step):
            if step >= 0 and done < span.steps:
                fade = (done + 1) / span.steps if span.fading else 1.0
                return Moment(span.resolution, span.batch, fade, rate)
        raise IndexError(f"the training has {self.steps} steps, but no step {step}")

    def stretched(self, step: int, factor: float) -> "Schedule":
        """The schedule with everything after ``step`` made longer or shorter; every open span keeps a step."""
        spans = []
        for span, done in self.progress(step):
            rest = span.steps - done
            spans.append(span._replace(steps=done + (max(1, round(rest * factor)) if rest else 0)))
        return Schedule(tuple(spans), self.warm_up, self.decay)

    def _rate(self, share: float) -> float:
        if share < self.warm_up:
            # The first step must already move.
            return max(share / self.warm_up, 0.01)
        if self.decay > 0.0 and share > 1.0 - self.decay:
            return (1.0 - share) / self.decay
        return 1.0


def plan_schedule(stages: Sequence[Stage], pairs: int, optimiser: OptimiserConfig) -> Schedule:
    """The schedule of a training by epochs.

    Args:
        stages: From coarse to fine.
        pairs: Training pairs: what one epoch is.
        optimiser: Warm-up and decay of the learning rate.
    """
    spans = []
    for stage in stages:
        if stage.fade_epochs > 0.0:
            batch = stage.fade_batch or stage.batch
            spans.append(Span(stage.resolution, batch, _steps(stage.fade_epochs, pairs, batch), True))
        stable = stage.epochs - stage.fade_epochs
        if stable > 0.0:
            spans.append(Span(stage.resolution, stage.batch, _steps(stable, pairs, stage.batch), False))
    return Schedule(tuple(spans), optimiser.warm_up, optimiser.decay)


def _steps(epochs: float, pairs: int, batch: int) -> int:
    return max(1, round(epochs * pairs / batch))


class Budget:
    """Keeps a schedule within a span of wall-clock time."""

    def __init__(self, seconds: float, step_seconds: list[float]) -> None:
        """Prepare.

        Args:
            seconds: Of the whole training, interruptions not counted.
            step_seconds: Of a step in each span.
        """
        self.seconds = seconds
        self.step_seconds = step_seconds

    def predicted(self, schedule: Schedule, step: int) -> float:
        """Seconds that the steps from ``step`` on take."""
        costs = zip(schedule.progress(step), self.step_seconds, strict=True)
        return sum((span.steps - done) * seconds for (span, done), seconds in costs)

    def fitted(self, schedule: Schedule, step: int, used: float) -> Schedule:
        """The schedule with its rest stretched to the time that is left.

        Args:
            schedule: The present one.
            step: How many steps are done.
            used: Seconds used so far.
        """
        left = max(0.0, RESERVE * self.seconds - used)
        predicted = self.predicted(schedule, step)
        if predicted <= 0.0:
            return schedule
        factor = left / predicted
        return schedule if abs(factor - 1.0) < MIN_CORRECTION else schedule.stretched(step, factor)

    def observe(self, predicted: float, taken: float) -> None:
        """Correct the costs of a step by what a stretch of training was predicted to take and took."""
        if predicted > 0.0 and taken > 0.0:
            ratio = min(max(taken / predicted, 0.25), 4.0)
            self.step_seconds = [seconds * ratio for seconds in self.step_seconds]
