"""Wavefront frontier detection against a scan of the whole map.

    python benchmarks/frontier_detectors.py

``wavefront_frontiers`` (Keidar and Kaminka 2012) looks only at the free space that the robot can get to; the
full scan looks at every cell of the map: unknown cells with a free neighbour, grouped, as image processing
does it (Yamauchi 1997). Buildings as in ``benchmarks/planning.py``, known in their left half, on a canvas of
64 m.
"""

import cv2
import numpy as np
from planning import half_explored, milliseconds
from report import print_and_save

from slamgym.core.types import FREE, UNKNOWN, OccupancyGrid
from slamgym.planning import crop_known, wavefront_frontiers

_CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], np.uint8)


def full_scan(grid: OccupancyGrid, min_cells: int) -> list[np.ndarray]:
    """Frontiers as arrays of cells (N, 2), by image operations over the whole map."""
    free = (grid.cells == FREE).view(np.uint8)
    frontier = cv2.dilate(free, _CROSS) & (grid.cells == UNKNOWN).view(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(frontier, connectivity=8)
    cells = np.argwhere(frontier)
    of_cell = labels[cells[:, 0], cells[:, 1]]
    return [cells[of_cell == k] for k in range(1, count) if stats[k, cv2.CC_STAT_AREA] >= min_cells]


def main() -> None:
    rows = []
    for rooms in (2, 4, 6, 8):
        grid, pose = half_explored(rooms)
        cropped = crop_known(grid, pose)
        found = {tuple(c) for f in wavefront_frontiers(cropped, pose) for c in f.cells.tolist()}
        scanned = {tuple(c) for cells in full_scan(cropped, 1) for c in cells.tolist()}
        # What the scan finds more can't be reached, so nobody can explore it.
        assert found <= scanned
        rows.append(
            {
                "area [m2]": (4.0 * rooms) ** 2,
                "wavefront, cropped [ms]": milliseconds(lambda g=cropped, p=pose: wavefront_frontiers(g, p)),
                "full scan, cropped [ms]": milliseconds(lambda g=cropped: full_scan(g, 1)),
                "wavefront, canvas [ms]": milliseconds(lambda g=grid, p=pose: wavefront_frontiers(g, p)),
                "full scan, canvas [ms]": milliseconds(lambda g=grid: full_scan(g, 1)),
            }
        )
    print_and_save(
        "frontier_detectors",
        "Frontier detection, CPU time of a search; half of the area is known",
        rows,
        list(rows[0]),
    )


if __name__ == "__main__":
    main()
