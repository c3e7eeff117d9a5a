"""Faults of odometry and scans, put into good logs, and whether a mapper finds them."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from slamgym.core.geometry import between, compose
from slamgym.core.types import Pose2D, Trajectory
from slamgym.interop import Log
from slamgym.interop.records import interpolated
from slamgym.slam.mapper import SlamStats


class Span(NamedTuple):
    """A time in a log [s], and what is the matter."""

    begin: float
    end: float
    kind: str


ChangedStep = Callable[[Pose2D, float], Pose2D]
"""From the true step between two scans and the second one's time to the reported one."""


def with_steps(log: Log, changed: ChangedStep) -> Log:
    """The log with each step of its odometry changed."""
    pose = last = log.records[0].odometry
    records = []
    for record in log:
        pose = compose(pose, changed(between(last, record.odometry), record.stamp))
        last = record.odometry
        records.append(record._replace(odometry=pose))
    return replace(log, records=records, recorded_track=None)


def scaled(log: Log, span: Span, forward: float = 1.0, turn: float = 1.0) -> Log:
    """Distances and turns within a span times a factor: -1 is a lost sign, 0 what is not measured."""

    def changed(step: Pose2D, stamp: float) -> Pose2D:
        if not span.begin < stamp <= span.end:
            return step
        return Pose2D(forward * step.x, forward * step.y, turn * step.theta)

    return with_steps(log, changed)


def jumped(log: Log, at: float, jump: Pose2D) -> Log:
    """An extra motion in the first step after a moment, in the robot's frame: wheels that slip, or a reset."""
    after = next((record.stamp for record in log if record.stamp > at), math.inf)
    return with_steps(log, lambda step, stamp: compose(step, jump) if stamp == after else step)


def late(log: Log, delay: float) -> Log:
    """Odometry that was measured a time before its scan [s]."""
    track = log.track
    known = Trajectory(track.stamps, track.poses)
    stamps = np.array([record.stamp for record in log])
    poses = interpolated(known, stamps - delay).tolist()
    records = [record._replace(odometry=Pose2D(*pose)) for record, pose in zip(log, poses, strict=True)]
    return replace(log, records=records, recorded_track=None)


def without_scans(log: Log, span: Span) -> Log:
    """No scans within a span."""
    records = [record for record in log if not span.begin < record.stamp <= span.end]
    return replace(log, records=records, recorded_track=None)


def doubtful_spans(stats: SlamStats, gap: float = 5.0) -> list[Span]:
    """Doubts of a mapper as spans: its own, or single scans [s] with those that follow within a gap [s]."""
    spans: list[Span] = []
    for doubt in stats.doubtful:
        begin, end, kind = doubt if isinstance(doubt, tuple) else (doubt, doubt, "doubtful")
        if spans and kind == "doubtful" == spans[-1].kind and begin - spans[-1].end < gap:
            spans[-1] = Span(spans[-1].begin, end, kind)
        else:
            spans.append(Span(begin, end, kind))
    return spans
