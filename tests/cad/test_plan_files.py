"""The same flat from DXF, IFC and GeoJSON, in the forms in which walls and doors are drawn."""

import json
import sys

import drawn_flat as flat
import numpy as np
import pytest

from slamgym.cad import check_plan, open_plans, read_dxf, read_geojson, read_ifc
from slamgym.cad.ifc import storeys_of
from slamgym.core.errors import PlanError


def check_flat(plan, doors=1, tolerance=0.05):
    check_plan(plan)
    assert plan.area == pytest.approx(flat.AREA, abs=tolerance)
    x0, _, x1, y1 = plan.bounds
    assert (x0, x1, y1) == pytest.approx((0.0, 7.0, 4.0), abs=0.011)
    assert len(plan.doors) == doors
    if doors:
        ends = np.array([plan.doors[0].start, plan.doors[0].end])
        assert np.abs(ends - np.reshape(flat.DOOR, (2, 2))).max() < 0.07
        assert plan.doors[0].width == pytest.approx(0.9, abs=0.01)


@pytest.fixture
def write(tmp_path):
    def write(name, text):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize(
    "how",
    [
        {},
        {"unit": "mm"},
        {"walls": "A-WALL-FULL", "doors": "A-DOOR"},
        {"walls": "Wände", "doors": "TÜREN"},
        {"swings": True},
        {"block": True, "unit": "mm"},
    ],
)
def test_dxf(write, how):
    path = write("flat.dxf", flat.dxf(**how))
    plan = read_dxf(path)
    assert plan.doubts == ()
    check_flat(plan)
    assert open_plans(path).load("flat").free_space.equals(plan.free_space)


def test_coordinates_next_to_nothing_are_zeros(write):
    path = write(
        "a.dxf", flat.dxf().replace("\n 10\n1.0\n 20\n-0.12\n", "\n 10\n1.0\n 20\n-1e-308\n")
    )
    check_plan(read_dxf(path))  # geometry would divide by zero


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_dxf_doors_are_blocks_with_a_leaf_that_stands_open(write, side):
    import io

    import ezdxf

    document = ezdxf.read(io.StringIO(flat.dxf(doors="DOORS")))
    space = document.modelspace()
    for line in space.query("LINE"):
        space.delete_entity(line)
    block = document.blocks.new("D90")
    block.add_line((0, 0), (0, 1))
    block.add_arc((0, 0), 1.0, 0.0, 90.0)
    for x0, y0, x1, y1 in (flat.DOOR, flat.ENTRANCE):
        width = float(np.hypot(x1 - x0, y1 - y0))
        turn = float(np.degrees(np.arctan2(y1 - y0, x1 - x0)))
        scale = {"xscale": width, "yscale": side * width, "zscale": width}
        space.add_blockref("D90", (x0, y0), {**scale, "rotation": turn, "layer": "A-DOOR"})
    text = io.StringIO()
    document.write(text)
    check_flat(read_dxf(write("blocks.dxf", text.getvalue())))


def test_dxf_without_a_unit_is_guessed_with_a_doubt_and_refused_as_a_source(write):
    path = write("flat.dxf", flat.dxf(unit=""))
    plan = read_dxf(path)
    check_flat(plan)
    assert "millimetres" in plan.doubts[0]
    with pytest.raises(PlanError, match=r"flat\.dxf@0\.001"):
        open_plans(path).load("flat")
    check_flat(open_plans(f"{path}@0.001").load("flat"))


def test_dxf_layers_are_named_or_chosen(write):
    path = write("flat.dxf", flat.dxf(walls="L1"))
    with pytest.raises(PlanError, match="it has 'DOORS', 'L1'"):
        read_dxf(path)
    check_flat(read_dxf(path, layers=["l*"]))


def hatched_hall(layer):
    """A hall of 6 m x 4 m whose walls are hatches without outlines."""
    import io

    import ezdxf

    document = ezdxf.new(units=6)
    hatch = document.modelspace().add_hatch(dxfattribs={"layer": layer})
    hatch.paths.add_polyline_path([(0, 0), (6.2, 0), (6.2, 4.2), (0, 4.2)], is_closed=True)
    hatch.paths.add_polyline_path(
        [(0.1, 0.1), (6.1, 0.1), (6.1, 4.1), (0.1, 4.1)], is_closed=True, flags=0
    )
    text = io.StringIO()
    document.write(text)
    return text.getvalue()


def test_dxf_walls_that_are_hatches_alone(write):
    plan = read_dxf(write("hall.dxf", hatched_hall("WALLS")))
    check_plan(plan)
    assert plan.area == pytest.approx(24.0, abs=0.01)
    path = write("other.dxf", hatched_hall("FILL"))
    with pytest.raises(PlanError, match=r"name it \(--layers\), it has 'FILL'"):
        read_dxf(path)
    assert read_dxf(path, layers=["FILL"]).area == pytest.approx(24.0, abs=0.01)


def test_layers_are_named_to_plans_and_generate(write, tmp_path, capsys):
    from slamgym.commands.cli import main

    path = write("other.dxf", hatched_hall("FILL"))
    assert main(["plans", "list", str(path), "--layers", "FILL"]) == 0
    assert "24.0" in capsys.readouterr().out
    line = ["generate", "--plans", str(path), "--layers", "FILL", "--pairs", "1", "--minutes"]
    options = ["0.1", "--explorer", "nearest", "--engine", "in_process", "-o"]
    assert main([*line, *options, str(tmp_path / "data")]) == 0
    assert main(["plans", "list", "bundled", "--layers", "FILL"]) == 2
    assert "--layers needs a DXF drawing" in capsys.readouterr().err


def test_dxf_walls_as_single_lines_and_wide_polylines(write):
    import io

    import ezdxf

    document = ezdxf.new(units=6)
    space = document.modelspace()
    wall = {"layer": "WALL"}
    space.add_lwpolyline([(0, 0), (7, 0), (7, 4), (0, 4)], close=True, dxfattribs=wall)
    space.add_line((4, 0), (4, 1), dxfattribs=wall)
    space.add_lwpolyline([(4, 1.9), (4, 4.05)], dxfattribs={**wall, "const_width": 0.1})
    space.add_circle((1.0, 3.0), 0.3, dxfattribs=wall)
    text = io.StringIO()
    document.write(text)
    plan = read_dxf(write("thin.dxf", text.getvalue()))
    check_plan(plan)
    assert plan.area == pytest.approx(28.0 - 0.01 - 0.21 - 0.283, abs=0.02)
    assert plan.free_space.bounds == pytest.approx((0, 0, 7, 4))


def test_geojson(write):
    path = write("flat.geojson", flat.geojson_text())
    plan = read_geojson(path)
    check_flat(plan)
    assert sorted(room.category for room in plan.rooms) == ["Bedroom", "Kitchen"]
    assert open_plans(path).ids == ["flat"]


@pytest.mark.parametrize("gone", range(5))
def test_rooms_are_floor_where_a_wall_is_missing(write, gone):
    document = flat.geojson()
    walls = [f for f in document["features"] if f["properties"]["kind"] == "wall"]
    document["features"].remove(walls[gone])
    check_flat(read_geojson(write("gap.geojson", json.dumps(document))), tolerance=0.07)


def test_a_frame_round_a_name_and_an_open_passage_part_no_rooms(write):
    document = flat.geojson()
    frames = [(1.0, 2.0, 2.0, 2.3), (2.0, 0.0, 2.9, 4.0)]
    for box in frames:
        geometry = {"type": "Polygon", "coordinates": [flat.ring(box)]}
        document["features"].append(
            {"type": "Feature", "properties": {"kind": "room"}, "geometry": geometry}
        )
    check_flat(read_geojson(write("frame.geojson", json.dumps(document))))


def test_geojson_of_walls_alone_shuts_the_entrance(write):
    walls = {"type": "MultiPolygon", "coordinates": [[flat.ring(box)] for box in flat.bodies()]}
    plan = read_geojson(write("walls.geojson", json.dumps(walls)))
    check_flat(plan, doors=0, tolerance=0.15)
    lines = {"type": "MultiLineString", "coordinates": [flat.ring(box) for box in flat.bodies()]}
    check_flat(read_geojson(write("lines.geojson", json.dumps(lines))), doors=0, tolerance=0.15)


def test_geojson_walls_that_run_through_a_door_are_opened(write):
    document = flat.geojson()
    document["features"] = [f for f in document["features"] if f["geometry"]["type"] != "Polygon"]
    boxes = [*flat.bodies()[:5], (4.0 - flat.T / 2, 0.0, 4.0 + flat.T / 2, 4.0)]
    for box in boxes:
        geometry = {"type": "Polygon", "coordinates": [flat.ring(box)]}
        document["features"].append(
            {"type": "Feature", "properties": {"kind": "wall"}, "geometry": geometry}
        )
    check_flat(read_geojson(write("flat.geojson", json.dumps(document))))


def test_ifc(write):
    path = write("house.ifc", flat.ifc(storeys=2))
    assert storeys_of(path) == ["Level 0", "Level 1"]
    for storey in (None, "Level 1"):
        check_flat(read_ifc(path, storey))
    source = open_plans(path)
    assert source.ids == ["house-Level 0", "house-Level 1"]
    check_flat(source.load("house-Level 1"))
    with pytest.raises(PlanError, match="no storey called 'Attic'"):
        read_ifc(path, "Attic")


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("a.dxf", "hello", "no readable DXF|no layer"),
        ("a.ifc", "hello", "no IFC model"),
        ("a.ifc", "ISO-10303-21;\nhello", "IFC"),
        ("a.geojson", "[1]", "no GeoJSON"),
        ("a.geojson", '{"type": "FeatureCollection", "features": []}', "no walls"),
        ("a.geojson", '{"type": "LineString", "coordinates": [[0, 0], [1, "x"]]}', "not lists of numbers"),
        ("a.geojson", '{"type": "MultiLineString", "coordinates": [[[8, 48], [8.01, 48], [8.01, 48.01]]]}', "degrees"),
        ("a.geojson", '{"type": "LineString", "coordinates": [[0, 0], [9, 0], [9, 5], [9, 6]]}', "enclose no space"),
        ("a.geojson", '{"type": "LineString", "coordinates": [[0, 0], [1e9, 0], [0, 5], [0, 0]]}', "beyond 10000 m"),
    ],
)  # fmt: skip
def test_bad_drawings_are_refused_with_a_sentence(write, name, content, sentence):
    if name.endswith(".ifc"):
        pytest.importorskip("ifcopenshell")
    path = write(name, content)
    with pytest.raises(PlanError, match=sentence):
        open_plans(path).load("a")


def test_a_model_that_its_reader_never_finishes_is_refused(write, monkeypatch):
    pytest.importorskip("ifcopenshell")
    monkeypatch.setenv("SLAMGYM_MAX_READER_SECONDS", "2")
    path = write("a.ifc", flat.ifc().replace("-140.0000000000001,", "-nan,"))
    with pytest.raises(
        PlanError, match=r"a\.ifc: crashes its reader, or takes it more than 2 s or .* set SLAMGYM_"
    ):
        read_ifc(path)


def test_rooms_that_no_door_joins_are_refused(write):
    boxes = [(0, 0, 4, 0.1), (0, 3.9, 4, 4), (0, 0, 0.1, 4), (3.9, 0, 4, 4)]
    rooms = [[flat.ring((x + a, b, x + c, d))] for x in (0, 3.9, 7.8) for a, b, c, d in boxes]
    path = write("cells.geojson", json.dumps({"type": "MultiPolygon", "coordinates": rooms}))
    with pytest.raises(PlanError, match="join only 14"):
        read_geojson(path)


def add_grid_of_an_empty_block(document, space):
    document.blocks.new("E")
    grid = {"row_count": 32767, "column_count": 32767, "row_spacing": 1.0, "column_spacing": 1.0}
    space.add_blockref("E", (0, 0), dxfattribs=grid)


def add_blocks_of_empty_blocks(document, space):
    document.blocks.new("B0")
    for number in range(1, 18):
        block = document.blocks.new(f"B{number}")
        for _ in range(8):
            block.add_blockref(f"B{number - 1}", (0, 0))
    space.add_blockref("B17", (0, 0))


def add_a_block_in_itself(document, space):
    document.blocks.new("S").add_blockref("S", (0, 0))
    space.add_blockref("S", (0, 0))


def add_walls_in_a_block(document, space):
    block = document.blocks.new("W")
    for number in range(1000):
        block.add_line((number, 0), (number, 1))
    grid = {"row_count": 9, "column_count": 9, "row_spacing": 1.0, "column_spacing": 1.0}
    space.add_blockref("W", (0, 0), dxfattribs={"layer": "WALLS", **grid})


def add_many_swings(document, space):
    for x, y in np.random.default_rng(0).uniform(0.0, 8.0, (3000, 2)):
        space.add_arc((x, y), 0.9, 0, 90, dxfattribs={"layer": "DOORS"})


def add_a_curve_through_many_points(document, space):
    space.add_spline(
        np.random.default_rng(0).uniform(0.0, 8.0, (8000, 2)), dxfattribs={"layer": "WALLS"}
    )


def add_a_wide_scribble(document, space):
    points = np.random.default_rng(0).uniform(0.0, 8.0, (900, 2))
    space.add_lwpolyline(points, dxfattribs={"layer": "WALLS", "const_width": 0.1})


def add_copies_of_a_hatch_of_edges(document, space):
    block = document.blocks.new("H")
    edges = block.add_hatch().paths.add_edge_path()
    for number in range(500):
        edges.add_line((number, 0), (number + 1, 1))
    for _ in range(500):
        space.add_blockref("H", (0, 0))


def add_an_arc_without_bounds(document, space):
    space.add_arc((0, 0), 1.0, 0.0, 1e300, dxfattribs={"layer": "WALLS"})


@pytest.mark.parametrize(
    ("add", "sentence"),
    [
        (add_grid_of_an_empty_block, "MAX_ENTRIES"),
        (add_blocks_of_empty_blocks, "MAX_ENTRIES"),
        (add_a_block_in_itself, "MAX_DEPTH"),
        (add_walls_in_a_block, "MAX_VERTICES"),
        (add_many_swings, "MAX_NEAR_PAIRS"),
        (add_a_curve_through_many_points, "MAX_ENTRIES"),
        (add_copies_of_a_hatch_of_edges, "MAX_ENTRIES"),
        (add_a_wide_scribble, "MAX_CROSSINGS"),
        (add_an_arc_without_bounds, "arc without bounds"),
    ],
)
def test_dxf_that_stands_for_too_much_is_refused_at_once(tmp_path, monkeypatch, add, sentence):
    import time

    import ezdxf

    monkeypatch.setenv("SLAMGYM_MAX_VERTICES", "20000")
    monkeypatch.setenv("SLAMGYM_MAX_NEAR_PAIRS", "300000")
    document = ezdxf.new(units=6)
    document.modelspace().add_lwpolyline(
        [(0, 0), (8, 0), (8, 6)], close=True, dxfattribs={"layer": "WALLS"}
    )
    add(document, document.modelspace())
    document.saveas(tmp_path / "a.dxf")
    start = time.process_time()
    with pytest.raises(PlanError, match=sentence):
        read_dxf(tmp_path / "a.dxf")
    assert (
        time.process_time() - start < 10.0
    )  # a fifteenth of it on a quiet core; without the limits no end


@pytest.mark.skipif(sys.platform != "linux", reason="bounds memory as Linux counts it")
@pytest.mark.parametrize(
    "budget", [("SLAMGYM_MAX_READER_BYTES", "50000000"), ("SLAMGYM_MAX_READER_SECONDS", "1")]
)
def test_dxf_that_takes_its_reader_too_much_is_refused(write, monkeypatch, budget):
    """The library takes 60 MB for each MB of entities without anything."""
    monkeypatch.setenv(*budget)
    path = write(
        "a.dxf", "0\nSECTION\n2\nENTITIES\n" + "0\nLINE\n" * 400_000 + "0\nENDSEC\n0\nEOF\n"
    )
    with pytest.raises(PlanError, match=r"a\.dxf: crashes its reader, or takes it more than"):
        read_dxf(path)


def test_geojson_of_too_many_lists_is_refused_before_it_is_parsed(write):
    text = '{"type": "MultiLineString", "coordinates": [' + "[]," * 200_001 + "[]]}"
    with pytest.raises(PlanError, match="MAX_ENTRIES"):
        read_geojson(write("a.geojson", text))


def test_blocks_within_blocks_without_end_are_refused(write, monkeypatch):
    import io

    import ezdxf

    monkeypatch.setenv("SLAMGYM_MAX_ENTRIES", "5000")
    document = ezdxf.new()
    document.blocks.new("B0").add_line((0, 0), (1, 0))
    for number in range(1, 9):
        block = document.blocks.new(f"B{number}")
        for _ in range(10):
            block.add_blockref(f"B{number - 1}", (0, 0))
    document.modelspace().add_blockref("B8", (0, 0))
    text = io.StringIO()
    document.write(text)
    with pytest.raises(PlanError, match="SLAMGYM_MAX_ENTRIES"):
        read_dxf(write("bomb.dxf", text.getvalue()))
