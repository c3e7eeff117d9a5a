"""A map that lies askew is drawn upright, and every file says how it was turned."""

import json
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
import shapely
from drawing.painted import FLAT, painted

from slamgym.drawing import make_drawing, write_drawing
from slamgym.drawing.formats.png import draw_picture
from slamgym.drawing.formats.upright import turned_shape, upright
from slamgym.viz.canvas import WALL_TINT

ASKEW = 35.0
"""As the map of a robot that was started askew lay [deg]."""


SAID = r"x of the map = (\S+) m .* y of the map = (\S+) m .* turned by (\S+) degrees"


@pytest.fixture(scope="module")
def drawing():
    grid, _, model = painted(FLAT, turn_deg=ASKEW)
    return make_drawing(grid, "flat", model)


def off_axes(points):
    """How far long edges of polygons point away from the axes, at most [deg]."""
    edges = np.diff(points, axis=0)
    edges = edges[np.hypot(*edges.T) > 0.02 * np.ptp(points)]
    angles = np.degrees(np.arctan2(edges[:, 1], edges[:, 0]))
    return np.abs((angles + 45.0) % 90.0 - 45.0).max()


def test_walls_and_cells_of_a_picture_lie_along_its_sides(drawing):
    assert abs(drawing.angle_deg - ASKEW) < 1.0
    picture = draw_picture(drawing, 600)
    dark = (picture == WALL_TINT).all(axis=-1)
    # An outer wall fills a third of some row: at 35 degrees it would cross a row in a dozen pixels.
    assert dark.sum(axis=1).max() > 0.3 * dark.shape[1]
    # The map's echoes are those of walls: turned the wrong way, many would lie on the white floor.
    echo_on_floor = (np.abs(picture.astype(int) - (242, 163, 121)) <= 2).all(axis=-1)
    assert echo_on_floor.sum() < 0.1 * dark.sum()


def test_turning_keeps_sizes_and_can_be_taken_back(drawing):
    shown = upright(drawing)
    assert shown.area == pytest.approx(drawing.area, rel=1e-9)
    assert [door.width for door in shown.doors] == pytest.approx([d.width for d in drawing.doors])
    back = turned_shape(shown.floor, drawing.angle_deg)
    assert shapely.hausdorff_distance(back, drawing.floor) < 1e-9
    assert off_axes(shapely.get_coordinates(shown.floor)) < 1.5
    assert upright(shown) is shown


def test_the_svg_is_upright_and_names_the_way_back(drawing, tmp_path):
    (path,) = write_drawing(drawing, tmp_path / "flat", ["svg"])
    root = ET.fromstring(path.read_text())
    name = "{http://www.w3.org/2000/svg}"
    note = root.find(f"{name}desc").text
    left, top, angle = map(float, re.search(SAID, note).groups())
    (layer,) = [group for group in root.iter(f"{name}g") if group.get("id") == "DOORS"]
    numbers = np.array(re.findall(r"-?[\d.]+", layer[0].get("d")), dtype=float).reshape(-1, 2)
    sheet = shapely.LineString(np.array([left, top]) + numbers * [1e-3, -1e-3])
    assert shapely.hausdorff_distance(turned_shape(sheet, angle), drawing.doors[0].line) < 1e-3


def test_json_geojson_and_dxf_keep_the_frame_of_the_map_and_say_how_it_is_turned(drawing, tmp_path):
    ezdxf = pytest.importorskip("ezdxf")
    paths = write_drawing(drawing, tmp_path / "flat", ["json", "geojson", "dxf"])
    facts = json.loads(paths[0].read_text())["drawing"]
    collection = json.loads(paths[1].read_text())
    assert facts["upright"] == collection["upright"]
    assert facts["upright"]["turn_deg"] == pytest.approx(-drawing.angle_deg, abs=1e-3)
    wall = shapely.Polygon(facts["walls"][0]["polygon"][0])
    assert off_axes(shapely.get_coordinates(turned_shape(wall, facts["upright"]["turn_deg"]))) < 1.5
    document = ezdxf.readfile(paths[2])
    x, y, _ = document.ucs.get("UPRIGHT").dxf.xaxis
    assert np.degrees(np.arctan2(y, x)) == pytest.approx(drawing.angle_deg)
    (view,) = document.viewports.get("*Active")
    assert view.dxf.view_twist == pytest.approx(-drawing.angle_deg)
