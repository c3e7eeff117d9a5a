"""A log's odometry as a whole: jumps are taken out, stamps are shifted, or it is left out."""

from dataclasses import replace

import numpy as np

from slamgym.core.geometry import between, compose, inverse, transform_poses, wrap_angle
from slamgym.core.types import BoolArray, FloatArray, IntArray, Pose2D, Trajectory
from slamgym.interop.records import Log, LogFinding, OdometryTrack, interpolated

FASTEST_DRIVE = 5.0
"""Robots of laboratories and homes drive more slowly [m/s]: at most 2 in the public logs."""
FASTEST_TURN = 6.0
"""Robots of laboratories and homes turn more slowly [rad/s]: at most 4 in the public logs."""
LONGEST_STEP = 100.0
"""Nothing that a laser sees at two moments so far apart is the same: what drives on so far is a jump [m]."""
LEAST_JUMP = 0.5
"""Shorter steps of the odometry are no jumps [m or rad]."""
MUCH_FASTER = 5.0
"""A faster vehicle's odometry jumps where it is so many times as fast as in half of the log."""


def with_track(log: Log, track: OdometryTrack) -> Log:
    """The log with other odometry poses, at the scans and between them, and the scans' motions by them."""
    at_first = track.poses[track.scans]
    takes_time = log.geometry.scan_time > 0.0
    at_last = _after(track, log.geometry.scan_time) if takes_time else at_first
    poses = zip(at_first.tolist(), at_last.tolist(), strict=True)
    records = []
    for record, (first, last) in zip(log.records, poses, strict=True):
        scan = record.scan
        if takes_time:
            scan = replace(scan, motion=between(Pose2D(*first), Pose2D(*last)))
        records.append(record._replace(odometry=Pose2D(*first), scan=scan))
    return replace(log, records=records, recorded_track=track)


def _after(track: OdometryTrack, seconds: float) -> FloatArray:
    """Poses (S, 3) so long after each scan's stamp."""
    in_time = np.argsort(track.stamps, kind="stable")
    odometry = Trajectory(track.stamps[in_time], track.poses[in_time])
    return interpolated(odometry, track.stamps[track.scans] + seconds)


def merged_track(odometry: Trajectory, stamps: FloatArray) -> OdometryTrack:
    """Odometry with its values at the scans' moments, ``stamps`` [s], in the order of time."""
    at_scans = interpolated(odometry, stamps)
    all_stamps = np.concatenate([odometry.stamps, stamps])
    all_poses = np.concatenate([odometry.poses, at_scans])
    order = np.argsort(all_stamps, kind="stable")
    scans = np.flatnonzero(order >= len(odometry))
    return OdometryTrack(all_stamps[order], all_poses[order], scans)


def retimed(log: Log, late: float) -> Log:
    """The log with odometry whose stamps are set back by ``late`` [s]."""
    if late == 0.0 or not log.has_odometry:
        return log
    track = log.track
    order = np.argsort(track.stamps, kind="stable")
    odometry = Trajectory(track.stamps[order] - late, track.poses[order])
    scan_stamps = np.array([record.stamp for record in log])
    return with_track(log, merged_track(odometry, scan_stamps))


def without_odometry(log: Log) -> Log:
    """The log with its scans alone: the odometry stands still."""
    track = log.track
    at_rest = np.zeros_like(track.poses)
    still = with_track(log, OdometryTrack(track.stamps, at_rest, track.scans))
    return replace(still, has_odometry=False, distrusted=())


def without_jumps(odometry: Trajectory) -> tuple[FloatArray, tuple[LogFinding, ...]]:
    """Poses without the steps that no robot makes between two stamps, where odometry was reset; and what to say.

    The robot is taken to stand still meanwhile.
    """
    poses = odometry.poses
    if len(poses) < 2:
        return poses, ()
    waits = _longest_waits(odometry.stamps)
    moved = np.diff(poses[:, :2], axis=0)
    drives = np.hypot(moved[:, 0], moved[:, 1])
    turns = np.abs(wrap_angle(np.diff(poses[:, 2])))
    impossible = _impossible(drives, waits, FASTEST_DRIVE) | _impossible(turns, waits, FASTEST_TURN)
    impossible |= drives > LONGEST_STEP
    jumps = np.flatnonzero(impossible)
    if not len(jumps):
        return poses, ()
    worst = jumps[np.argmax(drives[jumps])]
    drive = drives[worst]
    turn = np.degrees(turns[worst])
    when = odometry.stamps[worst + 1] - odometry.stamps[0]
    finding = LogFinding(
        "jump",
        f"the odometry jumps (in {len(jumps)} places; by {drive:.1f} m and {turn:.0f} degrees within "
        f"{waits[worst]:.2g} s, {when:.1f} s after the start): such steps are left out "
        "(--odometry-topic none uses the laser alone); where the robot was carried, cut the log",
    )
    return _joined(poses, jumps), (finding,)


def _longest_waits(stamps: FloatArray) -> FloatArray:
    """The time that each step may have taken, shape (N - 1,) [s]: the longest wait next to it counts.

    Messages may come in bursts, after a pause in which the robot drove.
    """
    waits = np.maximum(np.diff(stamps), 1e-3)
    padded = np.pad(waits, 1, mode="edge")
    before = padded[:-2]
    after = padded[2:]
    return np.maximum(np.maximum(before, waits), after)


def _impossible(steps: FloatArray, waits: FloatArray, fastest: float) -> BoolArray:
    """Where the robot would have moved faster than ``fastest`` and than this log's robot does.

    Args:
        steps: How far it drove or turned at once, shape (N,) [m or rad].
        waits: In what time [s].
        fastest: Speed that a slow robot doesn't reach [m/s or rad/s].
    """
    speeds = steps / waits
    limit = np.maximum(fastest, MUCH_FASTER * np.median(speeds))
    return (speeds > limit) & (steps > LEAST_JUMP)


def _joined(poses: FloatArray, jumps: IntArray) -> FloatArray:
    """The poses, of which all after a jump are moved back to where the robot was before it."""
    joined = poses.copy()
    back = Pose2D(0.0, 0.0, 0.0)
    for jump in jumps.tolist():
        before = Pose2D(*poses[jump].tolist())
        after = Pose2D(*poses[jump + 1].tolist())
        back = compose(back, compose(before, inverse(after)))
        joined[jump + 1 :] = transform_poses(back, poses[jump + 1 :])
    return joined
