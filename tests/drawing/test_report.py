"""The report of a drawing: whole in itself, with the drawing's own figures, and with what to check."""

import base64
import dataclasses
import json
import re
import xml.etree.ElementTree as ET

import cv2
import numpy as np
import pytest
from drawing.painted import FLAT, painted

from slamgym.core.types import OCCUPIED
from slamgym.drawing import make_drawing
from slamgym.drawing.formats.html import checks, format_html, format_index


@pytest.fixture(scope="module")
def drawing():
    grid, _, model = painted(FLAT)
    provenance = {"source": "maps/flat <1>.yaml", "command": "slamgym cad 'maps/flat <1>.yaml'"}
    return make_drawing(grid, "flat <1>", model, provenance=provenance)


@pytest.fixture(scope="module")
def page(drawing):
    return format_html(drawing)


def test_the_page_is_whole_in_itself(page):
    assert "://" not in page
    assert not re.search(r"url\(|@import|fetch\(|XMLHttpRequest|import\(", page)
    assert re.findall(r'(?:src|href)="(?!data:image/webp;base64,)', page) == []
    assert (
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
        in page
    )


def test_names_from_outside_are_text(page):
    assert "flat <1>" not in page
    assert "flat &lt;1&gt;" in page


def test_names_cannot_end_the_script(drawing):
    rooms = [dataclasses.replace(room, name="</script><b>$name") for room in drawing.rooms]
    page = format_html(dataclasses.replace(drawing, rooms=tuple(rooms)))
    assert "<b>$name" not in page
    data = re.search(r'<script type="application/json" id="data">(.*?)</script>', page)[1]
    assert [room["name"] for room in json.loads(data)["rooms"]] == [room.name for room in rooms]


def test_its_tables_hold_the_figures_of_the_drawing(drawing, page):
    cells = re.findall(r"<td[^>]*>([^<]*)", page)
    for room in drawing.rooms:
        assert f"{room.area:.2f} m²" in cells
    assert f"{drawing.doors[0].width:.2f} m" in cells
    assert cells.count("R01 and R02") + cells.count("R02 and R01") == 1
    assert "slamgym cad &#x27;maps/flat &lt;1&gt;.yaml&#x27;" in page


def test_figures_are_true_to_scale_on_paper(drawing, page):
    figures = [ET.fromstring(text) for text in re.findall(r"<svg.*?</svg>", page, re.DOTALL)]
    assert len(figures) == 2
    for root in figures:
        paper = float(re.search(r"--paper: ([0-9.]+)mm", root.get("style"))[1])
        width, height = (float(value) for value in root.get("viewBox").split()[2:])
        texts = root.findall(".//text")
        scale = int(re.search(r"1:(\d+) on A4", texts[-1].text)[1])
        assert width / paper == pytest.approx(scale, rel=2e-3)
        assert paper <= 180.0
        assert height / scale <= 160.0
        _, left, right, _ = root.find(".//path[@class='bar']").get("d").split()
        bar = float(right.split(",")[0]) - float(left.split(",")[0])
        assert f"{bar / 1000:g} m " in texts[-1].text
    shown = {text.text for text in figures[0].iter("text")}
    assert {f"{line.length:.2f}" for line in drawing.dimensions if line.of == "building"} <= shown


def test_the_map_is_in_it_cell_by_cell(drawing, page):
    data = base64.b64decode(re.search(r'href="data:image/webp;base64,([^"]*)', page)[1])
    cells = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert all(
        np.array_equal(channel, drawing.grid.cells)
        for channel in np.atleast_3d(cells).transpose(2, 0, 1)
    )
    assert (cells == OCCUPIED).any()


def test_what_to_check_is_said(drawing):
    assert "No doubt was found" in format_html(drawing)
    unseen = dataclasses.replace(drawing.rooms[0], share_seen=0.2, layer="INFERRED")
    closed = dataclasses.replace(drawing.doors[0], layer="INFERRED")
    worse = dataclasses.replace(
        drawing,
        rooms=(unseen, *drawing.rooms[1:]),
        doors=(closed,),
        doubts=("scale doubtful: say so",),
    )
    found = checks(worse)
    for text in ("Scale doubtful", f"{unseen.id} (20%)", "D1"):
        assert any(text in sentence for sentence in found), text
    shown = format_html(worse)
    assert all(sentence.replace("'", "&#x27;") in shown for sentence in found)


def test_a_drawing_without_doors_is_reported_too(drawing):
    assert "No door was found" in format_html(dataclasses.replace(drawing, doors=()))


def test_the_index_shows_the_most_doubtful_first():
    reports = [("flat <1>", []), ("zeta & co", ["Direction doubtful."])]
    page = format_index("homes", reports, ["broken.yaml: is <no> map"], "slamgym cad homes")
    assert page.index("zeta &amp; co") < page.index("flat &lt;1&gt;")
    assert 'href="./zeta%20%26%20co.html"' in page
    assert "is &lt;no&gt; map" in page
    assert "Direction doubtful." in page
    assert "1 of them with something to check, 1 refused" in page
