"""How firmly a robot believes in its place: which hypothesis leads, for how long, and how much it explains."""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from slamgym.core.types import FloatArray, Pose2D
from slamgym.slam.localization.config import LocalizationConfig
from slamgym.slam.localization.hypothesis import Hypothesis

State = Literal["searching", "ambiguous", "localised", "lost"]


FIELD_FLOOR = (0.01, 0.01, 0.003)
"""Nor is a pose on a map of cells [m], [m], [rad]."""
WIDE_SPREAD = 0.5
"""A place known no better than this isn't known [m]."""
FORGIVEN_METRES, MOST_CONFIRM_METRES = 20.0, 16.0
"""After so many metres without a doubt earlier mistakes are forgotten; and a place never has to prove itself for longer
than the second."""


class Belief(NamedTuple):
    """What the robot believes after a scan."""

    stamp: float
    state: State
    pose: Pose2D
    covariance: FloatArray  # (3, 3) of x, y [m] and theta [rad], within the best hypothesis
    fit: float
    """Share of the beams that the best hypothesis explains, a mean over the latest scans."""
    hypotheses: tuple[tuple[Pose2D, float], ...]
    """Poses with their shares of the weight, the best first."""
    particles: int


class Judge:
    """Tells the states apart, with a memory of earlier mistakes.

    Args:
        config: Thresholds.
        known: The hypothesis of a start that is known.
    """

    def __init__(self, config: LocalizationConfig, known: Hypothesis | None) -> None:
        self._config = config
        self._followed = known
        self._was_localised = known is not None
        self._led = math.inf if known is not None else 0.0
        self._confirm_distance = config.confirm_distance

    def belief(self, stamp: float, driven: float, hypotheses: Sequence[Hypothesis], last: Pose2D) -> Belief:
        """What is believed now, and how firmly.

        Args:
            stamp: Of the scan [s].
            driven: Since the scan before [m].
            hypotheses: The best first.
            last: The pose until now, for a robot without any.
        """
        if not hypotheses:
            return Belief(stamp, "searching", last, np.eye(3), 0.0, (), 0)
        weights = np.exp([hypothesis.log_weight for hypothesis in hypotheses])
        weights /= weights.sum()
        best = hypotheses[0]
        self._follow(best, driven, float(weights[0]))
        pose, covariance = best.estimate
        covariance = covariance + np.diag(np.square(FIELD_FLOOR))
        return Belief(
            stamp,
            self._state(best, float(weights[0]), math.sqrt(covariance[0, 0] + covariance[1, 1])),
            pose,
            covariance,
            best.fit,
            tuple((h.estimate[0], float(weight)) for h, weight in zip(hypotheses, weights, strict=True)),
            sum(len(hypothesis.poses) for hypothesis in hypotheses),
        )

    def _follow(self, best: Hypothesis, driven: float, weight: float) -> None:
        """Count for how long one hypothesis has led with certainty."""
        self._led += driven
        if best is not self._followed:
            if self._followed is not None and self._followed.was_sure:
                # That was a mistake, or the robot was carried off: the next place must prove itself for longer.
                self._confirm_distance = min(2.0 * self._confirm_distance, MOST_CONFIRM_METRES)
            self._followed, self._led = best, 0.0
        if weight < self._config.certain_weight:
            self._led = 0.0

    def _state(self, best: Hypothesis, weight: float, spread: float) -> State:
        config = self._config
        if best.fit < config.minimum_fit:
            return "lost" if self._was_localised else "searching"
        if weight < config.certain_weight:
            return "ambiguous"
        if spread > WIDE_SPREAD:
            return "lost" if self._was_localised else "searching"
        if min(best.driven, self._led) < self._confirm_distance:
            return "searching"
        if not best.was_sure and best.mean_fit < config.claim_fit:
            return "searching"
        best.was_sure = self._was_localised = True
        if self._led > FORGIVEN_METRES:
            self._confirm_distance = config.confirm_distance
        return "localised"
