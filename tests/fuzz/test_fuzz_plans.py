"""Whatever a file of floor plans holds, reading and checking it gives plans or a SlamgymError."""

import io
import json
import lzma
import tarfile

import cv2
import numpy as np
from fuzz.mutations import must_read_or_refuse, mutated_bytes, mutated_json
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.cad import check_plan, open_plans

PLAN = {
    "verts": [[0, 0], [8, 0], [8, 3], [5, 3], [5, 6], [0, 6]],
    "id": "a",
    "room_num": 1,
    "bbox": {"min": [0, 0], "max": [8, 6]},
    "room_category": {"Kitchen": [[0, 0, 4, 3]], "Hall": [[4, 0, 8, 3]]},
    "holes": [[[1, 1], [2, 1], [2, 2]]],
    "doors": [[[4, 1], [4, 2]]],
    "room_polygons": {"Kitchen": [[[[0, 0], [4, 0], [4, 3]], [[1, 1], [2, 1], [2, 2]]]]},
}
BOW_TIE = {"verts": [[0, 0], [8, 6], [8, 0], [0, 6]], "id": "b", "room_category": {}}
WALLS = [
    [0, 0, 50, 0, "WALL", "NORMAL"],
    [50, 0, 50, 20, "WALL", "NORMAL"],
    [50, 20, 50, 20, "PORTAL", "NORMAL"],
]
FLOOR = {
    "name": "school",
    "m_per_px": 0.1,
    "rooms": [
        {"label": "BIG OFFICE", "polygon": [[0, 0], [50, 0], [50, 20], [0, 20]], "segments": WALLS},
        {"label": "HALL", "polygon": [[50, 0], [99, 0], [99, 40], [50, 40]], "segments": WALLS},
    ],
}


def check_all(spec: str) -> None:
    source = open_plans(spec)
    for plan_id in source.ids:
        check_plan(source.load(plan_id))


def archive(content: bytes, suffix: str) -> bytes:
    file = io.BytesIO()
    with tarfile.open(fileobj=file, mode=f"w:{suffix}") as tar:
        for name in ("json/a.json", "json/b.json"):
            info = tarfile.TarInfo(name)
            info.size = len(content)
            tar.addfile(info, io.BytesIO(content))
    return file.getvalue()


def picture(suffix: str) -> bytes:
    image = np.zeros((24, 30), np.uint8)
    image[2:20, 3:25] = 255
    return cv2.imencode(suffix, image)[1].tobytes()


TEXT = json.dumps(PLAN).encode()
ARCHIVES = [archive(TEXT, "gz"), archive(TEXT, "xz"), archive(TEXT, "")]
PICTURES = [picture(suffix) for suffix in (".png", ".pgm", ".bmp", ".jpg", ".tif")]


@given(mutated_json([PLAN, BOW_TIE]))
@settings(max_examples=200)
def test_plans(tmp_path, content):
    path = tmp_path / "a.json"
    path.write_bytes(content)
    must_read_or_refuse(check_all, str(path))


@given(mutated_bytes(ARCHIVES))
@settings(max_examples=60)
def test_archives(tmp_path, content):
    path = tmp_path / "a.tar.gz"
    path.write_bytes(content)
    must_read_or_refuse(check_all, str(path))


@given(mutated_json([FLOOR]), st.booleans())
@settings(max_examples=100)
def test_floors_as_rooms(tmp_path, content, compressed):
    path = tmp_path / ("a.jsonl.xz" if compressed else "a.jsonl")
    path.write_bytes(lzma.compress(content, preset=0) if compressed else content)
    must_read_or_refuse(check_all, str(path))


@given(mutated_bytes([lzma.compress(json.dumps(FLOOR).encode(), preset=0)]))
@settings(max_examples=40)
def test_damaged_compression(tmp_path, content):
    path = tmp_path / "a.jsonl.xz"
    path.write_bytes(content)
    must_read_or_refuse(check_all, str(path))


@given(mutated_bytes(PICTURES))
@settings(max_examples=100)
def test_pictures(tmp_path, content):
    path = tmp_path / "a.png"
    path.write_bytes(content)
    must_read_or_refuse(check_all, f"{path}@0.25")


@given(mutated_bytes([b"a\nb.json\n\nc"]))
@settings(max_examples=20)
def test_files_of_ids(tmp_path, content):
    path = tmp_path / "ids.txt"
    path.write_bytes(content)
    must_read_or_refuse(open_plans, "bundled", path)
