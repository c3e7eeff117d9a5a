"""Uniform images: nothing that matters gets lost, whatever the scale."""

import cv2
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from shapely import box
from shapely.affinity import scale

from slamgym.cad import FloorPlan
from slamgym.core.errors import ConfigError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, OccupancyGrid
from slamgym.dataset.images.square_images import (
    DoesNotFitError,
    ImageConfig,
    draw_pair,
    draw_plan_image,
    mapped_bounds,
    resample_map,
    square_frame,
)
from slamgym.metrics.dimensions import floor_runs

PLAN = FloorPlan("two rooms", box(0, 0, 8, 5).difference(box(3.95, 0, 4.05, 3.8)))


def map_of(plan, start=(1.0, 1.0), resolution=0.05):
    """A perfect map: floor, its outermost cells occupied, unknown around."""
    min_x, min_y, max_x, max_y = plan.bounds
    moved = (min_x - start[0], min_y - start[1], max_x - start[0], max_y - start[1])
    frame = GridFrame.covering(moved, resolution, margin=1.0)
    cells = plan.raster(
        resolution, frame=frame, offset=start, outside=UNKNOWN, wall_thickness=resolution
    )
    return OccupancyGrid(cells.cells, frame)


def components(mask):
    return cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)[0] - 1


@settings(max_examples=60)
@given(
    seed=st.integers(0, 999),
    ratio=st.floats(0.3, 4.0),
    shift=st.tuples(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2)),
)
@example(seed=0, ratio=1.5, shift=(0.0, 0.0))
def test_no_occupied_cell_gets_lost_and_no_wall_breaks(seed, ratio, shift):
    rng = np.random.default_rng(seed)
    cells = np.full((40, 50), UNKNOWN, np.uint8)
    cells[rng.random(cells.shape) < 0.5] = FREE
    corners = rng.integers(2, 38, (4, 2))
    cv2.polylines(
        cells, [corners.reshape(-1, 1, 2).astype(np.int32)], isClosed=False, color=OCCUPIED
    )
    grid = OccupancyGrid(cells, GridFrame(0.05, -1.0, -1.0, 40, 50))
    size = int(np.ceil(60 / ratio)) + 2
    frame = GridFrame(0.05 * ratio, -1.3 + shift[0], -1.3 + shift[1], size, size)
    drawn = resample_map(grid, frame)
    assert set(np.unique(drawn)) <= {OCCUPIED, UNKNOWN, FREE}
    x, y = grid.frame.to_point(*np.nonzero(cells == OCCUPIED))
    if ratio >= 1.0:
        # A centre on the border of pixels is drawn in one of them.
        shown = [
            drawn[frame.to_cell(x + dx, y + dy)] for dx in (-1e-6, 1e-6) for dy in (-1e-6, 1e-6)
        ]
        assert (np.array(shown) == OCCUPIED).any(axis=0).all()
        assert (drawn == OCCUPIED).sum() <= (cells == OCCUPIED).sum()
    else:  # the pixel whose centre is nearest to the cell's lies within the cell
        row, col = frame.to_cell(x, y)
        assert all(
            (drawn[r - 1 : r + 2, c - 1 : c + 2] == OCCUPIED).any()
            for r, c in zip(row, col, strict=True)
        )
    assert components(drawn == OCCUPIED) == components(cells == OCCUPIED) == 1


def test_the_same_lattice_copies_the_map():
    grid = map_of(PLAN)
    assert (resample_map(grid, grid.frame) == grid.cells).all()


def test_shares_of_unknown_and_free_decide():
    cells = np.array([[FREE, FREE], [FREE, UNKNOWN]], np.uint8)
    grid = OccupancyGrid(cells, GridFrame(0.05, 0.0, 0.0, 2, 2))
    assert resample_map(grid, GridFrame(0.1, 0.0, 0.0, 1, 1))[0, 0] == FREE
    grid.cells[0] = UNKNOWN
    assert resample_map(grid, GridFrame(0.1, 0.0, 0.0, 1, 1))[0, 0] == UNKNOWN
    # What lies beyond the map is unknown.
    assert (resample_map(grid, GridFrame(0.1, 5.0, 5.0, 3, 3)) == UNKNOWN).all()


@pytest.mark.parametrize("size", [64, 128, 256, 333])
def test_both_sides_show_the_same_place(size):
    """On a perfect map the floor of both agrees but for the walls' own width."""
    cad, slam, frame = draw_pair(PLAN, (1.0, 1.0), map_of(PLAN), ImageConfig(size=size))
    assert cad.shape == slam.shape == (size, size) == frame.shape
    lined = draw_pair(PLAN, (1.0, 1.0), map_of(PLAN), ImageConfig(size=size, edge_px=1.0))[0]
    assert set(np.unique(lined)) == {OCCUPIED, FREE}
    assert set(np.unique(slam)) == {OCCUPIED, UNKNOWN, FREE}
    inside = cv2.erode((cad == FREE).astype(np.uint8), np.ones((5, 5))) > 0
    assert (slam[inside] == FREE).all()
    outside = cv2.dilate((cad == FREE).astype(np.uint8), np.ones((9, 9))) == 0
    assert (slam[outside] != FREE).all()
    # The long side fills the image but for the margin: 8 m of floor and a cell of wall on either side.
    assert frame.resolution * (size - 8) == pytest.approx(8.0 + 0.3, abs=0.15)


@pytest.mark.parametrize("metres_per_px", [0.03, 0.1, 0.2])
def test_a_thin_wall_is_never_lost(metres_per_px):
    """The wall between the rooms is 0.1 m thick; up to the door it parts them in every column of pixels."""
    size = int(12 / metres_per_px)
    frame = GridFrame(metres_per_px, -1.97, -2.01, size, size)
    cad = draw_plan_image(PLAN.segments(), frame, edge_px=1.0)
    row, col = frame.to_cell([2.0, 6.0], [1.5, 1.5])
    wall = cad[row[0], col[0] : col[1]] == OCCUPIED
    assert 1 <= wall.sum() <= 0.1 / metres_per_px + 2.0


def test_edges_get_the_thickness_that_is_asked_for():
    frame = GridFrame(0.05, -1.0, -1.0, 200, 200)
    widths = {}
    for edge in (0.0, 1.0, 3.0, 5.0):
        cad = draw_plan_image(PLAN.segments(), frame, edge_px=edge)
        row, col = frame.to_cell([3.0, 5.0], [1.0, 1.0])
        widths[edge] = float((1.0 - cad[row[0], col[0] : col[1]] / FREE).sum())
    assert widths[0.0] == pytest.approx(2.0, abs=0.05)  # 0.1 m
    for edge in (1.0, 3.0, 5.0):
        assert abs(widths[edge] - (2 + edge)) <= 1.0


@pytest.mark.parametrize("shift", [0.0, 0.013, 0.031])
@pytest.mark.parametrize("thickness", [0.02, 0.06, 0.12])
def test_shares_put_faces_where_the_plan_has_them_and_keep_thin_walls(thickness, shift):
    west = box(0, 0, 3 + shift, 4)
    east = box(3 + shift + thickness, 0, 6, 4)
    door = box(2.9, 1, 3.3, 2)
    plan = FloorPlan("p", west.union(east).union(door))
    cad = draw_plan_image(plan.segments(), GridFrame(0.05, -1.0, -1.0, 120, 160), edge_px=0.0)
    row = cad[40] / FREE  # 3 m up, beside the door
    assert cad.dtype == np.uint8
    runs = floor_runs(row.astype(np.float32))
    assert len(runs) == 2  # the wall is closed
    if thickness > 0.05:
        assert [run.length * 0.05 for run in runs] == pytest.approx(
            [3 + shift, 3 - shift - thickness], abs=0.016
        )
    assert len(floor_runs((cad[65] / FREE).astype(np.float32))) == 1  # the door isn't


def test_pairs_at_the_maps_own_resolution_keep_its_cells():
    grid = GridFrame(0.05, -1.23, 0.77, 100, 120)
    cells = np.random.default_rng(0).choice([OCCUPIED, UNKNOWN, FREE], grid.shape).astype(np.uint8)
    _, slam, frame = draw_pair(
        PLAN,
        (0.0, 0.0),
        OccupancyGrid(cells, grid),
        ImageConfig(size=320, scaling="fixed", metres_per_px=0.05),
    )
    left = round((grid.origin_x - frame.origin_x) / 0.05)
    top = round((frame.bounds[3] - grid.bounds[3]) / 0.05)
    assert (slam[top : top + cells.shape[0], left : left + cells.shape[1]] == cells).all()


def test_thickness_does_not_depend_on_the_scale_of_the_pair():
    """A plan of twice the size has its outer edges at the same place of the image."""
    images = [
        draw_plan_image(
            FloorPlan("p", scale(box(0, 0, 8, 5), f, f, origin=(0, 0))).segments(),
            frame,
            edge_px=4.0,
        )
        for f, frame in (
            (1.0, GridFrame(0.05, -1, -1, 200, 200)),
            (2.0, GridFrame(0.1, -2, -2, 200, 200)),
        )
    ]
    assert (images[0] == images[1]).all()


def test_stray_beams_do_not_make_the_image_larger():
    grid = map_of(PLAN)
    clean = mapped_bounds(grid)
    cells = np.pad(grid.cells, 60, constant_values=UNKNOWN)
    frame = grid.frame
    wide = GridFrame(0.05, frame.origin_x - 3.0, frame.origin_y - 3.0, *cells.shape)
    cells[80, :40] = FREE  # a spike, one cell wide
    cells[10, 10] = OCCUPIED
    assert mapped_bounds(OccupancyGrid(cells, wide)) == pytest.approx(clean)
    assert (
        mapped_bounds(
            OccupancyGrid(np.full((9, 9), UNKNOWN, np.uint8), GridFrame(0.05, 0, 0, 9, 9))
        )
        is None
    )


def test_a_fixed_scale_is_kept_or_refused():
    config = ImageConfig(size=128, scaling="fixed", metres_per_px=0.1)
    _, _, frame = draw_pair(PLAN, (1.0, 1.0), map_of(PLAN), config)
    assert frame.resolution == 0.1
    with pytest.raises(DoesNotFitError, match="long but the image shows"):
        square_frame((0, 0, 12.1, 3), config)
    assert square_frame((0, 0, 12.0, 3), config).bounds == pytest.approx((-0.4, -4.9, 12.4, 7.9))


@pytest.mark.parametrize(
    "values",
    [
        {"size": 3},
        {"scaling": "best"},
        {"metres_per_px": 0.0},
        {"margin_px": 128},
        {"edge_px": -1.0},
    ],
)
def test_senseless_settings_are_refused(values):
    with pytest.raises(ConfigError, match=next(iter(values))):
        ImageConfig(**values)
