"""What files and plans are called steers no terminal and breaks no file that is written."""

import os
import re
import sys
import xml.etree.ElementTree as ET

import cv2
import numpy as np
import pytest
from shapely import box

from slamgym.cad import FloorPlan
from slamgym.cad.houseexpo import format_houseexpo, read_houseexpo
from slamgym.commands import cli, frame
from slamgym.core.text import printable
from slamgym.interop.ros_map import read_ros_map

NAMES = {
    "no UTF-8": os.fsdecode(b"caf\xe9"),
    "control": "a\x1b[31mred\a",
    "line end": "a\nslamgym: error: b",
    "direction": "a\u202egnp",
    "markup": "a<b>&\"'c: # d",
}
COMMANDS = {
    "cad": ["cad", "{map}", "--resolution", "0.05", "--model", "none", "-o", "{out}", "--formats",
            "dxf,svg,geojson,json,png,html,yaml"],
    "cad of a folder": ["cad", "{folder}", "--resolution", "0.05", "--model", "none", "-o", "{out}"],
    "cad of no map": ["cad", "{plan}", "--model", "none", "-o", "{out}"],
    "plans list": ["plans", "list", "{plan}"],
    "plans check": ["plans", "check", "{folder}", "--rejected", "{out}/rejected.jsonl"],
    "plans draw": ["plans", "draw", "{plan}", "--out", "{out}/plans.png"],
    "slam": ["slam", "{folder}/none.log", "-o", "{out}"],
    "dataset show": ["dataset", "show", "{folder}", "-o", "{out}/sheet.png"],
}  # fmt: skip


def make_files(folder, name):
    """A map of two rooms and a plan of the name, in a folder of the name."""
    cells = np.full((90, 120), 205, np.uint8)
    cells[10:80, 10:110] = 254
    cells[8:11, 8:112] = cells[79:82, 8:112] = cells[8:82, 8:11] = cells[8:82, 109:112] = 0
    cells[8:40, 58:61] = cells[55:82, 58:61] = 0
    folder.mkdir()
    (folder / f"{name}.png").write_bytes(cv2.imencode(".png", cells)[1].tobytes())
    (folder / f"{name}.json").write_text(format_houseexpo(FloorPlan("x", box(0, 0, 4, 3))))
    (folder / f"{name} closed.json").write_text(format_houseexpo(FloorPlan("y", box(0, 0, 4, 0.2))))


@pytest.mark.skipif(sys.platform != "linux", reason="other systems forbid such names")
@pytest.mark.parametrize("name", NAMES.values(), ids=NAMES)
def test_strange_names_cost_no_traceback_and_are_shown_in_one_line(tmp_path, capsysbinary, name):
    folder = tmp_path / name
    out = tmp_path / f"out {name}"
    make_files(folder, name)
    places = {
        "folder": folder,
        "out": out,
        "map": folder / f"{name}.png",
        "plan": folder / f"{name}.json",
    }
    for command, words in COMMANDS.items():
        assert cli.main([word.format(**places) for word in words]) in (0, 1, 2), command
        shown, errors = capsysbinary.readouterr()
        lines = (shown + errors).decode().split("\n")
        assert all(line.isprintable() for line in lines), command
        assert sum(line.startswith("slamgym: error") for line in lines) <= 1, command
    ET.parse(out / f"{name}.svg")
    for page in (out / f"{name}.html", out / "index.html"):
        if page.exists():
            assert all(line.isprintable() for line in page.read_text().splitlines())
    assert read_ros_map(out / f"{name}.yaml").cells.any()
    assert read_houseexpo(out / f"{name}.json").area > 10.0


def test_what_cannot_be_seen_is_written_out():
    assert [printable(name) for name in NAMES.values()] == [
        "caf\\udce9", "a\\x1b[31mred\\x07", "a\\nslamgym: error: b", "a\\u202egnp", NAMES["markup"],
    ]  # fmt: skip


def test_cad_draws_without_torch(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.setattr(frame, "is_installed", lambda package: package != "torch")
    picture = tmp_path / "map.png"
    room = np.full((160, 160), 205, np.uint8)
    room[20:140, 20:140] = 0
    room[22:138, 22:138] = 254
    cv2.imwrite(str(picture), room)
    out = tmp_path / "out"
    typed = ["cad", str(picture), "--resolution", "0.05", "-o", str(out), "--formats", "json"]
    assert cli.main(typed) == 0
    assert (out / "map.json").is_file()


def test_cad_without_torch_names_the_network_that_needs_none(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(frame, "is_installed", lambda package: package != "torch")
    picture = tmp_path / "map.png"
    cv2.imwrite(str(picture), np.full((80, 80), 255, np.uint8))
    typed = ["cad", str(picture), "--resolution", "0.05", "-o", str(tmp_path / "out")]
    assert cli.main([*typed, "--model", "own.safetensors"]) == 2
    error = capsys.readouterr().err
    assert re.search(r"'torch'.*slamgym\[gan\].*--model slam2cad", error)
