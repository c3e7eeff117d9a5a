import cv2
import numpy as np
import pytest

from slamgym.core.types import GridFrame
from slamgym.metrics.map_error import wall_faces
from slamgym.metrics.maps import distance_to
from slamgym.viz.canvas import write_picture
from slamgym.viz.sheets import (
    ERROR_SCALE,
    Card,
    SheetEntry,
    draw_contact_sheet,
    draw_sheet,
    draw_wall_errors,
    error_colour,
)


def entry(slam_shift_px=0):
    """A room of 5 x 4 m whose SLAM map has its right wall moved by some cells."""
    cad = np.zeros((120, 140), np.uint8)
    cad[20:100, 20:120] = 254
    slam = np.full_like(cad, 205)
    slam[20:100, 20 : 120 + slam_shift_px] = 254
    slam[20:100, 120 + slam_shift_px] = 0
    path = np.array([[2.0, 2.0], [3.0, 2.0], [3.0, 3.0]])
    return SheetEntry("room", "details", cad, slam, GridFrame(0.05, 0.0, 0.0, 120, 140), path)


def wall_errors(pair):
    return draw_wall_errors(pair.cad, pair.slam, pair.frame, pair.path)


def test_wall_faces_are_the_wall_cells_beside_free_space():
    faces = wall_faces(entry().cad == 254)
    assert faces.sum() == 2 * (100 + 80) + 4
    assert not (faces & (entry().cad == 254)).any()


def test_distance_is_zero_on_the_cells_and_euclidean_elsewhere():
    cells = np.zeros((9, 9), bool)
    cells[4, 4] = True
    distance = distance_to(cells)
    assert distance[4, 4] == 0
    assert distance[0, 1] == pytest.approx(5.0, abs=1e-5)


def test_error_colours_go_from_green_to_red_and_stop_there():
    right, wrong, far = error_colour(np.array([0.0, ERROR_SCALE, 10.0]))
    assert right[1] > right[0]
    assert wrong[0] > wrong[1]
    assert (wrong == far).all()


def test_a_wall_in_its_place_is_green_and_a_moved_one_red():
    column = 2 * 120 + 1
    good = wall_errors(entry(0))[120, column]
    bad = wall_errors(entry(8))[120, column + 16]
    assert (good == error_colour(np.zeros(1))[0]).all()
    assert (bad == error_colour(np.full(1, 8 * 0.05))[0]).all()


def test_a_sheet_holds_every_entry():
    one, five = draw_contact_sheet("one", [entry()]), draw_contact_sheet("five", [entry()] * 5)
    assert one.dtype == np.uint8
    assert one.ndim == 3
    assert five.shape[1] > one.shape[1]  # two cards beside each other
    card = cv2.countNonZero(255 - one.min(axis=2))
    assert cv2.countNonZero(255 - five.min(axis=2)) > 4.5 * card


def test_panels_of_any_size_and_shape_fill_equal_squares():
    wide, small = np.full((10, 40), 80, np.uint8), np.full((8, 8, 3), (10, 20, 30), np.uint8)
    sheet = draw_sheet([Card([wide, small], ["caption"])], columns=3, panel_px=64)
    assert (sheet == 80).all(axis=2).sum() == (sheet == (10, 20, 30)).all(axis=2).sum() == 64 * 64


def test_captions_that_are_too_long_shrink():
    short, long = (draw_sheet([Card([entry().cad], ["x" * n])], 1, 128) for n in (4, 20))
    ink = [np.flatnonzero((sheet[-24:] < 128).any(axis=(0, 2))) for sheet in (short, long)]
    assert ink[0].max() < ink[1].max() < short.shape[1] - 4


@pytest.mark.parametrize("name", ["picture.png", "picture.JPG", "picture"])
def test_a_picture_is_written_in_rgb_by_its_name(tmp_path, name):
    write_picture(tmp_path / name, np.full((16, 16, 3), (200, 100, 10), np.uint8))
    content = (tmp_path / name).read_bytes()
    assert content.startswith(b"\xff\xd8" if name.endswith("JPG") else b"\x89PNG")
    read = (
        cv2.imread(str(tmp_path / name))
        if "." in name
        else cv2.imdecode(np.frombuffer(content, np.uint8), 1)
    )
    assert np.abs(read[8, 8].astype(int) - (10, 100, 200)).max() < 4
