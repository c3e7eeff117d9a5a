"""Faults of odometry and scans that are put into good logs, and whether a mapper survives or finds them."""

import math
import statistics
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from map_log import map_log

from slamgym.core.geometry import between, compose
from slamgym.core.types import Pose2D, Trajectory
from slamgym.interop import Log
from slamgym.interop.records import interpolated
from slamgym.metrics import absolute_trajectory_error, relative_poses
from slamgym.slam.mapper import SlamStats

STRETCH_SECONDS, STRETCH_METRES, STRETCH_TURN = 10.0, 2.0, 0.5
"""A fault that lasts covers at least this much time, distance [m] and turning [rad], so that it does harm."""
FOUND_SECONDS = 10.0
"""A fault is found if a doubtful span that the unbroken log hasn't begins at most so long after or before it [s]."""
WRONG_METRES = 0.25
"""A path is wrong if its error exceeds that on the unbroken log by more than this [m]."""
COLUMNS = (
    "fault", "mode", "logs", "found", "delay [s]", "right path", "right or found", "wrong and not found",
    "median RMSE [m]", "doubts",
)  # fmt: skip


class Span(NamedTuple):
    """A time in a log [s], and what is the matter."""

    begin: float
    end: float
    kind: str = "fault"


def scaled(log: Log, span: Span, forward: float = 1.0, turn: float = 1.0) -> Log:
    """Distances and turns within a span times a factor: -1 is a lost sign, 0 is what wasn't measured."""

    def changed(step: Pose2D, stamp: float) -> Pose2D:
        if not span.begin < stamp <= span.end:
            return step
        return Pose2D(forward * step.x, forward * step.y, turn * step.theta)

    return with_steps(log, changed)


def jumped(log: Log, span: Span, jump: Pose2D) -> Log:
    """A motion, in the robot's frame, that is added where a span begins: wheels that slip, or a reset."""
    at = next((record.stamp for record in log if record.stamp > span.begin), math.inf)
    return with_steps(log, lambda step, stamp: compose(step, jump) if stamp == at else step)


def with_steps(log: Log, changed: Callable[[Pose2D, float], Pose2D]) -> Log:
    """Each step of the odometry changed, by a function of the step and of the time at its end [s]."""
    pose = last = log.records[0].odometry
    records = []
    for record in log:
        pose = compose(pose, changed(between(last, record.odometry), record.stamp))
        last = record.odometry
        records.append(record._replace(odometry=pose))
    return replace(log, records=records, recorded_track=None)


def late(log: Log, delay: float) -> Log:
    """Odometry that was measured a time before its scan [s]."""
    track = log.track
    in_time = np.argsort(track.stamps, kind="stable")
    known = Trajectory(track.stamps[in_time], track.poses[in_time])
    poses = interpolated(known, np.array([record.stamp for record in log]) - delay).tolist()
    records = [
        record._replace(odometry=Pose2D(*pose)) for record, pose in zip(log, poses, strict=True)
    ]
    return replace(log, records=records, recorded_track=None)


def without_scans(log: Log, span: Span) -> Log:
    """No scans within a span."""
    records = [record for record in log if not span.begin < record.stamp <= span.end]
    return replace(log, records=records, recorded_track=None)


def stretch(log: Log) -> Span:
    """The stretch in the middle of a log in which the robot drives and turns enough.

    Of all that begin in the middle three fifths of the log, it is the one in the middle; if no stretch of at most
    ten times the usual time is long enough, it is the whole log.
    """
    stamps = np.array([record.stamp for record in log])
    poses = np.array([record.odometry for record in log])
    steps = relative_poses(poses[:-1], poses[1:])
    driven = np.concatenate([[0.0], np.hypot(steps[:, 0], steps[:, 1]).cumsum()])
    turned = np.concatenate([[0.0], np.abs(steps[:, 2]).cumsum()])
    ends = np.max(
        [
            np.searchsorted(stamps, stamps + STRETCH_SECONDS),
            np.searchsorted(driven, driven + STRETCH_METRES),
            np.searchsorted(turned, turned + STRETCH_TURN),
        ],
        axis=0,
    )
    first, last = len(log) // 5, 4 * len(log) // 5
    begins = [k for k in range(first, last) if ends[k] < len(log) and steps[k, 0] > 0.0]
    begins = [k for k in begins if stamps[ends[k]] - stamps[k] < 10.0 * STRETCH_SECONDS]
    if not begins:
        return everything(log)
    middle = begins[len(begins) // 2]
    return Span(float(stamps[middle]), float(stamps[ends[middle]]))


def everything(log: Log) -> Span:
    """The whole time of a log."""
    return Span(log.records[0].stamp, log.records[-1].stamp)


FAULTS: dict[str, Callable[[Log, Span], Log]] = {
    "sign of x lost": lambda log, span: scaled(log, span, forward=-1.0),
    "turns reversed": lambda log, span: scaled(log, span, turn=-1.0),
    "turns not measured": lambda log, span: scaled(log, span, turn=0.0),
    "1.5 times the distance": lambda log, span: scaled(log, span, forward=1.5),
    "frozen": lambda log, span: scaled(log, span, forward=0.0, turn=0.0),
    "slip of 30 degrees": lambda log, span: jumped(log, span, Pose2D(0.0, 0.0, math.radians(30.0))),
    "reset by 5.7 m": lambda log, span: jumped(log, span, Pose2D(4.0, -4.0, 0.0)),
    "lost second": lambda log, span: without_scans(log, span._replace(end=span.begin + 1.0)),
}
"""Faults in one stretch of a log, or where it begins, by name."""
ALL_IN_A_STRETCH = "all of these in one stretch"
"""The row of all of :data:`FAULTS` together."""
FAULTS_EVERYWHERE: dict[str, Callable[[Log, Span], Log]] = {
    "late by 0.1 s": lambda log, _: late(log, 0.1),
    "late by 0.3 s": lambda log, _: late(log, 0.3),
    "late by 0.5 s": lambda log, _: late(log, 0.5),
    "all turns reversed": lambda log, whole: scaled(log, whole, turn=-1.0),
    "never moves": lambda log, whole: scaled(log, whole, forward=0.0, turn=0.0),
}
"""Faults in a whole log."""


def fault_rows(
    logs: Mapping[str, tuple[Log, Trajectory | None]], modes: Sequence[str]
) -> list[dict[str, Any]]:
    """A row for each fault and mode over all logs, after one for the unbroken logs and before one for all in a stretch.

    Args:
        logs: Good logs by name, each with the truth if there is one; else the mode's own path on the unbroken log
            is what its other paths are compared with.
        modes: Modes of the mapper.
    """
    rows = []
    for mode in modes:
        trials: dict[str, list[Trial]] = {
            name: [] for name in ("none", *FAULTS, *FAULTS_EVERYWHERE)
        }
        for name, (log, truth) in logs.items():
            for fault, trial in tried(log, truth, mode):
                trials[fault].append(trial)
                print(f"{mode}, {name}, {fault}: {trial}", file=sys.stderr, flush=True)
        rows += [fault_row(fault, mode, some) for fault, some in trials.items()]
        in_a_stretch = [trial for fault in FAULTS for trial in trials[fault]]
        rows.append(fault_row(ALL_IN_A_STRETCH, mode, in_a_stretch))
    return rows


class Trial(NamedTuple):
    """A fault in one log."""

    error: float  # RMSE of the path after alignment [m]
    is_right: bool
    delay: float | None  # until it was found [s]
    spans: list[Span]  # that the mapper doubts

    def __str__(self) -> str:
        doubts = "; ".join(f"{kind} {begin:.1f}-{end:.1f} s" for begin, end, kind in self.spans)
        verdict = ("" if self.is_right else "wrong") + ("" if self.delay is None else " found")
        return f"{self.error:.2f} m {verdict} {doubts}"


def tried(log: Log, truth: Trajectory | None, mode: str) -> Iterator[tuple[str, Trial]]:
    """Each fault in a log, after ``none``, which judges the unbroken log."""

    def mapped(broken: Log) -> tuple[Trajectory, list[Span]]:
        result = map_log(broken, mode)
        return result.trajectory, doubtful_spans(result.stats)

    def error_of(path: Trajectory) -> float:
        # By the laser alone a path begins at the origin.
        return absolute_trajectory_error(path, reference, align=True).translation.rmse

    path, usual = mapped(log)
    reference = path if truth is None else truth
    unbroken = error_of(path)
    yield "none", Trial(unbroken, True, None, usual)
    where = stretch(log)
    for name, put_in in {**FAULTS, **FAULTS_EVERYWHERE}.items():
        path, spans = mapped(put_in(log, where if name in FAULTS else everything(log)))
        error = error_of(path)
        new = [span for span in spans if not any(overlap(span, old) for old in usual)]
        delays = [span.begin - where.begin for span in new]
        if name in FAULTS:
            delays = [delay for delay in delays if abs(delay) <= FOUND_SECONDS]
        yield (
            name,
            Trial(
                error, error < unbroken + WRONG_METRES, min(delays, key=abs, default=None), spans
            ),
        )


def overlap(a: Span, b: Span) -> bool:
    """True if two spans share a moment."""
    return a.begin <= b.end and b.begin <= a.end


def fault_row(fault: str, mode: str, trials: Sequence[Trial]) -> dict[str, Any]:
    """One fault over all logs."""
    delays = [trial.delay for trial in trials if trial.delay is not None]
    return {
        "fault": fault,
        "mode": mode,
        "logs": len(trials),
        "found": len(delays),
        "delay [s]": round(statistics.median(delays), 1) if delays and fault in FAULTS else None,
        "right path": sum(trial.is_right for trial in trials),
        "right or found": sum(trial.is_right or trial.delay is not None for trial in trials),
        "wrong and not found": sum(not trial.is_right and trial.delay is None for trial in trials),
        "median RMSE [m]": round(statistics.median(trial.error for trial in trials), 3),
        "doubts": round(statistics.mean(len(trial.spans) for trial in trials), 1),
    }


def doubtful_spans(stats: SlamStats) -> list[Span]:
    """Doubts of a mapper."""
    return [Span(*span) for span in stats.spans()]
