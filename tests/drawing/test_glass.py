"""A wall that a person says is glass is glass in every format, and stands where it stood."""

import json
import re

import pytest
from browser import needs_browser, run_in_page
from drawing.painted import FLAT, painted

from slamgym.drawing import make_drawing, write_drawing
from slamgym.drawing.edits import Correction, Corrections, map_digest, read_corrections
from slamgym.drawing.formats.html import format_html

GRID, _, MODEL = painted(FLAT)
PLAIN = make_drawing(GRID, "flat", MODEL)
BETWEEN = ((4.05, 0.0), (4.05, 1.3))
"""The wall between the two rooms, up to the door."""


def corrected(*entries):
    corrections = Corrections(entries, {"sha256": map_digest(PLAIN.grid)})
    return make_drawing(GRID, "flat", MODEL, corrections=corrections)


def glass(line):
    return Correction("glass_wall", line=line)


def test_a_whole_wall_or_a_part_of_it_is_glass():
    def metres(drawing):
        return sum(wall.length for wall in drawing.walls if wall.is_glass)

    assert metres(PLAIN) == 0.0
    whole = corrected(glass(BETWEEN))
    assert metres(whole) == pytest.approx(1.3, abs=0.06)
    part = corrected(glass(((0.0, 1.0), (0.0, 3.0))))
    assert metres(part) == pytest.approx(2.0, abs=0.01)
    for drawing in (whole, part):
        length = sum(wall.length for wall in drawing.walls)
        assert length == pytest.approx(sum(wall.length for wall in PLAIN.walls))
        assert drawing.floor.equals(PLAIN.floor)
        assert not any("correction" in doubt for doubt in drawing.doubts)


@pytest.mark.parametrize("line", [((1.0, 1.0), (3.0, 1.0)), ((3.5, 0.6), (4.6, 0.6))])
def test_glass_where_no_wall_stands_along_the_line_is_left_out(line):
    (said,) = corrected(glass(line)).doubts
    assert said.endswith("no wall stands along it")


def test_a_wall_that_is_added_can_be_glass():
    line = ((0.1, 3.0), (2.4, 3.0))
    drawing = corrected(Correction("add_wall", line=line), glass(line))
    (wall,) = [wall for wall in drawing.walls if wall.is_glass]
    assert wall.length == pytest.approx(2.5, abs=0.15)
    assert len(drawing.rooms) == 3


def test_glass_has_a_layer_of_its_own_in_files(tmp_path):
    ezdxf = pytest.importorskip("ezdxf")
    drawing = corrected(glass(BETWEEN))
    write_drawing(drawing, tmp_path / "flat", ["dxf", "svg", "json"])
    space = ezdxf.readfile(tmp_path / "flat.dxf").modelspace()
    (outline,) = space.query('LWPOLYLINE[layer=="A-GLAZ"]')
    xs = [point[0] for point in outline.get_points()]
    assert (min(xs), max(xs)) == pytest.approx((4000.0, 4100.0), abs=30.0)
    svg = (tmp_path / "flat.svg").read_text()
    (group,) = re.findall(r'<g id="GLASS">(.*?)</g>', svg)
    assert group.count("<path") == 1
    walls = json.loads((tmp_path / "flat.json").read_text())["drawing"]["walls"]
    assert sum(wall["glass"] for wall in walls) == 1


def test_a_building_model_knows_glass_by_its_material(tmp_path):
    ifcopenshell = pytest.importorskip("ifcopenshell")
    element = pytest.importorskip("ifcopenshell.util.element")
    write_drawing(corrected(glass(BETWEEN)), tmp_path / "flat", ["ifc"])
    model = ifcopenshell.open(str(tmp_path / "flat.ifc"))
    made_of = {}
    for wall in model.by_type("IfcWall"):
        kind = element.get_type(wall)
        (layer,) = element.get_material(kind).MaterialLayers
        made_of.setdefault(layer.Material.Name, []).append(kind.Name)
    assert made_of["glass"] == ["Glass wall 10 cm"]
    assert not any("Glass" in name for name in made_of["unknown"])


@needs_browser
def test_one_click_makes_a_wall_glass_and_another_takes_it_back(tmp_path):
    clicks = """
      const svg = document.querySelector(".editor svg"), found = [];
      const click = (x, y) => {
        const place = new DOMPoint(1000 * (x - svg.dataset.left), 1000 * (svg.dataset.top - y));
        const at = place.matrixTransform(svg.getScreenCTM());
        svg.dispatchEvent(new MouseEvent("click", { clientX: at.x, clientY: at.y, bubbles: true }));
        found.push(document.getElementById("json").value);
      };
      document.getElementById("glass_wall").click();
      click(4.0, 0.6); click(4.0, 0.65);
      return found;
    """
    marked, back = run_in_page(format_html(PLAIN), clicks, tmp_path)
    path = tmp_path / "flat.corrections.json"
    path.write_text(marked)
    drawing = make_drawing(GRID, "flat", MODEL, corrections=read_corrections(path))
    assert sum(wall.is_glass for wall in drawing.walls) == 1
    assert json.loads(back)["corrections"] == []
