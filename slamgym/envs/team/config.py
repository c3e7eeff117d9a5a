"""Settings of a team: how many robots explore one building, and when they hear each other."""

from typing import Annotated, Literal

from slamgym.core.config import Positive, Settings, Within

MOST_ROBOTS = 4
"""Robots of a team; each maps for itself, so a step takes as many times as long."""


class TeamConfig(Settings, section="team"):
    """The robots of one building."""

    robots: Annotated[int, Within(ge=1, le=MOST_ROBOTS)] = 1
    """How many robots explore the building, each with its own sensors, errors and mapper."""

    exchange: Literal["always", "range", "meeting"] = "always"
    """When robots exchange maps: ``always``; within ``reach``, walls or not; or when they meet, i.e. one is in sight of
    the other's laser. What one has heard it passes on."""

    reach: Positive = 10.0
    """Range of the radio with ``exchange="range"`` [m]."""

    starts: Literal["known", "unknown"] = "known"
    """``known``: the robots know where they were put down, relative to each other; ``unknown``: a map is used once it
    is sure where it lies on the own one (:mod:`slamgym.slam.merge`)."""
