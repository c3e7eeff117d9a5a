"""Every format holds what was drawn, to scale, and can be read again."""

import dataclasses
import datetime as dt
import itertools
import json
import math
import xml.etree.ElementTree as ET

import numpy as np
import pytest
import shapely
from drawing.painted import FLAT, Painted, painted
from shapely import affinity

from slamgym.cad import check_plan, open_plans, read_houseexpo
from slamgym.core.errors import SlamgymError
from slamgym.drawing import make_drawing, write_drawing
from slamgym.drawing.drawing import DrawnDoor, DrawnWall
from slamgym.drawing.formats.chains import dimension_chains
from slamgym.drawing.formats.html import format_html
from slamgym.drawing.formats.look import DRAWN_COLOURS, label_boxes, place_labels
from slamgym.drawing.formats.png import draw_picture
from slamgym.drawing.formats.straight_walls import straight_walls


@pytest.fixture(scope="module")
def drawing():
    grid, _, model = painted(FLAT, turn_deg=5.0)
    return make_drawing(grid, "flat <1>", model)


@pytest.fixture(scope="module")
def files(drawing, tmp_path_factory):
    stem = tmp_path_factory.mktemp("drawing") / "flat"
    return {
        path.suffix: path
        for path in write_drawing(drawing, stem, ["svg", "geojson", "json", "png"])
    }


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
    opening = shapely.box(4, 1, 4.1, 3)
    grid, floor, _ = painted(
        shapely.union_all([shapely.box(0, 0, 4, 5), opening, shapely.box(4.1, 0, 9, 5)])
    )
    return make_drawing(grid, "wide", Painted(floor, opening))


@pytest.mark.parametrize("suffix", ["json", "geojson", "dxf", "ifc"])
@pytest.mark.parametrize("kind", ["drawing", "wide"])
def test_every_format_keeps_floor_and_doors_in_the_round_trip(request, tmp_path, suffix, kind):
    pytest.importorskip({"dxf": "ezdxf", "ifc": "ifcopenshell"}.get(suffix, "json"))
    drawn = request.getfixturevalue(kind)
    (path,) = write_drawing(drawn, tmp_path / "flat", [suffix])
    source = open_plans(str(path))
    plan = source.load(source.ids[0])
    (door,) = drawn.doors
    assert [door.width for door in plan.doors] == pytest.approx([door.width], abs=0.02)
    middle = shapely.LineString([plan.doors[0].start, plan.doors[0].end]).centroid
    assert middle.distance(shapely.LineString([door.start, door.end]).centroid) < 0.07
    assert plan.free_space.symmetric_difference(drawn.floor).area < 0.01 * drawn.area
    assert len(plan.rooms) == 2


@pytest.mark.parametrize("suffix", ["geojson", "dxf", "ifc"])
def test_the_floor_is_read_again_though_no_wall_was_drawn_somewhere(wide, tmp_path, suffix):
    pytest.importorskip({"dxf": "ezdxf", "ifc": "ifcopenshell"}.get(suffix, "json"))
    longest = max(wide.walls, key=lambda wall: wall.length)
    gappy = dataclasses.replace(
        wide, walls=tuple(wall for wall in wide.walls if wall != longest), doors=()
    )
    (path,) = write_drawing(gappy, tmp_path / "gappy", [suffix])
    source = open_plans(str(path))
    floor = source.load(source.ids[0]).free_space
    assert floor.symmetric_difference(wide.floor).area < 0.02 * wide.area


def test_an_opening_is_told_from_a_door(wide, tmp_path):
    files = write_drawing(wide, tmp_path / "wide", ["svg", "geojson", "json", "html"])
    svg, geojson, text, page = (path.read_text() for path in files)
    (layer,) = [group for group in ET.fromstring(svg) if group.get("id") == "DOORS"]
    assert [path.get("class") for path in layer] == ["opening"]
    assert '"kind": "opening"' in geojson
    assert json.loads(text)["drawing"]["doors"][0]["kind"] == "opening"
    assert "opening, " in page


def test_geojson_says_what_each_feature_is(drawing, files):
    data = json.loads(files[".geojson"].read_text())
    assert "local metres" in data["coordinates"]
    # Read by GDAL 3.12 as LOCAL_CS["frame of the map", ...] in metres; without it, as degrees (EPSG:4326).
    system = data["crs"]["properties"]["name"]
    assert system.startswith("ENGCRS[")
    assert 'LENGTHUNIT["metre",1]' in system
    assert system.count("[") == system.count("]")
    kinds = [feature["properties"]["kind"] for feature in data["features"]]
    assert (kinds.count("wall"), kinds.count("door"), kinds.count("room")) == (
        len(drawing.walls),
        1,
        2,
    )
    for feature in data["features"]:
        shape = shapely.from_geojson(json.dumps(feature))
        assert shape.is_valid
        assert feature["properties"]["layer"] in {"SEEN", "INFERRED"}
    walls = [f["properties"] for f in data["features"] if f["properties"]["kind"] == "wall"]
    assert all(0.0 < wall["confidence"] < 1.0 and wall["thickness_m"] > 0.0 for wall in walls)


def path_points(path):
    """The points of an SVG path that is one line."""
    return [tuple(map(float, part.strip("M").split(","))) for part in path.get("d").split()]


def test_svg_is_true_to_scale(drawing, files):
    root = ET.fromstring(files[".svg"].read_text())
    width = float(root.get("width").removesuffix("mm"))
    view = [float(value) for value in root.get("viewBox").split()]
    assert view[2] / width == pytest.approx(100.0, rel=1e-3)  # 1:100
    name = "{http://www.w3.org/2000/svg}"
    (layer,) = [group for group in root.iter(f"{name}g") if group.get("id") == "DOORS"]
    assert np.hypot(*np.subtract(*path_points(layer[0]))) == pytest.approx(
        1000.0 * drawing.doors[0].width, abs=0.3
    )
    (bar,) = [group for group in root.iter(f"{name}g") if group.get("id") == "SCALE"]
    _, (left, _), (right, _), _ = path_points(bar[0])
    texts = [text.text for text in root.iter(f"{name}text")]
    assert any(text.startswith(f"{(right - left) / 1000:g} m · 1:100") for text in texts)


def test_png_shows_floor_walls_and_doors(drawing):
    picture = draw_picture(drawing, 500)
    colours = {tuple(colour) for colour in picture.reshape(-1, 3).tolist()}
    assert {(255, 255, 255), (25, 113, 194)} <= colours
    assert picture.shape[2] == 3


@pytest.mark.parametrize("height", [0.05, 0.18, 0.5])
@pytest.mark.parametrize("turned", [False, True])
def test_labels_never_overlap(drawing, height, turned):
    labels, lines = place_labels(drawing, height, turned)
    boxes = label_boxes(labels, height)
    assert not any(a.intersects(b) for a, b in itertools.combinations(boxes, 2))
    assert [label.words for label in labels if label.kind == "size"] == [
        f"{line.length:.2f}" for line in lines
    ]
    if height < 0.2:
        assert {label.kind for label in labels} == {"name", "number", "size"}
        assert len(labels) == len(drawing.rooms) + len(drawing.doors) + len(drawing.dimensions)
        names = [
            (label.at, box)
            for label, box in zip(labels, boxes, strict=True)
            if label.kind == "name"
        ]
        assert all(any(room.polygon.covers(box) for room in drawing.rooms) for _, box in names)


def test_picture_drawing_and_report_explain_the_same_colours(drawing, files):
    svg, page = files[".svg"].read_text(), format_html(drawing)
    colours = {tuple(colour) for colour in draw_picture(drawing, 500).reshape(-1, 3).tolist()}
    for colour, words in DRAWN_COLOURS.values():
        assert f"rgb{colour}" in svg
        assert words in svg
        assert f"rgb{colour}" in page
        assert words in page
        assert colour in colours


def test_text_formats_are_the_same_every_time(drawing, files, tmp_path):
    again = write_drawing(drawing, tmp_path / "again", ["svg", "geojson", "json", "png"])
    for path in again:
        assert path.read_bytes() == files[path.suffix].read_bytes()


def in_millimetres(shape):
    return affinity.scale(shape, 1000, 1000, origin=(0, 0))


def test_dxf_has_its_layers_in_millimetres_and_passes_the_audit(drawing, tmp_path):
    ezdxf = pytest.importorskip("ezdxf")
    (path,) = write_drawing(drawing, tmp_path / "flat", ["dxf"])
    document = ezdxf.readfile(path)
    audit = document.audit()
    assert not audit.errors
    assert not audit.fixes
    assert document.header["$INSUNITS"] == 4
    space = document.modelspace()
    outlines = space.query("LWPOLYLINE[layer=='A-WALL']")
    assert all(line.closed for line in outlines)
    faces = shapely.polygonize([shapely.LinearRing(list(line.vertices())) for line in outlines])
    bodies = in_millimetres(shapely.union_all([wall.polygon for wall in drawing.walls]))
    assert all(face.boundary.distance(bodies.boundary) < 1.0 for face in shapely.get_parts(faces))
    (door,) = space.query("INSERT[layer=='A-DOOR']")
    jamb = door.matrix44().transform((1.0, 0.0, 0.0))
    ends = shapely.MultiPoint([tuple(place)[:2] for place in (door.dxf.insert, jamb)])
    assert ends.hausdorff_distance(in_millimetres(drawing.doors[0].line)) < 500.0
    assert ends.distance(shapely.Point(1000 * np.array(drawing.doors[0].start))) < 0.1
    assert ends.distance(shapely.Point(1000 * np.array(drawing.doors[0].end))) < 0.1
    swing = {part.dxf.layer for part in door.block() if part.dxf.layer != "0"}
    assert swing == {"A-DOOR-SWING-ASSUMED"}
    assert len(space.query("LWPOLYLINE[layer=='A-AREA']")) == 2
    assert len(space.query("LWPOLYLINE[layer=='V-SURV']")) > 0
    box = shapely.box(*document.header["$EXTMIN"][:2], *document.header["$EXTMAX"][:2])
    assert box.covers(in_millimetres(shapely.box(*drawing.bounds)).buffer(-1e-6))
    assert box.bounds == pytest.approx((*document.header["$LIMMIN"], *document.header["$LIMMAX"]))


def test_dxf_dimensions_are_metres_by_their_style_alone(drawing, tmp_path):
    ezdxf = pytest.importorskip("ezdxf")
    (path,) = write_drawing(drawing, tmp_path / "flat", ["dxf"])
    document = ezdxf.readfile(path)
    lines = document.modelspace().query("DIMENSION[layer=='A-ANNO-DIMS']")
    assert document.dimstyles.get("METRES").dxf.dimlfac == document.header["$DIMLFAC"] == 0.001
    assert {line.dxf.dimstyle for line in lines} == {"METRES"}
    assert not any(line.has_xdata("ACAD") for line in lines)
    chain = [0.9, 1.3, 0.8]
    expected = sorted([*(line.length for line in drawing.dimensions), *chain])
    shown = [t.text for line in lines for t in line.get_geometry_block() if t.dxftype() == "MTEXT"]
    shown = sorted(float(text.removesuffix(" m")) for text in shown)
    assert shown == pytest.approx(expected, abs=0.06)  # a cell
    measured = sorted(line.get_measurement() for line in lines)
    assert [0.001 * value for value in measured] == pytest.approx(shown, abs=0.01)


def test_dxf_has_a_sheet_in_millimetres_on_which_the_plan_is_upright(drawing, tmp_path):
    ezdxf = pytest.importorskip("ezdxf")
    (path,) = write_drawing(drawing, tmp_path / "flat", ["dxf"])
    document = ezdxf.readfile(path)
    assert document.layout_names_in_taborder() == ["Model", "A4 1-50"]
    layout = document.layout("A4 1-50")
    sheet = layout.dxf_layout.dxf
    assert (sheet.paper_width, sheet.paper_height) == (297.0, 210.0)
    assert (sheet.scale_numerator, sheet.scale_denominator) == (1.0, 1.0)
    _, view = layout.viewports()
    assert view.get_scale() == pytest.approx(1 / 50)
    on_paper = view.get_transformation_matrix()
    corners = shapely.get_coordinates([drawing.floor, *(line.line for line in drawing.dimensions)])
    places = np.array([tuple(on_paper.transform((*place, 0)))[:2] for place in 1000 * corners])
    x, y, _ = view.dxf.center
    half = 0.5 * np.array([view.dxf.width, view.dxf.height])
    assert (np.abs(places - (x, y)) < half).all()
    edges = np.diff(places[: len(shapely.get_coordinates(drawing.floor))], axis=0)
    long_edges = edges[np.hypot(*edges.T) > 10.0]
    assert np.abs(long_edges).min(axis=1) == pytest.approx(0.0, abs=0.35)
    # LibreCAD reads paper and scale here.
    assert document.header["$PSVPSCALE"] == 1 / 50
    size = np.subtract(document.header["$PLIMMAX"], document.header["$PLIMMIN"])
    assert size.tolist() == [297.0, 210.0]
    words = " ".join(text.dxf.text for text in layout.query("TEXT"))
    for part in (str(dt.date.today().year), "Source: ", "cells of 5 cm", "within 5 cm", "assumed"):
        assert part in words


def test_chains_measure_from_corner_to_jamb_along_a_wall_with_two_doors():
    rooms = [shapely.box(0, 0, 3, 4), shapely.box(3.1, 0, 8, 4), shapely.box(0, 4.1, 8, 9)]
    doors = [shapely.box(1.0, 4.0, 1.9, 4.1), shapely.box(5.0, 4.0, 5.8, 4.1)]
    grid, floor, _ = painted(shapely.union_all([*rooms, *doors]))
    drawn = make_drawing(grid, "two", Painted(floor, shapely.union_all(doors)))
    (chain,) = dimension_chains(drawn)
    lengths = [math.dist(*pair) for pair in itertools.pairwise(chain.marks)]
    assert sorted(lengths) == pytest.approx(sorted([1.0, 0.9, 3.1, 0.8, 2.2]), abs=0.05)
    (x0, y0), (x1, y1) = chain.marks[0], chain.marks[-1]
    assert math.dist((x0, y0), (x1, y1)) == pytest.approx(8.0, abs=0.05)
    line_y = y0 + chain.aside * (1.0 if x1 > x0 else -1.0)
    assert line_y == pytest.approx(4.5, abs=0.1)  # in the large room


@pytest.mark.parametrize(
    ("size", "paper"),
    [
        ((13, 7.5), ("A4", 50)),
        ((9, 11.5), ("A4", 50)),
        ((18, 9), ("A4", 100)),
        ((39, 9), ("A3", 100)),
        ((900, 9), ("A0", 1000)),
    ],
)
def test_papers(size, paper):
    pytest.importorskip("ezdxf")
    from slamgym.drawing.formats.dxf_sheet import fitting_paper

    found = fitting_paper(*size)
    assert (found.name, found.scale) == paper
    assert (found.width > found.height) == (size[0] > size[1])


@pytest.mark.filterwarnings(
    "ignore::pytest.PytestUnraisableExceptionWarning"
)  # the validator leaves a file open
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_ifc_is_valid_and_holds_walls_doors_and_spaces(drawing, tmp_path):
    ifcopenshell = pytest.importorskip("ifcopenshell")
    validate = pytest.importorskip("ifcopenshell.validate")
    element = pytest.importorskip("ifcopenshell.util.element")
    first, second = (
        write_drawing(drawing, tmp_path / name / "flat", ["ifc"])[0] for name in ("a", "b")
    )
    model = ifcopenshell.open(str(first))
    log = validate.json_logger()
    validate.validate(model, log, express_rules=True)
    assert log.statements == []
    # Six outer walls of the L and its neighbour, and the one between them, which runs through the door.
    walls = model.by_type("IfcWall")
    assert len(walls) == 7 < len(drawing.walls)
    for wall in walls:
        (layer,) = element.get_material(element.get_type(wall)).MaterialLayers
        assert layer.LayerThickness == pytest.approx(
            element.get_psets(wall)["Slamgym_Evidence"]["Thickness"], abs=0.026
        )
        common = element.get_psets(wall)["Pset_WallCommon"]
        assert common["Reference"] == element.get_type(wall).Name
        assert isinstance(common["IsExternal"], bool)
    assert len(model.by_type("IfcWallType")) == 1
    # The L has six corners, the room beside it four, of which two are on the wall between them or on its line.
    meetings = model.by_type("IfcRelConnectsPathElements")
    assert len(meetings) >= len(walls)
    assert {meeting.RelatingConnectionType for meeting in meetings} <= {
        "ATSTART",
        "ATEND",
        "ATPATH",
    }
    axes = [
        shape
        for wall in walls
        for shape in wall.Representation.Representations
        if shape.RepresentationIdentifier == "Axis"
    ]
    assert len(axes) == len(walls)
    (door,) = model.by_type("IfcDoor")
    assert door.OverallWidth == pytest.approx(drawing.doors[0].width)
    (voids,) = door.FillsVoids[0].RelatingOpeningElement.VoidsElements
    assert element.get_psets(voids.RelatingBuildingElement)["Slamgym_Evidence"][
        "Length"
    ] == pytest.approx(3.0, abs=0.1)
    (slab,) = model.by_type("IfcSlab")
    assert element.get_container(slab) == model.by_type("IfcBuildingStorey")[0]
    assert all(model.get_inverse(item) for item in model.by_type("IfcSurfaceStyle"))
    areas = [
        element.get_psets(space)["Qto_SpaceBaseQuantities"]["NetFloorArea"]
        for space in model.by_type("IfcSpace")
    ]
    assert areas == pytest.approx([room.area for room in drawing.rooms], rel=1e-6)
    other = ifcopenshell.open(str(second))
    assert [e.GlobalId for e in model.by_type("IfcRoot")] == [
        e.GlobalId for e in other.by_type("IfcRoot")
    ]


def test_pieces_of_a_straight_wall_are_one_wall_through_a_door():
    def piece(start, end, thickness=0.1, seen=1.0):
        body = shapely.LineString([start, end]).buffer(0.5 * thickness, cap_style="flat")
        return DrawnWall(
            start, end, body, thickness, True, 0.9, seen, "SEEN" if seen else "INFERRED"
        )

    pieces = [
        piece((0.0, 0.0), (2.0, 0.0)),
        piece((2.0, 0.01), (3.0, 0.01), seen=0.0),
        piece((3.9, 0.0), (6.0, 0.0), 0.12),
        piece((6.0, 0.0), (6.0, 3.0)),  # another direction
        piece((6.0, 0.0), (8.0, 0.0), 0.3),  # another thickness
        piece((9.0, 0.0), (10.0, 0.0)),  # nothing between
    ]
    door = DrawnDoor((3.0, 0.0), (3.9, 0.0), 0.1, ("R01", "R02"), (1, 2), 1.0, "SEEN")
    walls, wall_of = straight_walls(pieces, [door])
    assert [int(number == wall_of[0]) for number in wall_of] == [1, 1, 1, 0, 0, 0]
    assert len(walls) == len(set(wall_of.tolist())) == 4
    joined = walls[wall_of[0]]
    assert joined.length == pytest.approx(6.0)
    assert joined.polygon.bounds == pytest.approx((0.0, -0.06, 6.0, 0.06), abs=0.01)
    steps = [
        piece((0.0, 0.0), (3.0, 0.0)),
        piece((3.0, 0.0), (3.0, 0.1)),
        piece((3.0, 0.1), (5.0, 0.1)),
        piece((5.0, 0.1), (5.0, 2.0)),
    ]
    stepped, number = straight_walls(steps, [])
    assert number.tolist() == [0, 0, 0, 1]
    assert stepped[0].polygon.area == pytest.approx(
        shapely.union_all([one.polygon for one in steps[:3]]).area, rel=0.02
    )
    assert joined.share_seen == pytest.approx(4.1 / 5.1)
    assert joined.layer == "SEEN"
    apart, _ = straight_walls(pieces, [])
    assert len(apart) == 5


def test_an_unknown_format_is_refused(drawing, tmp_path):
    with pytest.raises(SlamgymError, match="unknown format 'dwg'; choose from dxf"):
        write_drawing(drawing, tmp_path / "flat", ["dwg"])
