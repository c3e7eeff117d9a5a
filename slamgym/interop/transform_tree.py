"""Coordinate frames of a robot as ROS's tf publishes them, reduced to the plane where needed."""

from collections import defaultdict

import numpy as np

from slamgym.core.types import FloatArray, Pose2D, Trajectory
from slamgym.interop.records import MAX_ABS_COORDINATE

MAX_DEPTH = 50


def clean_frame(name: str) -> str:
    """A frame's name without the leading slash that ROS 1 allowed."""
    return name.lstrip("/")


def rigid_transform(translation: FloatArray, quaternion: FloatArray) -> FloatArray:
    """The 4 x 4 matrix of a translation [m] and a quaternion (x, y, z, w).

    Raises:
        ValueError: If a value is no number, absurdly large, or the quaternion is zero.
    """
    # A comparison with nan is False.
    if not (
        (np.abs(translation) < MAX_ABS_COORDINATE).all() and (np.abs(quaternion) < MAX_ABS_COORDINATE).all()
    ):
        raise ValueError("transform with broken numbers")
    norm = float(np.linalg.norm(quaternion))
    if norm <= 1e-6:
        raise ValueError("transform with broken numbers")
    x, y, z, w = quaternion / norm
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, 3] = translation
    return matrix


def planar(matrix: FloatArray) -> Pose2D:
    """Position and heading of a transform, seen from above."""
    return Pose2D(float(matrix[0, 3]), float(matrix[1, 3]), float(np.arctan2(matrix[1, 0], matrix[0, 0])))


class TransformTree:
    """Edges from child frames to their parents, with their history.

    Convention: the transform of an edge expresses points of the child frame in the parent frame.
    """

    def __init__(self) -> None:
        self._parents: dict[str, str] = {}
        self._latest: dict[str, FloatArray] = {}
        self._history: dict[str, list[tuple[float, Pose2D]]] = defaultdict(list)

    def add(self, parent: str, child: str, stamp: float, matrix: FloatArray, *, static: bool) -> None:
        """Take one published transform."""
        parent, child = clean_frame(parent), clean_frame(child)
        self._parents[child] = parent
        self._latest[child] = matrix
        if not static:
            self._history[child].append((stamp, planar(matrix)))

    def moving_child(self, parent: str) -> str | None:
        """The frame that moves in ``parent``, e.g. the robot's base in ``odom``; None if there is none."""
        children = [
            child
            for child, its_parent in self._parents.items()
            if its_parent == clean_frame(parent) and len(self._history[child]) > 1
        ]
        return max(children, key=lambda child: len(self._history[child]), default=None)

    def moving_parents(self) -> list[str]:
        """Frames in which another frame moves."""
        return sorted({self._parents[child] for child, history in self._history.items() if len(history) > 1})

    def motion(self, child: str) -> Trajectory:
        """Planar poses of ``child`` in its parent, in the order of time."""
        history = sorted(self._history[clean_frame(child)], key=lambda entry: entry[0])
        stamps = np.array([stamp for stamp, _ in history], dtype=np.float64)
        poses = np.array([pose for _, pose in history], dtype=np.float64).reshape(-1, 3)
        return Trajectory(stamps, poses)

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
        chain = {frame: np.eye(4)}
        matrix = np.eye(4)
        for _ in range(MAX_DEPTH):
            if frame not in self._parents:
                break
            matrix = self._latest[frame] @ matrix
            frame = self._parents[frame]
            if frame in chain:
                break
            chain[frame] = matrix
        return chain
