"""Frames of a ROS bag: the tree of transforms between them, and the one in which the odometry is given."""

from collections import defaultdict

import numpy as np
from scipy.spatial.transform import Rotation

from slamgym.core.types import FloatArray, Pose2D, Trajectory
from slamgym.interop.records import MAX_ABS_COORDINATE, BrokenMessageError

WORLDS = ("map", "world", "earth")
"""Frames in which a SLAM program or a simulator moves the robot, with jumps."""


def clean_frame(name: str) -> str:
    """A frame's name without the leading slash that ROS 1 allowed."""
    return name.lstrip("/")


def _own_name(frame: str) -> str:
    """A frame's name without the robot's that stands before it, as in ``robot1/odom``."""
    return frame.rpartition("/")[2]


def rigid_transform(
    translation: FloatArray, quaternion: FloatArray, what: str = "transform"
) -> FloatArray:
    """Return the 4 x 4 matrix of a translation [m] and a quaternion (x, y, z, w).

    Raises:
        BrokenMessageError: Named by ``what``, if the quaternion is zero, a rotation that was never set.
        ValueError: If a value is no number or absurdly large.
    """
    if not (np.abs([*translation, *quaternion]) < MAX_ABS_COORDINATE).all():  # false for nan
        raise ValueError("transform with broken numbers")
    if np.linalg.norm(quaternion) <= 1e-6:
        raise BrokenMessageError(f"{what} with a quaternion of zeros, which is no rotation")
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    matrix[:3, 3] = translation
    return matrix


def planar(matrix: FloatArray) -> Pose2D:
    """Position and heading of a transform, seen from above."""
    x = float(matrix[0, 3])
    y = float(matrix[1, 3])
    theta = float(np.arctan2(matrix[1, 0], matrix[0, 0]))
    return Pose2D(x, y, theta)


class TransformTree:
    """Edges from child frames to their parents, with their history.

    Convention: the transform of an edge expresses points of the child frame in the parent frame.

    Args:
        keeps_history: False to keep only the latest transform of each edge.
    """

    def __init__(self, *, keeps_history: bool = True) -> None:
        self._keeps_history = keeps_history
        self._parents: dict[str, str] = {}
        self._latest: dict[str, FloatArray] = {}
        self._history: dict[str, list[tuple[float, Pose2D]]] = defaultdict(list)

    def add(
        self, parent: str, child: str, stamp: float, matrix: FloatArray, *, static: bool
    ) -> None:
        """Take one published transform."""
        child = clean_frame(child)
        self._parents[child] = clean_frame(parent)
        self._latest[child] = matrix
        if self._keeps_history and not static:
            self._history[child].append((stamp, planar(matrix)))

    def moving(self) -> dict[str, str]:
        """Frames that move, each with the frame that it moves in."""
        moving = {}
        for child, history in self._history.items():
            if len(history) > 1:
                moving[child] = self._parents[child]
        return moving

    def odometry_frames(self, laser: str) -> list[str]:
        """Frames in which the laser moves, of several those called ``odom``, else those not called as the world is.

        Where the tree doesn't hold the laser, all in which something moves.
        """
        moving = self.moving()
        above = self._chain(clean_frame(laser))
        carrying = {parent for child, parent in moving.items() if child in above}
        frames = sorted(carrying or set(moving.values()))
        called_odom = [frame for frame in frames if _own_name(frame) == "odom"]
        no_worlds = [frame for frame in frames if _own_name(frame) not in WORLDS]
        return called_odom or no_worlds or frames

    def base_of(self, frame: str) -> str:
        """The topmost frame to which a frame is fixed."""
        moving = self.moving()
        base = clean_frame(frame)
        for name in self._chain(base):
            if name in moving or name not in self._parents:
                return name
        return base

    def motion(self, parent: str) -> tuple[str, Trajectory]:
        """The frame with the longest history of those that move in ``parent``, and its planar poses, by time."""
        children = [child for child, above in self.moving().items() if above == parent]
        child = max(children, key=lambda one: len(self._history[one]))
        history = sorted(self._history[child], key=lambda entry: entry[0])
        stamps = np.array([stamp for stamp, _ in history])
        poses = np.array([pose for _, pose in history])
        return child, Trajectory(stamps, poses)

    def lookup(self, frame: str, ancestor: str) -> FloatArray | None:
        """The latest transform of ``frame`` in ``ancestor``, or in a frame above which both hang; 4 x 4.

        None where the tree doesn't connect the two.
        """
        above_frame = self._chain(clean_frame(frame))
        above_ancestor = self._chain(clean_frame(ancestor))
        for name, matrix in above_frame.items():
            if name in above_ancestor:
                return np.linalg.inv(above_ancestor[name]) @ matrix
        return None

    def _chain(self, frame: str) -> dict[str, FloatArray]:
        """Each frame above ``frame`` (itself included) and the transform of ``frame`` in it."""
        matrix = np.eye(4)
        chain = {frame: matrix}
        while frame in self._parents and self._parents[frame] not in chain:
            matrix = self._latest[frame] @ matrix
            frame = self._parents[frame]
            chain[frame] = matrix
        return chain
