"""Schedule of a training: resolution, fade-in, batch and learning rate of each step.

The resolution grows from coarse to fine. Each new one is faded in linearly over its own passes, from one step's
share to exactly 1 at the last (the published code's fade hardly moves before it jumps). The learning rate is
constant and then falls linearly to 0, by the share of images seen: 70 % and 30 % in the paper.

A training for a span of time is as far along its schedule as its time is used, however fast the machine is: the
learning rate has fallen to 0 when the time is up, and every stage gets its share.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from slamgym.gan.config import OptimiserConfig, Stage


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
    def images(self) -> int:
        """Pairs drawn in the whole training."""
        return sum(span.batch * span.steps for span in self.spans)

    def moment(self, done: float) -> Moment:
        """Settings of a step.

        Args:
            done: Pairs drawn before it, or as many as the time used is worth.

        Raises:
            IndexError: If the training ends before.
        """
        left = done
        for span in self.spans:
            images = span.batch * span.steps
            if left < images:
                fade = min(1.0, (left + span.batch) / images) if span.fading else 1.0
                rate = self._rate(done / self.images)
                return Moment(span.resolution, span.batch, fade, rate)
            left -= images
        raise IndexError(f"the training draws {self.images} pairs, but none after {done:g}")

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
            steps = _steps(stage.fade_epochs, pairs, batch)
            spans.append(Span(stage.resolution, batch, steps, fading=True))
        stable = stage.epochs - stage.fade_epochs
        if stable > 0.0:
            steps = _steps(stable, pairs, stage.batch)
            spans.append(Span(stage.resolution, stage.batch, steps, fading=False))
    return Schedule(tuple(spans), optimiser.warm_up, optimiser.decay)


def _steps(epochs: float, pairs: int, batch: int) -> int:
    return max(1, round(epochs * pairs / batch))
