"""Every format holds what was drawn, to scale, and can be read again."""

import json
import xml.etree.ElementTree as ET

import numpy as np
import pytest
import shapely
from drawing.painted import FLAT, painted

from slamgym.cad import check_plan, open_plans, read_houseexpo
from slamgym.core.errors import SlamgymError
from slamgym.drawing import make_drawing, write_drawing
from slamgym.drawing.formats.png import draw_picture


@pytest.fixture(scope="module")
def drawing():
    grid, _, model = painted(FLAT, turn_deg=5.0)
    return make_drawing(grid, "flat <1>", model)


@pytest.fixture(scope="module")
def files(drawing, tmp_path_factory):
    stem = tmp_path_factory.mktemp("drawing") / "flat"
    return {path.suffix: path for path in write_drawing(drawing, stem, ["svg", "geojson", "json", "png"])}


def test_json_is_a_plan_that_can_be_explored(drawing, files):
    plan = read_houseexpo(files[".json"])
    check_plan(plan)
    assert plan.free_space.equals_exact(drawing.floor.geoms[0].normalize(), 1e-3) or (
        plan.free_space.symmetric_difference(drawing.floor).area < 1e-3
    )
    assert [door.width for door in plan.doors] == pytest.approx(
        [door.width for door in drawing.doors], abs=1e-4
    )
    assert len(plan.rooms) == 2
    extras = json.loads(files[".json"].read_text())["drawing"]
    assert len(extras["walls"]) == len(drawing.walls)
    assert extras["angle_deg"] == pytest.approx(5.0, abs=0.3)


@pytest.fixture(scope="module")
def wide():
    """Two rooms and an opening of 2 m between them."""
    rooms = shapely.union_all([shapely.box(0, 0, 4, 5), shapely.box(4, 1, 4.1, 3), shapely.box(4.1, 0, 9, 5)])
    grid, _, model = painted(rooms)
    return make_drawing(grid, "wide", model, 3.0)


@pytest.mark.parametrize("suffix", ["json", "geojson", "dxf", "ifc"])
def test_every_format_keeps_a_wide_opening_in_the_round_trip(wide, tmp_path, suffix):
    pytest.importorskip({"dxf": "ezdxf", "ifc": "ifcopenshell"}.get(suffix, "json"))
    (path,) = write_drawing(wide, tmp_path / "wide", [suffix])
    source = open_plans(str(path))
    plan = source.load(source.ids[0])
    assert [door.width for door in plan.doors] == pytest.approx([2.0], abs=0.02)
    assert plan.area == pytest.approx(wide.area, rel=0.01)
    assert len(plan.rooms) == 2


def test_an_opening_is_told_from_a_door(wide, tmp_path):
    files = write_drawing(wide, tmp_path / "wide", ["svg", "geojson", "json", "html"])
    svg, geojson, text, page = (path.read_text() for path in files)
    assert 'class="opening"' in svg
    assert 'class="door"' not in svg
    assert '"kind": "opening"' in geojson
    assert json.loads(text)["drawing"]["doors"][0]["kind"] == "opening"
    assert "opening, " in page


def test_geojson_says_what_each_feature_is(drawing, files):
    data = json.loads(files[".geojson"].read_text())
    assert "local metres" in data["coordinates"]
    kinds = [feature["properties"]["kind"] for feature in data["features"]]
    assert (kinds.count("wall"), kinds.count("door"), kinds.count("room")) == (len(drawing.walls), 1, 2)
    for feature in data["features"]:
        shape = shapely.from_geojson(json.dumps(feature))
        assert shape.is_valid
        assert feature["properties"]["layer"] in {"SEEN", "INFERRED"}
    walls = [f["properties"] for f in data["features"] if f["properties"]["kind"] == "wall"]
    assert all(0.0 < wall["confidence"] < 1.0 and wall["thickness_m"] > 0.0 for wall in walls)


def test_svg_is_true_to_scale(drawing, files):
    root = ET.fromstring(files[".svg"].read_text())
    width = float(root.get("width").removesuffix("mm"))
    view = [float(value) for value in root.get("viewBox").split()]
    assert view[2] / width == pytest.approx(100.0, rel=1e-3)  # 1:100
    name = "{http://www.w3.org/2000/svg}"
    (layer,) = [group for group in root.iter(f"{name}g") if group.get("id") == "DOORS"]
    ends = [tuple(map(float, part[1:].split(","))) for part in layer[0].get("d").split()]
    assert np.hypot(*np.subtract(*ends)) == pytest.approx(1000.0 * drawing.doors[0].width, abs=0.3)
    (bar,) = [group for group in root.iter(f"{name}g") if group.get("id") == "SCALE"]
    length = float(bar[0].get("d").split("h")[1].split("v")[0])
    assert f"{length / 1000:g} m " in bar[1].text


def test_png_shows_floor_walls_and_doors(drawing):
    picture = draw_picture(drawing, 500)
    colours = {tuple(colour) for colour in picture.reshape(-1, 3).tolist()}
    assert {(255, 255, 255), (25, 113, 194)} <= colours
    assert picture.shape[2] == 3


def test_text_formats_are_the_same_every_time(drawing, files, tmp_path):
    again = write_drawing(drawing, tmp_path / "again", ["svg", "geojson", "json", "png"])
    for path in again:
        assert path.read_bytes() == files[path.suffix].read_bytes()


def test_dxf_has_its_layers_in_metres_and_passes_the_audit(drawing, tmp_path):
    ezdxf = pytest.importorskip("ezdxf")
    (path,) = write_drawing(drawing, tmp_path / "flat", ["dxf"])
    document = ezdxf.readfile(path)
    audit = document.audit()
    assert not audit.errors
    assert not audit.fixes
    assert document.header["$INSUNITS"] == 6
    space = document.modelspace()
    walls = space.query("LWPOLYLINE[layer=='WALLS']")
    assert len(walls) == len(drawing.walls)
    assert all(wall.closed for wall in walls)
    union = shapely.union_all([shapely.Polygon([(x, y) for x, y, *_ in wall.get_points()]) for wall in walls])
    assert union.area == pytest.approx(shapely.union_all([w.polygon for w in drawing.walls]).area, rel=1e-3)
    (door,) = space.query("LINE[layer=='DOORS']")
    assert door.dxf.start.distance(door.dxf.end) == pytest.approx(drawing.doors[0].width, abs=1e-6)
    assert len(space.query("LWPOLYLINE[layer=='ROOMS']")) == 2
    shown = {
        text.text
        for line in space.query("DIMENSION")
        for text in line.get_geometry_block()
        if text.dxftype() == "MTEXT"
    }
    assert shown == {f"{line.length:.2f}" for line in drawing.dimensions}
    measured = sorted(line.get_measurement() for line in space.query("DIMENSION[layer=='DIMENSIONS']"))
    assert measured == pytest.approx(sorted(line.length for line in drawing.dimensions), abs=1e-6)
    assert len(space.query("LWPOLYLINE[layer=='RAW']")) > 0


@pytest.mark.filterwarnings(
    "ignore::pytest.PytestUnraisableExceptionWarning"
)  # the validator leaves a file open
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_ifc_is_valid_and_holds_walls_doors_and_spaces(drawing, tmp_path):
    ifcopenshell = pytest.importorskip("ifcopenshell")
    validate = pytest.importorskip("ifcopenshell.validate")
    element = pytest.importorskip("ifcopenshell.util.element")
    first, second = (write_drawing(drawing, tmp_path / name / "flat", ["ifc"])[0] for name in ("a", "b"))
    model = ifcopenshell.open(str(first))
    log = validate.json_logger()
    validate.validate(model, log, express_rules=True)
    assert log.statements == []
    assert len(model.by_type("IfcWall")) == len(drawing.walls)
    (door,) = model.by_type("IfcDoor")
    assert door.OverallWidth == pytest.approx(drawing.doors[0].width)
    assert door.FillsVoids[0].RelatingOpeningElement.is_a("IfcOpeningElement")
    areas = [
        element.get_psets(space)["Qto_SpaceBaseQuantities"]["NetFloorArea"]
        for space in model.by_type("IfcSpace")
    ]
    assert areas == pytest.approx([room.area for room in drawing.rooms], rel=1e-6)
    other = ifcopenshell.open(str(second))
    assert [e.GlobalId for e in model.by_type("IfcRoot")] == [e.GlobalId for e in other.by_type("IfcRoot")]


def test_an_unknown_format_is_refused(drawing, tmp_path):
    with pytest.raises(SlamgymError, match="unknown format 'dwg'; choose from dxf"):
        write_drawing(drawing, tmp_path / "flat", ["dwg"])
