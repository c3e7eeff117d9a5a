"""A person's corrections: each does what it says, in any order, and what doesn't fit is left out with a sentence."""

import dataclasses
import itertools
import json
import re

import pytest
import shapely
from browser import needs_browser, run_in_page
from drawing.painted import FLAT, painted

from slamgym.commands.cli import main
from slamgym.core.errors import InputFileError
from slamgym.drawing import make_drawing
from slamgym.drawing.edits import Correction, Corrections, map_digest, read_corrections
from slamgym.drawing.formats.html import format_html
from slamgym.drawing.formats.json import drawing_facts
from slamgym.interop import write_ros_map

GRID, _, MODEL = painted(FLAT)
PLAIN = make_drawing(GRID, "flat", MODEL)
DOOR = (4.04, 1.75)
SPLIT = {"kind": "split", "line": ((0.2, 3.2), (2.2, 3.2))}
JOIN = {"kind": "join", "at": DOOR}
WALL = {"kind": "add_wall", "line": ((0.1, 3.0), (2.4, 3.0)), "thickness": 0.12}
DOOR_IN_WALL = {"kind": "add_door", "line": ((0.8, 3.0), (1.7, 3.0))}
NAME = {"kind": "name_room", "at": (1.0, 1.0), "name": "Küche"}
NO_WALL = {"kind": "remove_wall", "line": ((4.05, 0.0), (4.05, 1.3)), "thickness": 0.1}


def corrected(*entries, **options):
    corrections = Corrections(
        tuple(Correction(**entry) for entry in entries),
        {"sha256": map_digest(PLAIN.grid)},
        "flat.corrections.json",
    )
    return make_drawing(GRID, "flat", MODEL, corrections=corrections, **options)


def rooms(drawing):
    return sorted(round(room.area, 1) for room in drawing.rooms)


def test_a_split_goes_on_to_the_walls_and_is_an_opening():
    drawing = corrected(SPLIT)
    assert rooms(drawing) == pytest.approx([4.5, 9.6, 12.6], abs=0.11)
    assert sorted(door.kind for door in drawing.doors) == ["door", "opening"]
    assert drawing.area == pytest.approx(PLAIN.area)
    assert len(drawing.walls) == len(PLAIN.walls)


def test_a_narrow_split_is_no_door():
    for kind, expected in (("split", "opening"), ("add_door", "door")):
        drawing = corrected({"kind": kind, "line": ((4.04, 1.35), (4.04, 2.15))})
        assert [door.kind for door in drawing.doors] == [expected]
        assert rooms(drawing) == pytest.approx(rooms(PLAIN), abs=0.11)


@pytest.mark.parametrize(("start", "end"), [(0.8, 1.7), (0.3, 2.1), (1.7, 0.8)])
def test_a_door_on_open_floor_lies_between_its_two_places_and_walls_lead_on_from_it(start, end):
    drawing = corrected({"kind": "add_door", "line": ((start, 3.2), (end, 3.2))})
    assert rooms(drawing) == pytest.approx([4.5, 9.6, 12.6], abs=0.25)
    (door,) = [door for door in drawing.doors if door.start[1] > 3.1]
    assert door.kind == "door"
    assert sorted((door.start[0], door.end[0])) == pytest.approx(sorted((start, end)), abs=1e-3)
    assert (door.start[1], door.end[1]) == pytest.approx((3.2, 3.2), abs=1e-3)
    beside = 2.5 - abs(end - start)
    assert drawing.area == pytest.approx(PLAIN.area - 0.1 * beside, abs=0.02)


def test_a_door_whose_places_are_near_jambs_lies_between_the_jambs():
    """A click is as good as a hand: a door in a passage isn't led past its corner through the next room."""
    (door,) = corrected({"kind": "add_door", "line": ((4.15, 1.38), (3.93, 2.14))}).doors
    assert door.width == pytest.approx(0.9, abs=0.12)
    assert len(corrected({"kind": "add_door", "line": ((4.12, 1.33), (4.13, 2.17))}).rooms) == 2


def test_joined_rooms_are_one():
    drawing = corrected(JOIN)
    assert rooms(drawing) == [pytest.approx(PLAIN.area, abs=0.06)]
    assert drawing.doors == ()


def test_a_wall_parts_two_rooms_and_a_door_opens_it():
    drawing = corrected(WALL)
    assert len(drawing.rooms) == 3
    assert len(drawing.doors) == 1
    assert drawing.area == pytest.approx(PLAIN.area - 2.5 * 0.12, abs=0.02)
    with_door = corrected(WALL, DOOR_IN_WALL)
    assert len(with_door.rooms) == 3
    assert sorted(round(door.width, 2) for door in with_door.doors) == [0.9, 0.92]
    assert with_door.area == pytest.approx(drawing.area + 0.9 * 0.12, abs=0.01)


def test_a_wall_that_is_taken_away_leaves_floor():
    drawing = corrected(NO_WALL)
    assert len(drawing.rooms) == 1
    assert drawing.area == pytest.approx(PLAIN.area + 1.3 * 0.1, abs=0.03)


def test_a_room_that_is_taken_away_goes_with_its_floor_and_its_doors():
    drawing = corrected({"kind": "remove_room", "at": (5.0, 1.0)}, NAME)
    assert rooms(drawing) == [rooms(PLAIN)[1]]
    assert drawing.doors == ()
    assert drawing.area == pytest.approx(drawing.rooms[0].area, abs=0.02)
    assert drawing.rooms[0].name == "Küche"
    none_left = corrected(
        {"kind": "remove_room", "at": (5.0, 1.0)}, {"kind": "remove_room", "at": (1.0, 1.0)}
    )
    assert len(none_left.rooms) == len(none_left.doubts) == 1


def test_a_room_gets_its_name_in_every_format(tmp_path):
    drawing = corrected(NAME)
    assert [room.name for room in drawing.rooms] == ["Küche", "R02"]
    assert [room.id for room in drawing.rooms] == ["R01", "R02"]
    assert "Küche and R02" in format_html(drawing)
    assert {room.category for room in drawing.as_plan().rooms} == {"Küche", "Room"}


def test_any_order_gives_the_same_drawing():
    entries = [
        SPLIT,
        JOIN,
        {**WALL, "line": ((5.5, 0.0), (5.5, 3.0))},
        {**DOOR_IN_WALL, "line": ((5.5, 1), (5.5, 2))},
    ]
    drawn = []
    for order in list(itertools.permutations(entries))[::7]:
        facts = drawing_facts(corrected(*order))
        facts["provenance"] = None
        drawn.append(json.dumps(facts))
    assert len(drawn) == 4
    assert len(set(drawn)) == 1
    assert len(json.loads(drawn[0])["rooms"]) == 3


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        (
            {**SPLIT, "line": ((0.2, 1.0), (0.9, 1.0))},
            "split at (0.20, 1.00) to (0.90, 1.00): it doesn't part two rooms of 1 m2 or more",
        ),
        ({**JOIN, "at": (2.0, 2.0)}, "join at (2.00, 2.00): no door and no boundary"),
        ({**DOOR_IN_WALL, "line": ((0.0, 1.0), (0.0, 2.0))}, "it doesn't part two rooms"),
        ({**DOOR_IN_WALL, "line": ((-0.1, 0.2), (-0.1, 2.8))}, "it doesn't part two rooms"),
        ({**SPLIT, "line": ((0.0, 4.8), (2.5, 4.8))}, "it doesn't part two rooms of 1 m2 or more"),
        ({**WALL, "line": ((-3.0, 0.0), (-3.0, 2.0))}, "no floor lies there"),
        ({**NO_WALL, "line": ((1.0, 1.0), (2.0, 1.0))}, "no wall stands there"),
        ({**NO_WALL, "line": ((-3.0, 1.0), (-2.0, 1.0))}, "no wall stands there"),
        ({**NAME, "at": (9.0, 1.0)}, "no room lies there"),
        ({**NO_WALL, "line": ((4.05, 0.0), (4e4, 1.3))}, "it doesn't lie on the map"),
    ],
)
def test_what_does_not_fit_the_drawing_costs_itself_only(entry, message):
    drawing = corrected(WALL, entry, DOOR_IN_WALL)
    (doubt,) = drawing.doubts
    assert doubt.startswith(f"correction left out, {entry['kind']} at (")
    assert message in doubt
    assert drawing.floor == corrected(WALL, DOOR_IN_WALL).floor
    assert rooms(drawing) == rooms(corrected(WALL, DOOR_IN_WALL))
    assert len(drawing.provenance["corrections"]) == 3


def test_a_correction_that_needs_one_that_is_left_out_is_left_out_too():
    nowhere = {**WALL, "line": ((-3.0, 0.0), (-3.0, 2.0))}
    drawing = corrected(nowhere, {**DOOR_IN_WALL, "line": ((-3.0, 0.5), (-3.0, 1.4))}, NAME)
    assert len(drawing.doubts) == 2
    assert rooms(drawing) == rooms(PLAIN)
    assert drawing.rooms[0].name == "Küche"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "is not valid JSON"),
        ("[]", "is no file of corrections"),
        ("{}", "is no file of corrections"),
        ('{"corrections": {}}', "is no file of corrections"),
        ('{"corrections": [], "map": 3}', "map"),
    ],
)
def test_a_file_that_is_none_is_refused(tmp_path, text, message):
    path = tmp_path / "c.json"
    path.write_text(text)
    with pytest.raises(InputFileError, match=r"c\.json: ") as error:
        read_corrections(path)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("3", "takes an object of settings"),
        ('{"kind": "spilt", "line": [[0, 0], [1, 1]]}', "did you mean 'split'?"),
        ('{"kind": "join", "place": [0, 0]}', "unknown setting 'place'"),
        ('{"kind": "join", "line": [[0, 0], [1, 1]]}', "join needs 'at': [x, y]"),
        ('{"kind": "name_room", "at": [0, 0]}', "and a name"),
        ('{"kind": "split", "line": [[0, 0], [0, 0]]}', "must be at least 0.1 m long"),
        ('{"kind": "join", "at": [0, 1e9]}', "must be in [-100000, 100000]"),
        ('{"kind": "add_wall", "line": [[0, 0], [1, 1]], "thickness": -1}', "thickness must be"),
    ],
)
def test_a_bad_line_of_a_file_costs_itself_only(tmp_path, entry, message):
    path = tmp_path / "c.json"
    path.write_text(f'{{"corrections": [{json.dumps(JOIN)}, {entry}, {json.dumps(NAME)}]}}')
    found = read_corrections(path)
    assert [one.kind for one in found.corrections] == ["join", "name_room"]
    (fault,) = found.faults
    assert fault.startswith("correction 2 of ")
    assert message in fault


def saved(folder, *entries, digest=None):
    path = folder / "flat.corrections.json"
    document = {
        "map": {"name": "flat", "sha256": digest or map_digest(PLAIN.grid)},
        "corrections": entries,
    }
    path.write_text(json.dumps(document))
    return path


def test_the_command_draws_with_corrections(tmp_path, capsys):
    (tmp_path / "maps").mkdir()
    path = write_ros_map(tmp_path / "maps" / "flat", GRID)
    command = [
        "cad",
        str(path),
        "-o",
        str(tmp_path / "out"),
        "--model",
        "none",
        "--formats",
        "json",
    ]
    assert main(command) == 0
    digest = json.loads((tmp_path / "out" / "flat.json").read_text())["drawing"]["map"]["sha256"]
    correct = [*command, "--corrections", str(saved(tmp_path, JOIN, digest=digest))]
    assert main(correct) == 0
    drawing = json.loads((tmp_path / "out" / "flat.json").read_text())["drawing"]
    assert len(drawing["rooms"]) == 1
    assert drawing["provenance"]["corrections"] == [{**JOIN, "at": list(DOOR)}]
    capsys.readouterr()
    saved(tmp_path, {**NAME, "at": (99.0, 1.0)}, JOIN, {"kind": "spilt"}, digest=digest)
    assert main(correct) == 0
    said = capsys.readouterr().err
    assert "correction left out, name_room at (99.00, 1.00): it doesn't lie on the map" in said
    assert "correction 3 of " in said
    assert len(json.loads((tmp_path / "out" / "flat.json").read_text())["drawing"]["rooms"]) == 1
    for words in (
        ["cad", str(path), *correct[1:]],
        [str(path.parent) if word == str(path) else word for word in correct],
    ):
        capsys.readouterr()
        assert main(words) == 2
        assert "--corrections are of one map" in capsys.readouterr().err


DRIVER = """
  const svg = document.querySelector(".editor svg");
  const press = (id) => document.getElementById(id).click();
  const text = (id) => document.getElementById(id).textContent;
  const saidThen = [];
  const click = (x, y) => {
    const place = new DOMPoint(1000 * (x - svg.dataset.left), 1000 * (svg.dataset.top - y));
    const at = place.matrixTransform(svg.getScreenCTM());
    svg.dispatchEvent(new MouseEvent("click", { clientX: at.x, clientY: at.y, bubbles: true }));
    saidThen.push(text("said"));
  };
  const key = (name, options = {}) =>
    document.dispatchEvent(new KeyboardEvent("keydown", { key: name, bubbles: true, ...options }));
  const listed = () => [...document.querySelectorAll("#corrections li")].map((item) => item.textContent);
  press("split"); click(0.6, 3.22); click(2.0, 3.18);
  press("join"); click(4.0, 1.75);
  press("undo");
  press("add_wall"); click(5.5, 0.0); click(5.55, 3.0);
  press("add_door"); click(5.45, 1.0); click(5.55, 1.8);
  press("remove_wall"); click(-0.05, 2.0);
  press("join"); click(1.0, 1.0); click(5.0, 1.0);
  press("name_room"); click(1.0, 4.5);
  document.getElementById("name").value = " Bath|room ";
  document.getElementById("naming").requestSubmit();
  let saved = null;
  const RealBlob = Blob;
  window.Blob = function (parts, options) { saved = parts.join(""); return new RealBlob(parts, options); };
  press("save");
  return { saved, shown: document.getElementById("json").value, listed: document.querySelectorAll("li button").length,
           drawn: svg.querySelectorAll(".edit").length, saidThen };
"""


@needs_browser
def test_a_door_lies_between_the_two_clicks(tmp_path):
    """Where no wall is drawn, in a wall that was added before, and at the jambs of a passage, whatever the zoom."""
    clicks = """
      press("add_door"); click(0.8, 3.22); click(1.7, 3.18);
      press("add_wall"); click(5.5, 0.0); click(5.55, 3.0);
      press("add_door"); click(5.45, 1.0); click(5.55, 1.8);
      press("add_door"); click(4.06, 1.35); click(4.03, 2.12);
      return text("json") || document.getElementById("json").value;
    """
    driver = DRIVER[: DRIVER.index('press("split")')] + clicks
    path = tmp_path / "flat.corrections.json"
    path.write_text(run_in_page(format_html(PLAIN), driver, tmp_path))
    drawing = make_drawing(GRID, "flat", MODEL, corrections=read_corrections(path))
    assert sorted(round(door.width, 2) for door in drawing.doors) == pytest.approx(
        [0.8, 0.9, 0.92], abs=0.02
    )
    assert len(drawing.rooms) == 4


@needs_browser
def test_clicks_in_the_report_become_a_file_that_is_carried_out(tmp_path):
    result = run_in_page(format_html(PLAIN), DRIVER, tmp_path)
    assert result["saved"] == result["shown"]
    assert result["listed"] == 5
    assert result["drawn"] >= 5
    assert "Only one face of this wall was seen: nothing is known behind it." in result["saidThen"]
    path = tmp_path / "flat.corrections.json"
    path.write_text(result["saved"])
    corrections = read_corrections(path)
    kinds = [entry.kind for entry in corrections.corrections]
    assert kinds == ["split", "add_wall", "add_door", "join", "name_room"]
    # Turned into the main direction, and on to the walls.
    (x0, y0), (x1, y1) = corrections.corrections[0].line
    assert (abs(x1 - x0), y0) == (pytest.approx(2.5, abs=0.02), pytest.approx(y1, abs=0.02))
    drawing = make_drawing(GRID, "flat", MODEL, corrections=corrections)
    assert sorted(room.name for room in drawing.rooms) == ["Bathroom", "R01", "R02"]
    assert sorted(door.kind for door in drawing.doors) == ["door", "opening"]
    again = run_in_page(
        format_html(drawing),
        'return document.querySelectorAll("#corrections li").length;',
        tmp_path,
    )
    assert again == 5


def driven(tmp_path, clicks, drawing=PLAIN):
    return run_in_page(
        format_html(drawing), DRIVER[: DRIVER.index('press("split")')] + clicks, tmp_path
    )


@needs_browser
def test_the_page_refuses_what_the_command_would_leave_out(tmp_path):
    said = driven(
        tmp_path,
        """
        press("split"); click(0.0, 4.75); click(2.5, 4.75);
        press("add_wall"); click(-3.0, 0.0); click(-3.0, 2.0);
        press("add_door"); click(-0.05, 1.0); click(-0.05, 2.0);
        return [saidThen[1], saidThen[3], saidThen[5], listed().length];
        """,
    )
    assert said == [
        "Split a room: it doesn't part two rooms of 1 m² or more; lead it from wall to wall.",
        "Add a wall: no floor lies there.",
        "Add a door: it doesn't part two rooms of 1 m² or more; lead it from wall to wall.",
        0,
    ]


@needs_browser
def test_the_page_names_the_rooms_that_the_command_draws(tmp_path):
    entries = [
        WALL,
        DOOR_IN_WALL,
        {**SPLIT, "line": ((0.5, 1.1), (3.8, 1.1))},
        {"kind": "add_door", "line": ((5.5, 1.0), (5.5, 1.9))},
        {**NAME, "at": (1.0, 4.5)},
        {**SPLIT, "line": ((0.2, 1.0), (0.9, 1.0))},
    ]
    drawing = corrected(*entries)
    shown, left_out = driven(
        tmp_path,
        'return [text("sizes"), listed().filter((words) => words.includes("left out"))];',
        drawing=dataclasses.replace(PLAIN, provenance=drawing.provenance),
    )
    found = sorted(float(area) for area in re.findall(r"([0-9.]+) m²", shown))
    assert found == pytest.approx(rooms(drawing), abs=0.15)
    assert "Küche" in shown
    assert len(left_out) == len(drawing.doubts) == 1


@needs_browser
def test_corrections_are_undone_and_redone_and_kept_until_they_are_saved(tmp_path):
    clicks = """
      key("1"); click(0.6, 3.22); click(2.0, 3.18);
      key("2"); click(4.0, 1.75);
      key("z", { ctrlKey: true });
      const undone = listed().length;
      key("z", { ctrlKey: true }); key("y", { ctrlKey: true }); key("Z", { ctrlKey: true, shiftKey: true });
      return [undone, listed().length];
    """
    assert driven(tmp_path, clicks) == [1, 2]
    back = """
      const found = [text("said"), listed().length];
      press("undo"); found.push(listed().length); press("redo"); press("save");
      return found;
    """
    said, kept, dropped = driven(tmp_path, back)
    assert "not saved yet" in said
    assert (kept, dropped) == (2, 0)
    assert driven(tmp_path, "return listed().length;") == 0


@needs_browser
def test_the_page_shows_the_corrected_plan(tmp_path):
    clicks = """
      press("add_door"); click(0.8, 3.22); click(1.7, 3.18);
      key("p");
      const layer = svg.lastElementChild;
      return [getComputedStyle(svg.querySelector(".over")).display, layer.querySelectorAll("image").length,
              layer.querySelectorAll(".door").length, layer.querySelectorAll("text").length];
    """
    assert driven(tmp_path, clicks) == ["none", 1, 2, 3]


@needs_browser
def test_a_room_is_taken_away_by_a_click(tmp_path):
    clicks = """
      press("remove_room"); click(5.0, 1.0);
      const one = text("sizes");
      click(1.0, 1.0);
      return [one, text("said"), JSON.parse(document.getElementById("json").value).corrections];
    """
    sizes, said, entries = driven(tmp_path, clicks)
    assert sizes.startswith("1 rooms: R01 1")
    assert "no other" in said
    (entry,) = entries
    assert entry["kind"] == "remove_room"
    assert entry["at"] == pytest.approx([5.0, 1.0], abs=0.05)  # clicks are whole pixels


@needs_browser
def test_a_place_on_a_large_map_is_enlarged_before_it_is_clicked(tmp_path):
    """So that a door is wider than a hand's error."""
    hall = shapely.union_all([FLAT, shapely.box(7.2, 1.0, 7.5, 2.0), shapely.box(7.4, 0, 70, 40)])
    grid, _, model = painted(hall, resolution=0.1)
    clicks = """
      const scale = () => 1000 * svg.getScreenCTM().a;
      const before = scale();
      press("split"); click(0.6, 3.22);
      const enlarged = scale();
      click(0.6, 3.22); click(2.0, 3.18);
      const line = JSON.parse(document.getElementById("json").value).corrections[0].line;
      key("0");
      return [before, enlarged, scale(), line];
    """
    before, enlarged, after, line = driven(tmp_path, clicks, make_drawing(grid, "hall", model))
    assert before == after < 40
    assert enlarged == pytest.approx(80, rel=0.01)
    assert sorted(x for x, _ in line) == pytest.approx([0.0, 2.5], abs=0.05)
