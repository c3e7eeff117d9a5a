"""A log's odometry as a whole: jumps are taken out, stamps are shifted, or it is left out."""

from dataclasses import replace

import numpy as np

from slamgym.core.geometry import compose, inverse, transform_poses, wrap_angle
from slamgym.core.types import FloatArray, Pose2D, Trajectory
from slamgym.interop.records import Log, LogFinding, OdometryTrack, interpolated

FASTEST, LEAST_JUMP = (5.0, 6.0), 0.5
"""Robots of laboratories and homes move and turn more slowly [m/s, rad/s]: 2 and 4 in the public logs. Steps below the
second are no jumps [m or rad]."""
MUCH_FASTER = 5.0
"""A faster vehicle's odometry jumps where it is so many times as fast as in half of the log."""


def with_track(log: Log, track: OdometryTrack) -> Log:
    """The log with other odometry poses, at the scans and between them."""
    poses = map(Pose2D._make, track.poses[track.scans].tolist())
    records = [
        record._replace(odometry=pose) for record, pose in zip(log.records, poses, strict=True)
    ]
    return replace(log, records=records, recorded_track=track)


def merged_track(odometry: Trajectory, stamps: FloatArray) -> OdometryTrack:
    """Odometry with its values at the scans' moments, ``stamps`` [s], in the order of time."""
    every = np.concatenate([odometry.stamps, stamps])
    poses = np.concatenate([odometry.poses, interpolated(odometry, stamps)])
    order = np.argsort(every, kind="stable")
    return OdometryTrack(every[order], poses[order], np.flatnonzero(order >= len(odometry)))


def retimed(log: Log, late: float) -> Log:
    """The log with odometry whose stamps are set back by ``late`` [s]."""
    if late == 0.0 or not log.has_odometry:
        return log
    order = np.argsort(log.track.stamps, kind="stable")
    odometry = Trajectory(log.track.stamps[order] - late, log.track.poses[order])
    return with_track(log, merged_track(odometry, np.array([record.stamp for record in log])))


def without_odometry(log: Log) -> Log:
    """The log with its scans alone: the odometry stands still."""
    track = log.track
    still = OdometryTrack(track.stamps, np.zeros_like(track.poses), track.scans)
    return replace(with_track(log, still), has_odometry=False, distrusted=())


def without_jumps(odometry: Trajectory) -> tuple[FloatArray, tuple[LogFinding, ...]]:
    """Poses without the steps that no robot makes between two stamps, where odometry was reset; and what to say.

    The robot is taken to stand still meanwhile.
    """
    stamps, poses = odometry.stamps, odometry.poses
    if len(poses) < 2:
        return poses, ()
    # Messages may come in bursts, after a pause in which the robot drove: the longest wait around a step counts.
    waits = np.pad(np.maximum(np.diff(stamps), 1e-3), 1, mode="edge")
    waits = np.maximum(np.maximum(waits[:-2], waits[1:-1]), waits[2:])
    steps = np.array(
        [np.hypot(*np.diff(poses[:, :2], axis=0).T), np.abs(wrap_angle(np.diff(poses[:, 2])))]
    )
    usual = np.median(steps / waits, axis=1)
    too_fast = steps / waits > np.maximum(FASTEST, MUCH_FASTER * usual)[:, None]
    jumps = np.flatnonzero((too_fast & (steps > LEAST_JUMP)).any(axis=0))
    if not len(jumps):
        return poses, ()
    joined, whole = poses.copy(), Pose2D(0.0, 0.0, 0.0)
    for jump in jumps.tolist():
        away = compose(Pose2D(*poses[jump].tolist()), inverse(Pose2D(*poses[jump + 1].tolist())))
        whole = compose(whole, away)
        joined[jump + 1 :] = transform_poses(whole, poses[jump + 1 :])
    worst = jumps[np.argmax(steps[0, jumps])]
    step, turn, when = steps[0, worst], np.degrees(steps[1, worst]), stamps[worst + 1] - stamps[0]
    sentence = (
        f"the odometry jumps (in {len(jumps)} places; by {step:.1f} m and {turn:.0f} degrees within {waits[worst]:.2g} "
        f"s, {when:.1f} s after the start): such steps are left out (--odometry-topic none uses the laser alone); "
        "where the robot was carried, cut the log"
    )
    return joined, (LogFinding("jump", sentence),)
