"""A person's map of any kind, and what is no map."""

import json
import struct
import zlib

import cv2
import numpy as np
import pytest

from slamgym.core.errors import InputFileError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN
from slamgym.interop import open_log, read_map

YAML = "image: {image}\nresolution: {resolution}\norigin: [0, 0, 0]\nnegate: {negate}\n" + (
    "occupied_thresh: 0.65\nfree_thresh: 0.25\n"
)


def picture(unknown=205):
    """A free room of 2 x 1 m with walls, and unknown cells around it; 5 cm cells."""
    image = np.full((30, 50), unknown, np.uint8)
    image[4:26, 4:46] = 0
    image[5:25, 5:45] = 254
    return image


def valetudo(version=2, **changes):
    """The same room: two segments and walls."""
    rows = range(105, 125)
    cells = {
        "Kitchen": [(x, y) for y in rows for x in range(205, 225)],
        "7": [(x, y) for y in rows for x in range(225, 245)],
        "wall": [
            (x, y)
            for y in range(104, 126)
            for x in range(204, 246)
            if y in (104, 125) or x in (204, 245)
        ],
    }
    layers = []
    for name, pixels in cells.items():
        about = (
            {"area": 1, "segmentId": "7"}
            if name != "Kitchen"
            else {"segmentId": "6", "name": "Kitchen"}
        )
        flat = [n for pixel in pixels for n in pixel]
        runs = [n for x, y in pixels for n in (x, y, 1)]
        layers.append(
            {
                "__class": "MapLayer",
                "type": "wall" if name == "wall" else "segment",
                "metaData": about,
                "pixels": flat if version == 1 else [],
                **({"compressedPixels": runs} if version == 2 else {}),
            }
        )
    entities = [
        {"type": "robot_position", "points": [1100, 550], "metaData": {"angle": 90}},
        {"type": "path", "points": [1100, 550, 1150, 550]},
        {"type": "virtual_wall", "points": [0, 0, 1, 1]},
    ]
    return {
        "__class": "ValetudoMap",
        "metaData": {"version": version},
        "size": {"x": 5120, "y": 5120},
        "pixelSize": 5,
        "layers": layers,
        "entities": entities,
        **changes,
    }


def check_room(grid):
    rows, cols = np.nonzero(grid.cells == FREE)
    assert (np.ptp(rows) + 1, np.ptp(cols) + 1, len(rows)) == (20, 40, 800)
    assert (grid.cells == OCCUPIED).sum() == 22 * 42 - 800
    assert grid.frame.resolution == pytest.approx(0.05)


@pytest.mark.parametrize("unknown", [205, 128, 127, 220])
@pytest.mark.parametrize("negate", [0, 1])
@pytest.mark.parametrize("channels", [1, 3, 4, 16])
def test_ros_maps_of_any_greys(tmp_path, unknown, negate, channels):
    image = 255 - picture(unknown) if negate else picture(unknown)
    if channels == 16:
        image = image.astype(np.uint16) * 257
    elif channels > 1:
        image = np.repeat(image[:, :, None], channels, axis=2)
        if channels == 4:
            image[:, :, 3] = 255
    cv2.imwrite(str(tmp_path / "m.png"), image)
    (tmp_path / "m.yaml").write_text(YAML.format(image="m.png", resolution=0.05, negate=negate))
    for name in ("m.yaml", "m.png", "."):
        found = read_map(tmp_path / name)
        check_room(found.grid)
        assert found.doubts == ()


def test_probabilities_and_raw_values(tmp_path):
    image = picture(128)
    image[10:20, 10:30] = np.random.default_rng(0).integers(200, 254, (10, 20))
    image[4, 4:46] = 30
    cv2.imwrite(str(tmp_path / "p.pgm"), image)
    (tmp_path / "p.yaml").write_text(
        "mode: scale\n" + YAML.format(image="p.pgm", resolution=0.05, negate=0)
    )
    check_room(read_map(tmp_path / "p.yaml").grid)
    raw = np.select([picture() == 0, picture() == 254], [100, 0], 255).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "r.pgm"), raw)
    (tmp_path / "r.yaml").write_text(
        "mode: raw\n" + YAML.format(image="r.pgm", resolution=0.05, negate=0)
    )
    check_room(read_map(tmp_path / "r.yaml").grid)


@pytest.mark.parametrize("version", [1, 2])
def test_valetudo(tmp_path, version):
    path = tmp_path / "vacuum.json"
    path.write_text(json.dumps(valetudo(version)))
    found = read_map(path)
    check_room(found.grid)
    assert [(segment.name, int(segment.cells.sum())) for segment in found.segments] == [
        ("Kitchen", 400),
        ("7", 400),
    ]
    row, col = np.nonzero(found.segments[0].cells)
    x, y = found.grid.frame.to_point(row, col)
    assert x.mean() == pytest.approx(10.75)
    assert y.mean() == pytest.approx(51.2 - 5.75)
    assert not (found.grid.cells == UNKNOWN).any()


def test_runs_of_valetudo_are_expanded(tmp_path):
    layers = [
        {"type": "floor", "metaData": {}, "compressedPixels": [10, 5, 30, 10, 6, 30]},
        {"type": "wall", "metaData": {}, "compressedPixels": [10, 7, 4]},
        {"type": "carpet", "compressedPixels": [0, 0, 1]},
    ]
    path = tmp_path / "vacuum.json"
    path.write_text(json.dumps(valetudo(layers=layers, pixelSize=10)))
    cells = read_map(path).grid.cells
    assert cells.tolist() == [[FREE] * 30] * 2 + [[OCCUPIED] * 4 + [UNKNOWN] * 26]


def test_valetudo_in_a_png(tmp_path):
    png = cv2.imencode(".png", picture())[1].tobytes()
    data = b"ValetudoMap\0\0" + zlib.compress(json.dumps(valetudo()).encode())
    chunk = (
        struct.pack(">I", len(data))
        + b"zTXt"
        + data
        + struct.pack(">I", zlib.crc32(b"zTXt" + data))
    )
    path = tmp_path / "card.png"
    path.write_bytes(png[:33] + chunk + png[33:])
    found = read_map(path)
    check_room(found.grid)
    assert len(found.segments) == 2
    with pytest.raises(InputFileError, match="says itself"):
        read_map(path, resolution=0.05)


def test_a_bare_picture_needs_its_scale(tmp_path):
    path = tmp_path / "bare.png"
    cv2.imwrite(str(path), picture())
    check_room(read_map(path, resolution=0.05).grid)
    with pytest.raises(InputFileError, match="metres per pixel"):
        read_map(path)
    for bad in (0.0, -0.05, float("nan"), 1e9):
        with pytest.raises(InputFileError, match="resolution"):
            read_map(path, resolution=bad)


@pytest.mark.parametrize(
    ("image", "sentence"),
    [
        (np.full((20, 20), 205, np.uint8), "none of its cells is free"),
        (np.full((20, 20), 254, np.uint8), "none of its cells is occupied"),
        (np.full((1, 1), 254, np.uint8), "none of its cells is occupied"),
        (np.full((1, 1), 0, np.uint8), "none of its cells is free"),
        (np.array([[0, 254]], np.uint8), "has 1 free cells"),
    ],
)
def test_what_is_no_map(tmp_path, image, sentence):
    cv2.imwrite(str(tmp_path / "m.png"), image)
    (tmp_path / "m.yaml").write_text(YAML.format(image="m.png", resolution=0.05, negate=0))
    with pytest.raises(InputFileError, match=sentence):
        read_map(tmp_path / "m.yaml")


def test_a_huge_picture_is_refused_before_it_is_decoded(tmp_path):
    (tmp_path / "m.pgm").write_bytes(b"P5\n30000 30000\n255\n")
    (tmp_path / "m.yaml").write_text(YAML.format(image="m.pgm", resolution=0.05, negate=0))
    with pytest.raises(InputFileError, match="SLAMGYM_MAX_PIXELS"):
        read_map(tmp_path / "m.yaml")


@pytest.mark.parametrize("resolution", [2.0, 0.001])
def test_a_scale_that_can_hardly_be_is_doubted(tmp_path, resolution):
    cv2.imwrite(str(tmp_path / "m.png"), picture())
    (tmp_path / "m.yaml").write_text(YAML.format(image="m.png", resolution=resolution, negate=0))
    assert "scale doubtful" in read_map(tmp_path / "m.yaml").doubts[0]


@pytest.mark.parametrize("resolution", ["0", "-0.05", "", "x"])
def test_a_resolution_that_is_none_is_refused(tmp_path, resolution):
    cv2.imwrite(str(tmp_path / "m.png"), picture())
    (tmp_path / "m.yaml").write_text(YAML.format(image="m.png", resolution=resolution, negate=0))
    with pytest.raises(InputFileError, match="resolution"):
        read_map(tmp_path / "m.yaml")


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"pixelSize": 0}, "pixelSize"),
        ({"pixelSize": -5}, "pixelSize"),
        ({"layers": []}, "no pixels"),
        ({"layers": [{"type": "floor", "compressedPixels": [0, 0]}]}, "groups of 3"),
        ({"layers": [{"type": "floor", "compressedPixels": [0, 0, -1]}]}, "negative length"),
        (
            {"layers": [{"type": "floor", "compressedPixels": [0, 0, 1, 900000, 900000, 1]}]},
            "MAX_PIXELS",
        ),
        ({"layers": [{"type": "floor", "compressedPixels": [0, 0, 900000] * 200}]}, "MAX_PIXELS"),
        ({"size": [1]}, "none"),
        ({"size": {"y": "x"}}, "size"),
        ({"layers": [7]}, "list of objects"),
    ],
)
def test_damaged_vacuum_maps(tmp_path, changes, sentence):
    path = tmp_path / "vacuum.json"
    path.write_text(json.dumps(valetudo(**changes)))
    if sentence == "none":
        check_room(read_map(path).grid)
    else:
        with pytest.raises(InputFileError, match=sentence):
            read_map(path)


@pytest.mark.parametrize("name", ["a.pbstream", "a.txt"])
def test_other_files_are_refused_with_what_to_do(tmp_path, name):
    (tmp_path / name).write_text("x")
    with pytest.raises(InputFileError, match="give"):
        read_map(tmp_path / name)


@pytest.mark.parametrize("name", ["map.png", "map.yaml", "map.json"])
def test_a_map_is_named_where_a_log_is_wanted(tmp_path, name):
    (tmp_path / name).write_bytes(b"P5 1 1 255 x")
    with pytest.raises(InputFileError, match="log of scans"):
        open_log(tmp_path / name)
