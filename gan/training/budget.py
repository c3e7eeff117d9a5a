"""Fit a training into a span of time: measure what a step costs, and stretch the schedule to what is left.

The schedule is stretched as a whole, so the learning rate has fallen to 0 when the time is up, and stretched
again as the real rate shows (other work on the machine comes and goes).
"""

import time

import numpy as np

from slamgym.gan.config import TrainConfig
from slamgym.gan.data import PairSet
from slamgym.gan.device import Compute
from slamgym.gan.training.learner import Learner
from slamgym.gan.training.sampler import BatchSampler
from slamgym.gan.training.schedule import Moment, Schedule, Span

WARM_UP_STEPS, MEASURED_STEPS = 1, 2
RESERVE = 0.97
"""Share of the time to plan for; the rest is for validation, checkpoints and the start."""
MIN_CORRECTION = 0.02
"""Smaller corrections aren't worth a new schedule."""


def measure_seconds(schedule: Schedule, pairs: PairSet, config: TrainConfig, compute: Compute) -> list[float]:
    """Wall-clock seconds of one step in each span, measured on networks of their own.

    The networks in training, their optimisers and the order of the data are not touched.
    """
    learner = Learner(config, compute)
    sampler = BatchSampler.of(pairs, config, np.random.default_rng(0))
    measured: dict[tuple[int, int], float] = {}
    for span in schedule.spans:
        key = (span.resolution, span.batch)
        if key not in measured:
            measured[key] = _seconds(learner, sampler, span)
    return [measured[span.resolution, span.batch] for span in schedule.spans]


def _seconds(learner: Learner, sampler: BatchSampler, span: Span) -> float:
    moment = Moment(span.resolution, span.batch, 1.0, 0.0)
    times = []
    for _ in range(WARM_UP_STEPS + MEASURED_STEPS):
        began = time.monotonic()
        learner.step(sampler.draw(span.batch), moment)
        learner.compute.synchronise()
        times.append(time.monotonic() - began)
    return min(times[WARM_UP_STEPS:])


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
        total = 0.0
        for span, seconds in zip(schedule.spans, self.step_seconds, strict=True):
            done = min(step, span.steps)
            step -= done
            total += (span.steps - done) * seconds
        return total

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
