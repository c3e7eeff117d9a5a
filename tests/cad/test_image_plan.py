import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from slamgym.cad import generate_plan, read_image_plan, read_ros_plan, trace_plan
from slamgym.core.errors import InputFileError, PlanError
from slamgym.core.types import FREE, GridFrame
from slamgym.interop.ros_map import write_ros_map


@given(
    cells=arrays(np.bool_, st.tuples(st.integers(1, 14), st.integers(1, 14))),
    resolution=st.sampled_from([0.05, 0.5, 1.0]),
    origin=st.tuples(st.integers(-40, 40), st.integers(-40, 40)),
)
def test_tracing_and_drawing_gives_the_largest_patch_back(cells, resolution, origin):
    frame = GridFrame(resolution, origin[0] * resolution, origin[1] * resolution, *cells.shape)
    try:
        plan = trace_plan(cells, frame, "p", "p.png")
    except PlanError:
        return
    drawn = plan.raster(resolution, frame).cells == FREE
    count, labels = cv2.connectedComponents(cells.astype(np.uint8), connectivity=4)
    sizes = [int((labels == label).sum()) for label in range(1, count)]
    assert drawn.sum() == max(sizes)
    assert not (drawn & ~cells).any()
    assert plan.free_space.is_valid


def test_a_generated_plan_survives_a_ros_map(tmp_path):
    plan = generate_plan(4)
    grid = plan.raster(0.05)
    read = read_ros_plan(write_ros_map(tmp_path, grid))
    # Every face of a wall moves by at most half a cell, and smoothing by less than one more.
    assert (
        plan.free_space.symmetric_difference(read.free_space).area < plan.free_space.length * 0.05
    )
    exact = read_ros_plan(tmp_path / "map.yaml", smoothing=0.0)
    np.testing.assert_array_equal(exact.raster(0.05, grid.frame).cells, grid.cells)
    assert len(read.segments()) <= len(exact.segments())


def test_smoothing_straightens_staircases():
    rows, cols = np.mgrid[0:80, 0:80]
    frame = GridFrame(0.05, 0.0, 0.0, 80, 80)
    inside = rows > cols
    assert len(trace_plan(inside, frame, "p", "p").segments()) > 100
    smooth = trace_plan(inside, frame, "p", "p", smoothing=0.75)
    assert len(smooth.segments()) <= 5
    assert smooth.area == pytest.approx(8.0, rel=0.05)


def picture(tmp_path, image):
    path = tmp_path / "plan.png"
    cv2.imwrite(str(path), image)
    return path


def test_white_round_the_building_is_not_floor(tmp_path):
    page = np.full((100, 120), 255, np.uint8)
    page[20:80, 20:100] = 0
    page[22:78, 22:98] = 255
    plan = read_image_plan(picture(tmp_path, page), 0.1)
    assert plan.bounds == pytest.approx((2.2, 2.2, 9.8, 7.8))


def test_an_outer_door_that_stands_open_is_shut(tmp_path):
    page = np.full((140, 160), 255, np.uint8)
    page[20:120, 20:140] = 0
    page[22:118, 22:138] = 255
    page[118:120, 60:70] = 255  # a door of 1 m
    plan = read_image_plan(picture(tmp_path, page), 0.1)
    assert plan.area == pytest.approx(11.6 * 9.6, abs=0.3)
    page[118:120, 60:90] = 255  # 3 m are no door: the floor can't be told from the ground outside
    assert read_image_plan(picture(tmp_path, page), 0.1).area > 180.0


def test_floor_that_reaches_the_edge_counts_all_white(tmp_path):
    room = np.full((60, 60), 255, np.uint8)
    room[:, 30] = 0
    room[20:30, 30] = 255
    assert read_image_plan(picture(tmp_path, room), 0.1).area == pytest.approx(36.0 - 0.5)


def test_grey_is_not_floor(tmp_path):
    page = np.full((60, 60), 205, np.uint8)
    page[10:50, 10:30] = 254
    assert read_image_plan(picture(tmp_path, page), 0.1).area == pytest.approx(8.0)


def test_pillars_become_holes(tmp_path):
    page = np.zeros((60, 60), np.uint8)
    page[5:55, 5:55] = 255
    page[20:25, 20:25] = 0
    plan = read_image_plan(picture(tmp_path, page), 0.1)
    assert len(plan.free_space.interiors) == 1
    assert plan.area == pytest.approx(25.0 - 0.25)


def test_pictures_without_a_plan_are_refused(tmp_path):
    two = np.zeros((60, 60), np.uint8)
    two[5:55, 5:25] = two[5:55, 35:55] = 255
    with pytest.raises(PlanError, match=r"plan\.png: the free space falls into 2 disjoint parts"):
        read_image_plan(picture(tmp_path, two), 0.1)
    with pytest.raises(PlanError, match="no free patch"):
        read_image_plan(picture(tmp_path, np.zeros((9, 9), np.uint8)), 0.1)
    with pytest.raises(PlanError, match="resolution must be above 0"):
        read_image_plan(picture(tmp_path, two), 0.0)
    (tmp_path / "text.png").write_text("no picture")
    (tmp_path / "empty.png").write_bytes(b"")
    for name in ("text.png", "empty.png"):
        with pytest.raises(PlanError, match="not a picture"):
            read_image_plan(tmp_path / name, 0.1)
    with pytest.raises(PlanError, match="can't be read"):
        read_image_plan(tmp_path / "gone.png", 0.1)
    with pytest.raises(InputFileError, match=r"gone\.yaml"):
        read_ros_plan(tmp_path / "gone.yaml")
