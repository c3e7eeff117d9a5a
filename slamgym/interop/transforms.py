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
    return Pose2D(
        float(matrix[0, 3]), float(matrix[1, 3]), float(np.arctan2(matrix[1, 0], matrix[0, 0]))
    )


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
        parent, child = clean_frame(parent), clean_frame(child)
        self._parents[child] = parent
        self._latest[child] = matrix
        if self._keeps_history and not static:
            self._history[child].append((stamp, planar(matrix)))

    def moving(self) -> dict[str, str]:
        """Frames that move, each with the frame that it moves in."""
        return {
            child: self._parents[child]
            for child, history in self._history.items()
            if len(history) > 1
        }

    def odometry_frames(self, laser: str) -> list[str]:
        """Frames in which the laser moves, of several those called ``odom``, else those not called as the world is.

        Where the tree doesn't hold the laser, all in which something moves.
        """
        moving, above = self.moving(), self._chain(clean_frame(laser))
        frames = sorted(
            {parent for child, parent in moving.items() if child in above} or {*moving.values()}
        )
        called = [frame for frame in frames if frame.rpartition("/")[2] == "odom"]
        return (
            called
            or [frame for frame in frames if frame.rpartition("/")[2] not in WORLDS]
            or frames
        )

    def base_of(self, frame: str) -> str:
        """The topmost frame to which a frame is fixed."""
        moving, base = self.moving(), clean_frame(frame)
        return next(
            (name for name in self._chain(base) if name in moving or name not in self._parents),
            base,
        )

    def motion(self, parent: str) -> tuple[str, Trajectory]:
        """The frame with the longest history of those that move in ``parent``, and its planar poses, by time."""
        children = [child for child, above in self.moving().items() if above == parent]
        child = max(children, key=lambda one: len(self._history[one]))
        stamps, poses = zip(*sorted(self._history[child], key=lambda entry: entry[0]), strict=True)
        return child, Trajectory(np.array(stamps), np.array(poses))

    def lookup(self, frame: str, ancestor: str) -> FloatArray | None:
        """The latest transform of ``frame`` in ``ancestor``, or in a frame above which both hang; 4 x 4.

        None where the tree doesn't connect the two.
        """
        up, up_ancestor = self._chain(clean_frame(frame)), self._chain(clean_frame(ancestor))
        for name, matrix in up.items():
            if name in up_ancestor:
                return np.linalg.inv(up_ancestor[name]) @ matrix
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
