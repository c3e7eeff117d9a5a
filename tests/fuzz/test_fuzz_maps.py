"""Whatever a ROS map, a recipe or a file of settings holds, reading it gives a value or a SlamgymError."""

import json
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import yaml
from fuzz.mutations import cases, must_read_or_refuse, mutated_bytes, mutated_json, mutated_value
from hypothesis import given
from hypothesis import strategies as st

from slamgym.cad import check_plan, open_plans
from slamgym.core.pictures import read_png
from slamgym.interop import read_map, read_ros_map

MAP = {
    "image": "a.png",
    "mode": "trinary",
    "resolution": 0.05,
    "origin": [-1.0, 2.0, 0.0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
}
ODD_YAML = st.sampled_from(
    [
        b"image: a.png\nresolution: 2000-13-45\n",
        b"resolution: !!int ''\n",
        b"resolution: !!float x\n",
        b"origin: &a [1, *a]\n",
        b"image: !!binary aGk\nresolution: !!timestamp a\n",
        b"? [1, 2]\n: a.png\n",
        b"<<: {image: a.png}\nresolution: 0x\n",
        b"resolution: 1:1:1:1:1:1\norigin: !!set {1, 2}\n",
        b"%YAML 9.9\n---\nimage: a\n...\n--- b",
        b"image: a.png\nresolution: .nan\norigin: .inf",
        b"- " * 2000,
        b"{" * 2000,
    ]
)


def pictures() -> list[bytes]:
    rng = np.random.default_rng(0)
    grey = rng.choice(np.array([0, 205, 254], np.uint8), (12, 9))
    colours = rng.integers(0, 255, (6, 8, 4), dtype=np.uint8)
    deep = rng.integers(0, 65535, (6, 8), dtype=np.uint16)
    pairs = [
        (".png", grey),
        (".pgm", grey),
        (".bmp", grey),
        (".tif", grey),
        (".png", colours),
        (".png", deep),
    ]
    return [cv2.imencode(suffix, image)[1].tobytes() for suffix, image in pairs]


PICTURES = pictures()
VACUUM = {
    "__class": "ValetudoMap",
    "metaData": {"version": 2},
    "size": {"x": 5120, "y": 5120},
    "pixelSize": 5,
    "layers": [
        {
            "type": "segment",
            "metaData": {"segmentId": "1", "name": "Hall"},
            "compressedPixels": [5, 5, 40, 5, 6, 40],
        },
        {"type": "floor", "metaData": {}, "pixels": [5, 7, 6, 7]},
        {"type": "wall", "metaData": {"area": 1}, "compressedPixels": [5, 4, 40]},
    ],
    "entities": [
        {"type": "path", "points": [10, 10, 20, 20]},
        {"type": "robot_position", "points": [10, 10]},
    ],
}


def vacuum_png() -> bytes:
    data = b"ValetudoMap\0\0" + zlib.compress(json.dumps(VACUUM).encode())
    chunk = (
        struct.pack(">I", len(data))
        + b"zTXt"
        + data
        + struct.pack(">I", zlib.crc32(b"zTXt" + data))
    )
    return PICTURES[0][:33] + chunk + PICTURES[0][33:]


def read_map_and_plan(path: Path) -> None:
    plans = open_plans(path)
    check_plan(plans.load(plans.ids[0]))


@given(
    st.one_of(
        mutated_value([MAP]).map(lambda value: yaml.safe_dump(value).encode()),
        ODD_YAML,
        st.binary(),
    )
)
@cases(80)
def test_descriptions(tmp_path, content):
    (tmp_path / "a.png").write_bytes(PICTURES[0])
    (tmp_path / "a.yaml").write_bytes(content)
    must_read_or_refuse(read_ros_map, tmp_path / "a.yaml")
    must_read_or_refuse(read_map_and_plan, tmp_path / "a.yaml")


@given(mutated_bytes([yaml.safe_dump(MAP).encode()]))
@cases(100)
def test_damaged_descriptions(tmp_path, content):
    (tmp_path / "a.png").write_bytes(PICTURES[0])
    (tmp_path / "a.yaml").write_bytes(content)
    must_read_or_refuse(read_ros_map, tmp_path / "a.yaml")
    must_read_or_refuse(read_map_and_plan, tmp_path / "a.yaml")


@given(mutated_bytes(PICTURES))
@cases(200)
def test_images(tmp_path, content):
    (tmp_path / "a.png").write_bytes(content)
    (tmp_path / "a.yaml").write_text(yaml.safe_dump(MAP))
    must_read_or_refuse(read_ros_map, tmp_path / "a.yaml")
    must_read_or_refuse(read_map_and_plan, tmp_path / "a.yaml")
    must_read_or_refuse(read_png, tmp_path / "a.png")


@given(mutated_json([VACUUM]))
@cases(200)
def test_maps_of_vacuums(tmp_path, content):
    (tmp_path / "a.json").write_bytes(content)
    must_read_or_refuse(read_map, tmp_path / "a.json")


@given(mutated_bytes([vacuum_png()]))
@cases(100)
def test_pictures_with_maps_of_vacuums(tmp_path, content):
    (tmp_path / "a.png").write_bytes(content)
    must_read_or_refuse(read_map, tmp_path / "a.png")
