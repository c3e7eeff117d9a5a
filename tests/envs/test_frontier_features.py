import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.core.types import GridFrame
from slamgym.planning.frontier_feature_kernels import coarse_cells, wall_distances


@settings(max_examples=25)
@given(seed=st.integers(0, 10_000), count=st.integers(0, 40))
def test_coarse_cells_hold_each_cell_once_and_stay_on_the_map(seed, count):
    shape = (7, 9)
    cells = np.random.default_rng(seed).integers(0, (16, 20), (count, 2)).astype(np.int32)
    expected = np.unique(np.minimum(cells // 2, np.array(shape) - 1), axis=0).reshape(-1, 2)
    assert (coarse_cells(cells, 2, shape) == expected).all()


@settings(max_examples=25)
@given(seed=st.integers(0, 10_000), count=st.integers(0, 20))
def test_wall_distances_are_read_at_the_cells_and_beyond_the_map_at_its_edge(seed, count):
    rng = np.random.default_rng(seed)
    frame = GridFrame(0.05, -0.3, 0.2, 12, 17)
    distance = rng.uniform(0.0, 90.0, frame.shape).astype(np.float32)
    points = rng.uniform(-0.6, 1.2, (count, 2))
    row, col = frame.to_cell(points[:, 0], points[:, 1])
    there = distance[np.clip(row, 0, frame.height_px - 1), np.clip(col, 0, frame.width_px - 1)]
    expected = np.minimum(there * np.float32(frame.resolution), np.float32(3.0))
    found = wall_distances(distance, points, frame.origin_x, frame.origin_y, frame.resolution, 3.0)
    assert (found == expected).all()
