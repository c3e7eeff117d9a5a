"""What ``slamgym cad`` says to inputs that are no maps, and how it doubts those that may be none."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from drawing.painted import FLAT, painted

from slamgym.commands.cad.draw import _may_be_map
from slamgym.commands.cli import main
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from slamgym.interop import read_ros_map, write_ros_map


def room_cells():
    """A room of 5 x 5 m at 5 cm."""
    cells = np.full((130, 130), UNKNOWN, np.uint8)
    cells[13:117, 13:117] = OCCUPIED
    cells[15:115, 15:115] = FREE
    return cells


def yaml_text(image="map.png", resolution="0.05"):
    return f"image: {image}\nresolution: {resolution}\norigin: [0, 0, 0]\n"


@pytest.fixture
def draw(tmp_path, capfd):
    """Draws ``tmp_path / name``; gives the exit code, and what was said on standard error."""

    def run(name, *words, formats="json"):
        out = tmp_path / "out"
        code = main(
            [
                "cad",
                str(tmp_path / name),
                "-o",
                str(out),
                "--model",
                "none",
                "--formats",
                formats,
                *words,
            ]
        )
        said = capfd.readouterr().err  # of libraries in C, too
        assert "Traceback" not in said
        if code:
            assert said.count("\n") == 1
            assert not out.exists()
        return code, said

    return run


def uniform(value):
    return np.full((100, 100), value, np.uint8)


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        (uniform(UNKNOWN), "none of its cells is free"),
        (uniform(FREE), "none of its cells is occupied"),
        (uniform(OCCUPIED), "none of its cells is free"),
        (np.array([[FREE]], np.uint8), "none of its cells is occupied"),
        (np.array([[FREE, OCCUPIED]], np.uint8), "it has 1 free cells, fewer than 50"),
    ],
    ids=["unknown", "free", "occupied", "one pixel", "two pixels"],
)
def test_pictures_without_a_building_are_refused(draw, tmp_path, cells, message):
    cv2.imwrite(str(tmp_path / "map.png"), cells)
    (tmp_path / "map.yaml").write_text(yaml_text())
    code, said = draw("map.yaml")
    assert (code, "map.yaml" in said, message in said) == (2, True, True), said


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("image: map.png\norigin: [0, 0, 0]\n", "'resolution' is missing"),
        (yaml_text(resolution="0"), "resolution must be in [1e-05, 100], not 0"),
        (yaml_text(resolution="-0.05"), "resolution must be in [1e-05, 100], not -0.05"),
        (yaml_text(resolution=".nan"), "resolution must be in [1e-05, 100], not nan"),
        (yaml_text(resolution="wide"), "resolution must be of type float, not 'wide'"),
        (yaml_text(resolution="0.0001"), "holds no floor of 1 m2 or more"),
        (yaml_text(image="gone.png"), "(No such file or directory); correct 'image' in map.yaml"),
        ("resolution: 0.05\n", "'image' is missing"),
        ("[1, 2", "not valid yaml"),
        ("- 1\n", "not a map description"),
    ],
)
def test_a_yaml_that_says_nonsense_is_refused(draw, tmp_path, text, message):
    cv2.imwrite(str(tmp_path / "map.png"), room_cells())
    (tmp_path / "map.yaml").write_text(text)
    code, said = draw("map.yaml")
    assert code == 2
    assert message in said


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("notes.txt", b"hello", "is no known kind of map"),
        ("flat.dwg", b"AC1032", "is no known kind of map"),
        ("flat.pdf", b"%PDF-1.4", "is no known kind of map"),
        ("state.pbstream", b"xx", "cartographer_pbstream_to_ros_map"),
        ("empty.json", b"{}", "is no Valetudo map"),
        ("broken.json", b"{", "is not valid JSON"),
    ],
)
def test_other_files_are_refused(draw, tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    code, said = draw(name)
    assert code == 2
    assert message in said


@pytest.mark.parametrize("content", [b"", b"hello", None], ids=["empty", "text", "truncated"])
def test_a_damaged_picture_is_one_sentence_even_where_libraries_talk(draw, tmp_path, content):
    whole = cv2.imencode(".png", room_cells())[1].tobytes()
    (tmp_path / "plain.png").write_bytes(whole[:150] if content is None else content)
    code, said = draw("plain.png", "--resolution", "0.05")
    assert code == 2
    assert "is not a picture" in said


def test_a_photograph_is_no_map(draw, tmp_path):
    noise = np.random.default_rng(0).integers(0, 255, (120, 120), np.uint8)
    cv2.imwrite(str(tmp_path / "photo.png"), noise)
    code, said = draw("photo.png", "--resolution", "0.05")
    assert code == 2
    assert "is no map" in said


@pytest.mark.parametrize("resolution", ["0.005", "20"])
def test_cells_of_no_robot_are_doubted(draw, tmp_path, resolution):
    cells = np.kron(room_cells(), np.ones((3, 3), np.uint8))
    cv2.imwrite(str(tmp_path / "map.png"), cells)
    (tmp_path / "map.yaml").write_text(yaml_text(resolution=resolution))
    code, said = draw("map.yaml")
    assert code == 0
    assert "scale doubtful: its cells measure" in said


def test_a_building_of_a_few_square_metres_is_doubted(draw, tmp_path):
    cv2.imwrite(str(tmp_path / "map.png"), room_cells())
    (tmp_path / "map.yaml").write_text(yaml_text(resolution="0.02"))
    code, said = draw("map.yaml")
    assert code == 0
    assert "scale doubtful: the whole floor measures" in said


def test_walls_that_nobody_saw_are_doubted(draw, tmp_path):
    cells = uniform(UNKNOWN)
    cells[20:80, 20:80] = FREE
    cells[50, 50] = OCCUPIED
    cv2.imwrite(str(tmp_path / "map.png"), cells)
    (tmp_path / "map.yaml").write_text(yaml_text())
    code, said = draw("map.yaml")
    assert code == 0
    assert "of the walls' length is inferred" in said


def test_the_map_is_not_written_over(tmp_path, capsys):
    cv2.imwrite(str(tmp_path / "map.png"), room_cells())
    (tmp_path / "map.yaml").write_text(yaml_text())
    before = (tmp_path / "map.png").read_bytes(), (tmp_path / "map.yaml").read_bytes()
    for kind in ("png", "yaml"):
        command = ["cad", str(tmp_path / "map.yaml"), "-o", str(tmp_path), "--model", "none"]
        assert main([*command, "--formats", kind]) == 2
        assert "would be written over" in capsys.readouterr().err
    assert before == ((tmp_path / "map.png").read_bytes(), (tmp_path / "map.yaml").read_bytes())


def test_maps_of_one_name_become_drawings_of_their_own(tmp_path, capsys):
    cells = room_cells()
    for name in ("a/map.png", "b/map.png", "b/map.jpg", "c/other.png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        cv2.imwrite(str(tmp_path / name), cells)
    command = [
        "cad",
        "--model",
        "none",
        "--formats",
        "json",
        "--resolution",
        "0.05",
        "-o",
        str(tmp_path / "out"),
    ]
    assert main([*command, *(str(tmp_path / name) for name in "abc")]) == 0
    drawn = {path.stem: json.loads(path.read_text()) for path in (tmp_path / "out").iterdir()}
    assert {
        name: Path(one["drawing"]["provenance"]["source"]).name for name, one in drawn.items()
    } == {"a_map": "map.png", "b_map_jpg": "map.jpg", "b_map_png": "map.png", "other": "other.png"}
    assert main([*command, str(tmp_path / "a"), str(tmp_path / "a" / "map.png")]) == 2
    assert "would be written as 'a_map_png', and so would" in capsys.readouterr().err


def test_the_drawing_of_another_map_stays(draw, tmp_path):
    for folder, resolution in (("a", 0.05), ("b", 0.04)):
        (tmp_path / folder).mkdir()
        write_ros_map(tmp_path / folder / "map", painted(FLAT, resolution)[0])
    assert draw("a/map.yaml")[0] == 0
    assert draw("b/../a/map.yaml")[0] == 0  # the same map by another path
    drawn = (tmp_path / "out" / "map.json").read_bytes()
    command = [
        "cad",
        str(tmp_path / "b" / "map.yaml"),
        "-o",
        str(tmp_path / "out"),
        "--model",
        "none",
    ]
    assert main([*command, "--formats", "svg"]) == 2
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["map.json"]
    assert (tmp_path / "out" / "map.json").read_bytes() == drawn


def test_a_folder_gets_an_index(tmp_path, capsys):
    maps = tmp_path / "maps"
    out = tmp_path / "out"
    maps.mkdir()
    grid, _, _ = painted(FLAT)
    write_ros_map(maps / "flat", grid)
    write_ros_map(maps / "index", grid)
    (maps / "other.json").write_text('{"anything": 1}')
    assert main(["cad", str(maps), "-o", str(out), "--model", "none", "--formats", "html"]) == 1
    assert "called like the index" in capsys.readouterr().err
    assert sorted(path.name for path in out.iterdir()) == ["flat.html", "index.html"]
    page = (out / "index.html").read_text()
    assert 'href="./flat.html"' in page
    assert "called like the index" in page
    assert "<b>2</b>rooms" in (out / "flat.html").read_text()


def test_a_folder_holds_vacuums_maps_beside_other_json(tmp_path):
    for name, value in (("a", {"pixelSize": 5, "layers": []}), ("b", {"anything": 1})):
        (tmp_path / f"{name}.json").write_text(json.dumps(value))
    assert [_may_be_map(tmp_path / f"{name}.json") for name in "ab"] == [True, False]


def test_a_drawing_is_a_ros_map_in_the_frame_of_its_map(draw, tmp_path):
    grid, floor, _ = painted(FLAT)
    moved = OccupancyGrid(grid.cells, grid.frame._replace(origin_x=7.0))
    write_ros_map(tmp_path / "flat", moved)
    assert draw("flat.yaml", formats="yaml")[0] == 0
    drawn = read_ros_map(tmp_path / "out" / "flat.yaml")
    assert set(np.unique(drawn.cells)) == {OCCUPIED, UNKNOWN, FREE}
    rows, cols = np.nonzero(drawn.cells == FREE)
    x, y = drawn.frame.to_point(rows, cols)
    there = moved.cells[moved.frame.to_cell(x, y)]
    assert (there == FREE).mean() > 0.97
    assert (drawn.cells == FREE).sum() * 0.05**2 == pytest.approx(floor.area, rel=0.05)
