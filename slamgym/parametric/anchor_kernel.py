"""Kernel: dead reckoning that is pulled towards the map drawn so far."""

import math

from slamgym.jit import kernel
from slamgym.parametric.visibility_kernel import Int32Array
from slamgym.types import BoolArray, FloatArray


@kernel
def anchor_poses(
    true_poses: FloatArray,
    motions: FloatArray,
    hits: Int32Array,
    points: FloatArray,
    gain: FloatArray,
    placed: FloatArray,
    is_placed: BoolArray,
    poses: FloatArray,
) -> None:
    """Integrate ``motions`` and correct every pose by a share of the best rigid fit to known walls.

    The fit is the closed-form least-squares motion between where the predicted pose would draw the wall
    cells of its scan and where earlier scans drew them. It counts as far as the scan lies on known walls.

    Args:
        true_poses: (T, 3) world frame.
        motions: (T - 1, 3) believed distance [m], lateral [m], turn [rad].
        hits: (T, B) flat index of the wall cell that each beam met, -1 for none.
        points: (H * W, 2) true centres of the cells [m]; read only where a beam hit.
        gain: (T,) share [0-1] of the correction that is applied.
        placed: (H * W, 2) out, where the first scan that saw the cell drew it [m].
        is_placed: (H * W,) in and out, False everywhere before.
        poses: (T, 3) out, believed poses, heading not wrapped.
    """
    poses[0] = true_poses[0]
    for k in range(true_poses.shape[0]):
        if k > 0:
            turn = motions[k - 1, 2]
            middle = poses[k - 1, 2] + 0.5 * turn
            cos, sin = math.cos(middle), math.sin(middle)
            poses[k, 0] = poses[k - 1, 0] + cos * motions[k - 1, 0] - sin * motions[k - 1, 1]
            poses[k, 1] = poses[k - 1, 1] + sin * motions[k - 1, 0] + cos * motions[k - 1, 1]
            poses[k, 2] = poses[k - 1, 2] + turn
        cos = math.cos(poses[k, 2] - true_poses[k, 2])
        sin = math.sin(poses[k, 2] - true_poses[k, 2])
        known, met = 0, 0
        # Sums over known walls: a where this pose would draw them, q where they stand, both from the robot.
        ax, ay, qx, qy, dot, cross = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for b in range(hits.shape[1]):
            cell = hits[k, b]
            if cell < 0:
                continue
            met += 1
            if is_placed[cell]:
                known += 1
                px, py = points[cell, 0] - true_poses[k, 0], points[cell, 1] - true_poses[k, 1]
                x, y = cos * px - sin * py, sin * px + cos * py
                u, v = placed[cell, 0] - poses[k, 0], placed[cell, 1] - poses[k, 1]
                ax, ay, qx, qy = ax + x, ay + y, qx + u, qy + v
                dot += x * u + y * v
                cross += x * v - y * u
        if known > 2 and gain[k] > 0.0:
            share = gain[k] * known / met
            ax, ay, qx, qy = ax / known, ay / known, qx / known, qy / known
            rotation = share * math.atan2(
                cross - known * (ax * qy - ay * qx), dot - known * (ax * qx + ay * qy)
            )
            cos, sin = math.cos(rotation), math.sin(rotation)
            # Turn about the centroid of the known walls, then close a share of the gap.
            poses[k, 0] += ax - (cos * ax - sin * ay) + share * (qx - ax)
            poses[k, 1] += ay - (sin * ax + cos * ay) + share * (qy - ay)
            poses[k, 2] += rotation
        cos = math.cos(poses[k, 2] - true_poses[k, 2])
        sin = math.sin(poses[k, 2] - true_poses[k, 2])
        for b in range(hits.shape[1]):
            cell = hits[k, b]
            if cell >= 0 and not is_placed[cell]:
                is_placed[cell] = True
                px, py = points[cell, 0] - true_poses[k, 0], points[cell, 1] - true_poses[k, 1]
                placed[cell, 0] = poses[k, 0] + cos * px - sin * py
                placed[cell, 1] = poses[k, 1] + sin * px + cos * py
