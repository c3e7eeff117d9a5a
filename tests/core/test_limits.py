"""Hostile files cost a sentence: each is read in a process of its own, whose CPU time and memory are measured."""

import os
import re
import stat
import sys
from pathlib import Path

import attacks
import cv2
import numpy as np
import pytest

from slamgym.cad import open_plans
from slamgym.core.documents import parse_json, parse_yaml
from slamgym.core.errors import ConfigError, InputFileError, PlanError
from slamgym.core.files import read_bytes
from slamgym.core.limits import LIMITS, MAX_SHOWN, PIXELS, shown
from slamgym.core.pictures import decode_picture
from slamgym.interop import open_log, read_ros_map

PAGE = Path(__file__).parents[2] / "docs" / "limits.md"

ATTACKS = {
    "aliases": ("map", attacks.aliases, "aliases are not allowed"),
    "aliases in a recipe": ("recipe", attacks.aliased_recipe, "aliases are not allowed"),
    "crossings": ("plans", attacks.random_outline, "SLAMGYM_MAX_NEAR_PAIRS"),
    "jagged": ("plans", attacks.jagged_outline, "SLAMGYM_MAX_VERTICES"),
    "comb": ("plans", attacks.comb, "SLAMGYM_MAX_NEAR_PAIRS"),
    "holes": ("plans", attacks.holes, "SLAMGYM_MAX_DOCUMENT_BYTES"),
    "fewer holes": ("plans", lambda folder: attacks.holes(folder, 20_000), "SLAMGYM_MAX_PARTS"),
    "archive": (
        "plans",
        lambda folder: attacks.archive_bomb(folder, 1 << 26, 16),
        "SLAMGYM_MAX_EXPANSION",
    ),
    "plan of an archive": (
        "plans",
        lambda folder: attacks.archive_bomb(folder, 1 << 26),
        "MAX_DOCUMENT_BYTES",
    ),
    "xz": ("plans", attacks.xz_bomb, "SLAMGYM_MAX_EXPANSION"),
    "log": ("log", attacks.log_bomb, "SLAMGYM_MAX_EXPANSION"),
    "picture": ("map", lambda folder: attacks.picture_bomb(folder, 12_000), "SLAMGYM_MAX_PIXELS"),
    "passes": ("picture", attacks.jpeg_of_passes, "in more than 100 passes"),
    "fields": ("picture", attacks.tiff_of_one_field, "fields that are larger than the file"),
    "tile": ("picture", attacks.tiff_of_one_tile, "SLAMGYM_MAX_PIXELS"),
    "profiles": ("picture", attacks.png_of_profiles, "several colour profiles"),
    "runs": ("any map", attacks.vacuum_of_runs, "SLAMGYM_MAX_PIXELS"),
    "runs in layers": (
        "any map",
        lambda folder: attacks.vacuum_of_runs(folder, 10),
        "SLAMGYM_MAX_PIXELS",
    ),
    "segments": ("any map", attacks.vacuum_of_segments, "SLAMGYM_MAX_PIXELS"),
    "texts": ("any map", attacks.vacuum_of_texts, "whole numbers in groups of 2"),
    "map in a picture": ("any map", attacks.vacuum_picture, "SLAMGYM_MAX_DOCUMENT_BYTES"),
    "endless line": ("dataset", attacks.endless_line, "SLAMGYM_MAX_DOCUMENT_BYTES"),
    "weights": ("weights", attacks.huge_weights, "SLAMGYM_MAX_WEIGHT_BYTES"),
    "device": ("map", attacks.device_as_image, "no regular file"),
}


@pytest.mark.skipif(sys.platform != "linux", reason="measures memory as Linux counts it")
@pytest.mark.parametrize("name", ATTACKS)
def test_a_hostile_file_costs_a_second_and_a_sentence(name, tmp_path):
    kind, make, words = ATTACKS[name]
    loops, megabytes, message = attacks.measure(kind, make(tmp_path))
    assert words in message
    assert len(message) < len(str(tmp_path)) + 250
    assert loops < attacks.MAX_LOOPS
    assert megabytes < attacks.MAX_MEGABYTES


def test_a_limit_can_be_raised_and_lowered(tmp_path, monkeypatch):
    cv2.imwrite(str(tmp_path / "a.png"), np.full((40, 50), 254, np.uint8))
    path = tmp_path / "a.yaml"
    path.write_text("image: a.png\nresolution: 1.0\norigin: [0, 0, 0]\n")
    monkeypatch.setenv("SLAMGYM_MAX_PIXELS", "1999")
    with pytest.raises(
        InputFileError, match=r"a\.png: has at least 2,000 pixels, above the limit of 1,999"
    ):
        read_ros_map(path)
    monkeypatch.setenv("SLAMGYM_MAX_PIXELS", "2000")
    assert read_ros_map(path).cells.shape == (40, 50)
    monkeypatch.setenv("SLAMGYM_MAX_PIXELS", "many")
    with pytest.raises(
        ConfigError, match="SLAMGYM_MAX_PIXELS must be a whole number above 0, not 'many'"
    ):
        read_ros_map(path)


def test_a_map_of_sixty_million_pixels_is_within_the_limits():
    encoded = b"P5\n10000 6000\n255\n" + b"\xfe" * 60_000_000
    assert decode_picture("a", encoded).shape == (6000, 10000)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".pgm", ".ppm", ".tif"])
@pytest.mark.parametrize("shape", [(7, 300), (301, 5, 3), (1, 1)])
def test_the_header_says_what_the_decoder_finds(suffix, shape, monkeypatch):
    if suffix in (".pgm", ".ppm"):
        shape = shape[:2] if suffix == ".pgm" else (*shape[:2], 3)
    pixels = np.random.default_rng(0).integers(0, 255, shape).astype(np.uint8)
    encoded = cv2.imencode(suffix, pixels)[1].tobytes()
    monkeypatch.setenv("SLAMGYM_MAX_PIXELS", str(shape[0] * shape[1]))
    assert decode_picture("a", encoded).shape[:2] == shape[:2]
    if suffix == ".png":
        assert (
            decode_picture("a", encoded) == (pixels[..., ::-1] if pixels.ndim == 3 else pixels)
        ).all()
    if shape[0] * shape[1] > 1:
        monkeypatch.setenv("SLAMGYM_MAX_PIXELS", str(shape[0] * shape[1] - 1))
        with pytest.raises(InputFileError, match="SLAMGYM_MAX_PIXELS"):
            decode_picture("a", encoded)


def test_no_picture_is_decoded_whose_size_is_unknown():
    for content in (b"", b"P5", b"\x89PNG\r\n\x1a\n", b"GIF89a" + b"\0" * 40, b"BM" + b"\0" * 10):
        with pytest.raises(InputFileError, match="is not a picture"):
            decode_picture("a", content)


def test_only_regular_files_are_read(tmp_path):
    pipe = tmp_path / "pipe.json"
    os.mkfifo(pipe)
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    for path in (pipe, Path("/dev/zero")):
        with pytest.raises(InputFileError, match="is no regular file"):
            read_bytes(path)
    with pytest.raises(PlanError, match="is no regular file"):
        open_plans(pipe).load("pipe")
    pipe.rename(tmp_path / "pipe.log")
    with pytest.raises(InputFileError, match="is no regular file"):
        open_log(tmp_path / "pipe.log")


@pytest.mark.parametrize(
    "value",
    [
        "x" * 10**7,
        [[["x"] * 100] * 100] * 100,
        10**5000,
        {"a": "b" * 1000},
        b"\0" * 1000,
        set(range(999)),
        1.5,
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_value_is_shown_in_one_short_line(value):
    text = shown(value)
    assert 0 < len(text) <= MAX_SHOWN
    assert "\n" not in text


def test_short_values_are_shown_as_they_are():
    assert [shown(value) for value in ("way", 3, None, [1, 2.5])] == [
        "'way'",
        "3",
        "None",
        "[1, 2.5]",
    ]


def test_documents_may_not_be_deep_or_long():
    with pytest.raises(InputFileError, match="SLAMGYM_MAX_DEPTH"):
        parse_json("[" * 50 + "]" * 50, "a")
    with pytest.raises(InputFileError, match="is not valid JSON"):
        parse_json("[" * 10**6, "a")
    with pytest.raises(InputFileError, match="SLAMGYM_MAX_YAML_BYTES"):
        parse_yaml("a: b\n" * 20_000, "a")
    with pytest.raises(InputFileError, match="a whole number of 400 digits"):
        parse_json("[" + "9" * 400 + "]", "a")
    for text in (
        f"a: {'9' * 400}",
        "a: 2000-13-45",
        "a: !!int ''",
        "a: [",
        "? [1]\n: 2",
        "a: !!python/name:os.system",
        "[" * 5000,
    ):
        with pytest.raises(InputFileError, match=r"is not valid yaml|SLAMGYM_MAX_DEPTH"):
            parse_yaml(text, "a")


def test_the_documentation_names_every_limit():
    rows = re.findall(r"\| `(SLAMGYM_MAX_\w+)` \| ([\d,]+) ([^|]+) \| ([^|]+) \|", PAGE.read_text())
    assert rows == [
        (limit.variable, f"{limit.default:,}", limit.unit, limit.of) for limit in LIMITS
    ]
    assert PIXELS in LIMITS
