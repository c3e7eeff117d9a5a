"""What the scans show of a plan, still in its true place: the picture that the field then warps."""

import numpy as np

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, BoolArray, ByteArray
from slamgym.parametric.lidar_error import HIT, NO_BEAM, WallBeams
from slamgym.parametric.visibility import Visibility


def observed_cad(occupied: BoolArray, visibility: Visibility, beams: WallBeams) -> ByteArray:
    """What the scans show of the CAD map, still in its true place: the picture that is then warped.

    Walls whose beam was short, max or rand are lost; a rand beam may set a cell elsewhere.

    Returns:
        (H, W) on true cells: 0 occupied, 205 unknown, 254 free.
    """
    seen = visibility.seen
    true = np.full(occupied.shape, UNKNOWN, dtype=np.uint8)
    true[seen & ~occupied] = FREE
    true[seen & occupied] = OCCUPIED
    lost = (beams.component != NO_BEAM) & (beams.component != HIT)
    true[lost] = UNKNOWN
    rows, cols = visibility.frame.to_cell(beams.stray_points[:, 0], beams.stray_points[:, 1])
    true[rows, cols] = OCCUPIED
    return true
