"""``slamgym cad compare`` from files to files."""

import csv
import json
from pathlib import Path

import cv2
import drawn_flat as flat
import numpy as np
import pytest

from slamgym.cad import read_geojson
from slamgym.commands.cli import main
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN
from slamgym.interop import write_ros_map

FILES = ("comparison.csv", "comparison.html", "comparison.json", "comparison.png")


@pytest.fixture
def files(tmp_path):
    """The flat as GeoJSON and DXF, and a ROS map of it in which the wall between the rooms stands 0.3 m further."""
    (tmp_path / "flat.geojson").write_text(flat.geojson_text())
    (tmp_path / "flat.dxf").write_text(flat.dxf(unit=""))
    document = flat.geojson()
    document["features"] = [f for f in document["features"] if f["properties"]["kind"] != "room"]
    shifted = [flat.ring(box) for box in flat.bodies(door_x=4.3)]
    walls = [f for f in document["features"] if f["properties"]["kind"] == "wall"]
    for feature, ring in zip(walls, shifted, strict=True):
        feature["geometry"]["coordinates"] = [ring]
    doors = [f for f in document["features"] if f["properties"]["kind"] == "door"]
    doors[0]["geometry"]["coordinates"] = [[4.3, 1.0], [4.3, 1.9]]
    (tmp_path / "built.geojson").write_text(json.dumps(document))
    plan = read_geojson(tmp_path / "built.geojson")
    write_ros_map(tmp_path / "built", plan.raster(0.05, outside=UNKNOWN, wall_thickness=0.05))
    return tmp_path


@pytest.mark.parametrize("plan", ["flat.geojson", "flat.dxf"])
def test_a_moved_wall_is_reported(files, capsys, plan):
    out = files / "out"
    assert (
        main(["cad", "compare", str(files / plan), str(files / "built.yaml"), "-o", str(out)]) == 0
    )
    shown = capsys.readouterr()
    assert "wall moved" in shown.out
    assert ("millimetres" in shown.err) == plan.endswith("dxf")
    assert sorted(path.name for path in out.iterdir()) == list(FILES)
    document = json.loads((out / "comparison.json").read_text())
    assert document["confident"]
    rows = list(csv.DictReader((out / "comparison.csv").read_text().splitlines()))
    assert len(rows) == len(document["changes"])
    moved = [row for row in rows if row["kind"] == "wall_moved"]
    assert moved
    assert all(abs(float(row["offset_cm"])) == pytest.approx(30, abs=3) for row in moved)
    picture = cv2.imread(str(out / "comparison.png"))
    assert picture.shape[0] > 500
    page = (out / "comparison.html").read_text()
    assert "<script" not in page
    assert "://" not in page
    assert all(row["what"] in page for row in rows)
    assert f"slamgym cad compare {files / plan}" in page


def test_a_map_compared_with_itself_has_no_changes(tmp_path):
    """Its outline is that of the floor that was seen: where that ends in the open, a wall may stand further back."""
    robot_map = str(Path(__file__).parents[2] / "docs" / "images" / "robot_map.yaml")
    assert main(["cad", "compare", robot_map, robot_map, "-o", str(tmp_path / "out")]) == 0
    document = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert document["changes"] == []


def test_another_building_gives_another_exit_code(files, capsys):
    image = np.full((300, 300), UNKNOWN, np.uint8)
    image[20:280, 130:170] = FREE
    image[130:170, 20:280] = FREE
    walls = (cv2.dilate((image == FREE).astype(np.uint8), np.ones((3, 3))) > 0) & (image != FREE)
    image[walls] = OCCUPIED
    cv2.imwrite(str(files / "cross.png"), image)
    out = files / "out"
    arguments = [
        "cad",
        "compare",
        str(files / "flat.geojson"),
        str(files / "cross.png"),
        "-o",
        str(out),
    ]
    assert main([*arguments, "--resolution", "0.05"]) == 1
    assert "different buildings" in capsys.readouterr().err
    document = json.loads((out / "comparison.json").read_text())
    assert (document["confident"], document["changes"]) == (False, [])
    page = (out / "comparison.html").read_text()
    assert "NOT THE SAME BUILDING" in page
    assert "as planned" not in page.split("</style>")[1].split('<ul class="legend">')[0]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["no.dxf", "built.yaml"], "no.dxf"),
        (["flat.geojson", "no.yaml"], "no.yaml"),
        (["built.yaml", "flat.geojson"], "name it before built.yaml"),
        (["flat.geojson", "built.pgm", "--resolution", "0"], "--resolution"),
        (["flat.geojson", "built.yaml", "--layers", "A"], "--layers needs a DXF"),
        (["flat.geojson", "built.yaml", "--storey", "Attic"], "Attic"),
    ],
)
def test_what_is_wrong_is_said_in_a_sentence(files, capsys, monkeypatch, arguments, sentence):
    monkeypatch.chdir(files)
    assert main(["cad", "compare", *arguments, "-o", "out"]) == 2
    error = capsys.readouterr().err
    assert sentence in error
    assert error.count("\n") == 1
    assert not (files / "out").exists()
