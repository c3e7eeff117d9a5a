"""Two-phase empirical method: odometry errors of straight lines and turns, carried over to the map.

After Souza, Santana, Britto, Goncalves and Medeiros, *Representation of Odometry Errors on Occupancy Grids*
(ICINCO 2008). The robot's believed path is integrated from increments with empirical errors; each cell is
placed as the scan that saw it would have placed it. Nothing corrects that path: it is dead reckoning.
"""

from dataclasses import dataclass

import numpy as np

from slamgym.core.types import Float32Array, FloatArray, GridFrame
from slamgym.parametric.config import TwoPhaseConfig
from slamgym.parametric.odometry_error import Increments
from slamgym.parametric.visibility import Visibility


@dataclass(frozen=True)
class PhaseErrors:
    """Systematic coefficients of one robot, drawn once."""

    k_l: float = 0.0  # [-]
    k_lt: float = 0.0  # [rad/m]
    k_t: float = 0.0  # [-]

    @classmethod
    def of_unit(cls, config: TwoPhaseConfig, unit: FloatArray) -> "PhaseErrors":
        """The robot that :meth:`WheelErrors.of_unit` makes of the same draws (3,), to first order.

        A line bends by k_lt = (E_d - 1) / b, a turn errs by k_t = 1 / E_b - 1: a wider base turns less.
        """
        return cls(
            k_l=config.k_l * float(unit[2]),
            k_lt=config.k_lt * float(unit[0]),
            k_t=-config.k_t * float(unit[1]),
        )


def disturb(
    true: Increments, errors: PhaseErrors, config: TwoPhaseConfig, rng: np.random.Generator
) -> Increments:
    """Believed increments: E_lin added to every distance, E_ang to every turn.

    Args:
        true: The motion.
        errors: Systematic coefficients.
        config: Random coefficients.
        rng: Source of the random part.
    """
    noise = rng.standard_normal((2, len(true.turn)))
    driven, turned = np.abs(true.distance), np.abs(true.turn)
    linear = errors.k_l * true.distance + config.s_l * np.sqrt(driven) * noise[0]
    angular = (
        errors.k_t * true.turn
        + errors.k_lt * true.distance
        + (config.s_t * np.sqrt(turned) + config.s_lt * np.sqrt(driven)) * noise[1]
    )
    return Increments(true.distance + linear, true.lateral, true.turn + angular)


def rigid_motions(true_poses: FloatArray, believed_poses: FloatArray, centre: FloatArray) -> FloatArray:
    """How each scan displaces what it draws: p' = that + R(thetahat - theta)(p - t), as four numbers.

    Args:
        true_poses: (T, 3).
        believed_poses: (T, 3).
        centre: (2,) point that the numbers refer to [m]; near the map keeps them small.

    Returns:
        (T, 4): cos - 1, sin, and the displacement (x, y) of ``centre`` [m].
    """
    turn = believed_poses[:, 2] - true_poses[:, 2]
    cos, sin = np.cos(turn), np.sin(turn)
    x, y = centre[0] - true_poses[:, 0], centre[1] - true_poses[:, 1]
    return np.column_stack(
        [
            cos - 1.0,
            sin,
            believed_poses[:, 0] + cos * x - sin * y - centre[0],
            believed_poses[:, 1] + sin * x + cos * y - centre[1],
        ]
    )


def placement_field(
    true_poses: FloatArray,
    believed_poses: FloatArray,
    visibility: Visibility,
) -> Float32Array:
    """The proprioceptive field d_O over every seen cell, placed by the first scan that saw it, like a landmark.

    Convention: world frame, component 0 = x, 1 = y, true minus measured [m]; lies on *true* cells.

    Args:
        true_poses: (T, 3).
        believed_poses: (T, 3).
        visibility: Who saw what.

    Returns:
        (2, H, W) float32, 0 in cells that no scan saw.
    """
    frame, seen = visibility.frame, visibility.seen
    centre = frame_centre(frame)
    motion = rigid_motions(true_poses, believed_poses, centre)[visibility.cells.first[seen]]
    rows, cols = np.nonzero(seen)
    x, y = frame.to_point(rows, cols)
    x, y = x - centre[0], y - centre[1]
    field = np.zeros((2, *frame.shape), dtype=np.float32)
    field[0, seen] = -(motion[:, 0] * x - motion[:, 1] * y + motion[:, 2])
    field[1, seen] = -(motion[:, 1] * x + motion[:, 0] * y + motion[:, 3])
    return field


def frame_centre(frame: GridFrame) -> FloatArray:
    """The middle of a grid, shape (2,) [m]."""
    min_x, min_y, max_x, max_y = frame.bounds
    return np.array([0.5 * (min_x + max_x), 0.5 * (min_y + max_y)])
