"""Maps as they come: pictures and descriptions of every kind that map_server and nav2 know, read or refused.

The rules are theirs: occupied where (255 - grey) / 255 is above ``occupied_thresh``, free where it is below
``free_thresh``; colours are averaged, a PGM's maxval is its white.
"""

import io

import cv2
import numpy as np
import pytest
from PIL import Image, PngImagePlugin

from slamgym.core.errors import InputFileError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN
from slamgym.interop import read_ros_map
from slamgym.interop.ros_map import read_turned_map

ROOM = np.full((20, 30), 205, np.uint8)
ROOM[3:15, 4:26] = 0
ROOM[4:14, 5:25] = 254
CELLS = np.select([ROOM == 0, ROOM == 254], [OCCUPIED, FREE], UNKNOWN)
DEEP = ROOM.astype(np.uint16) * 257
PALE = np.where(ROOM == 0, UNKNOWN, CELLS)
TWO = np.where(ROOM == 205, 0, ROOM)
RAW = np.select([ROOM == 0, ROOM == 254], [100, 0], 255).astype(np.uint8)
YAML = {
    "image": "a.pgm",
    "resolution": "0.05",
    "origin": "[-1.0, 2.0, 0.0]",
    "negate": "0",
    "occupied_thresh": "0.65",
    "free_thresh": "0.196",
}


def netpbm(kind, pixels, white=255, head="{kind}\n{w} {h}\n{white}\n", end=b""):
    rows, cols = pixels.shape[:2]
    text = head.format(kind=kind, w=cols, h=rows, white=white).encode()
    if kind in ("P1", "P2", "P3"):
        return text + b" ".join(b"%d" % value for value in pixels.ravel().tolist()) + end
    return text + pixels.astype(">u2" if white > 255 else "u1").tobytes() + end


def scaled(white, pixels=ROOM):
    """Greys of 255 as greys of another white."""
    return np.rint(pixels * (white / 255.0)).astype(int)


def saved(mode="L", pixels=ROOM, kind="PNG", **options):
    """By Pillow."""
    file = io.BytesIO()
    Image.fromarray(pixels).convert(mode).save(file, kind, **options)
    return file.getvalue()


def with_alpha(mode="RGBA"):
    """White where the room's surroundings are, and transparent there."""
    alpha = np.where(ROOM == 205, 0, 255).astype(np.uint8)
    grey = np.where(ROOM == 205, 255, ROOM).astype(np.uint8)
    file = io.BytesIO()
    channels = [grey] * (len(mode) - 1)
    Image.merge(mode, [Image.fromarray(one) for one in (*channels, alpha)]).save(file, "PNG")
    return file.getvalue()


def palette():
    """Three colours, of which one is transparent."""
    image = Image.fromarray(np.select([ROOM == 0, ROOM == 254], [0, 1], 2).astype(np.uint8))
    image.putpalette([0, 0, 0, 254, 254, 254, 9, 9, 9])
    file = io.BytesIO()
    image.save(file, "PNG", transparency=2)
    return file.getvalue()


def several(kind):
    image = Image.fromarray(ROOM)
    file = io.BytesIO()
    image.save(file, kind, save_all=True, append_images=[Image.fromarray(255 - ROOM)])
    return file.getvalue()


def with_text(size):
    info = PngImagePlugin.PngInfo()
    info.add_text("made", "x" * size)
    return saved(pnginfo=info)


def turned(kind):
    """A picture that says it lies on its side, which map_server doesn't heed."""
    exif = Image.Exif()
    exif[0x112] = 6
    return saved(kind=kind, exif=exif, quality=95)


P5 = netpbm("P5", ROOM)
COLOURS = np.where((ROOM == 254)[:, :, None], np.array([234, 254, 214], np.uint8), ROOM[:, :, None])
READ = {
    "P5": P5,
    "P5 with spaces": netpbm("P5", ROOM, head="{kind} {w} {h} {white}\n"),
    "P5 with CRLF": netpbm("P5", ROOM, head="{kind}\r\n{w} {h}\r\n{white}\n"),
    "P5 with comments": netpbm("P5", ROOM, head="{kind}\n# CREATOR: map_saver 0.050 m/pix\n{w} {h}\n{white}\n"),
    "P5 with comments in lines": netpbm("P5", ROOM, head="{kind} {w} # wide\n{h}\n#\n{white}\n"),
    "P5 with a long comment": netpbm("P5", ROOM, head="{kind}\n#" + "x" * 200_000 + "\n{w} {h}\n{white}\n"),
    "P5 with a last line end": P5 + b"\n",
    "P5 of maxval 100": netpbm("P5", scaled(100), 100),
    "P5 of maxval 254": netpbm("P5", np.minimum(ROOM, 254), 254),
    "P5 of maxval 1000": netpbm("P5", scaled(1000), 1000),
    "P5 of maxval 65535": netpbm("P5", DEEP, 65535),
    "P2": netpbm("P2", ROOM, end=b"\n"),
    "P2 without a last line end": netpbm("P2", ROOM),
    "P2 of maxval 100": netpbm("P2", scaled(100), 100),
    "P2 of maxval 65535": netpbm("P2", DEEP, 65535),
    "P3": netpbm("P3", np.repeat(ROOM[:, :, None], 3, axis=2)),
    "P6": netpbm("P6", np.repeat(ROOM[:, :, None], 3, axis=2)),
    "P6 of maxval 100": netpbm("P6", np.repeat(scaled(100)[:, :, None], 3, axis=2), 100),
    "PNG": saved(),
    "PNG of colours": saved("RGB"),
    "PNG whose colours differ": saved("RGB", COLOURS),
    "PNG with alpha": with_alpha(),
    "PNG of grey and alpha": with_alpha("LA"),
    "PNG of a palette": saved("P"),
    "PNG of a palette with transparency": palette(),
    "PNG of 16 bits": cv2.imencode(".png", DEEP)[1].tobytes(),
    "PNG of 16 bits and colours": cv2.imencode(".png", np.dstack([DEEP] * 3))[1].tobytes(),
    "PNG with a text": with_text(1000),
    "PNG that lies on its side": turned("PNG"),
    "JPEG": saved(kind="JPEG", quality=95),
    "JPEG of colours": saved("RGB", kind="JPEG", quality=95),
    "JPEG of print colours": saved("CMYK", kind="JPEG", quality=95),
    "JPEG that lies on its side": turned("JPEG"),
    "BMP": saved(kind="BMP"),
    "BMP of colours": saved("RGB", kind="BMP"),
    "TIFF": saved(kind="TIFF"),
    "TIFF of 16 bits": cv2.imencode(".tif", DEEP)[1].tobytes(),
    "TIFF compressed": saved(kind="TIFF", compression="tiff_lzw"),
}  # fmt: skip
TWO_COLOURS = {
    "P1": netpbm("P1", (TWO == 0).astype(np.uint8), head="{kind}\n{w} {h}\n"),
    "P4": cv2.imencode(".pbm", TWO)[1].tobytes(),
    "PNG of one bit": saved("1", TWO),
}
REFUSED = {
    "empty": b"",
    "text": b"hello",
    "P5 cut": P5[:-1],
    "P2 cut": netpbm("P2", ROOM)[:-10],
    "P5 with a comment before the pixels": netpbm(
        "P5", ROOM, head="{kind}\n{w} {h}\n{white}\n# late\n"
    ),
    "P5 of maxval 0": netpbm("P5", ROOM, 0),
    "P5 of maxval 70000": netpbm("P5", ROOM, 70000),
    "P5 without a size": b"P5\n255\n",
    "P2 above its maxval": netpbm("P2", ROOM, 100),
    "PAM": b"P7\nWIDTH 30\nHEIGHT 20\nDEPTH 1\nMAXVAL 255\nTUPLTYPE GRAYSCALE\nENDHDR\n"
    + ROOM.tobytes(),
    "PFM": b"Pf\n30 20\n-1.0\n" + (ROOM / 255).astype("<f4").tobytes(),
    "PNG cut": saved()[:70],
    "JPEG cut": saved(kind="JPEG")[:400],
    "TIFF cut": saved(kind="TIFF")[:300],
    "TIFF of floats": cv2.imencode(".tif", ROOM.astype(np.float32) / 255)[1].tobytes(),
    "TIFF of two pages": several("TIFF"),
    "PNG of two pictures": several("PNG"),
    "GIF": saved(kind="GIF"),
    "WebP": saved(kind="WEBP", lossless=True),
}
DESCRIPTIONS = {
    "negate": ({"negate": "1"}, 255 - ROOM, CELLS),
    "negate true": ({"negate": "true"}, 255 - ROOM, CELLS),
    "negate in quotes": ({"negate": "'1'"}, 255 - ROOM, CELLS),
    "no negate": ({"negate": None}, ROOM, CELLS),
    "negate 2": ({"negate": "2"}, ROOM, "negate must be '0' or '1' or 'false' or 'true', not '2'"),
    "negate a word": ({"negate": "maybe"}, ROOM, "negate must be '0' or .*, not 'maybe'"),
    "negate nothing": ({"negate": ""}, ROOM, "negate must be '0' or .*, not 'none'"),
    "trinary": ({"mode": "trinary"}, ROOM, CELLS),
    "scale": ({"mode": "Scale"}, ROOM, CELLS),
    "raw": ({"mode": "raw"}, RAW, CELLS),
    "raw of 16 bits": ({"mode": "raw"}, RAW.astype(np.uint16), "has the mode raw"),
    "raw negated": ({"mode": "raw", "negate": "1"}, RAW, "has the mode raw"),
    "a mode of none": ({"mode": "bogus"}, ROOM, "mode must be 'trinary' or 'scale' or 'raw', not 'bogus'"),
    "an empty mode": ({"mode": ""}, ROOM, "mode must be 'trinary' or .*, not 'none'"),
    "thresholds swapped": ({"occupied_thresh": "0.1", "free_thresh": "0.7"}, ROOM, "'free_thresh' is 0.7, above"),
    "thresholds alike": ({"occupied_thresh": "0.5", "free_thresh": "0.5"}, ROOM, CELLS),
    "thresholds in percent": ({"occupied_thresh": "65"}, ROOM, r"occupied_thresh must be in \[0, 1\], not 65"),
    "no thresholds": ({"occupied_thresh": None, "free_thresh": None}, ROOM, CELLS),
    "a threshold of nan": ({"free_thresh": ".nan"}, ROOM, r"free_thresh must be in \[0, 1\], not nan"),
    "a high occupied_thresh": ({"occupied_thresh": "0.99"}, np.where(ROOM == 0, 60, ROOM), PALE),
    "resolution in quotes": ({"resolution": "'0.05'"}, ROOM, CELLS),
    "resolution as a power": ({"resolution": "5e-2"}, ROOM, CELLS),
    "a whole resolution": ({"resolution": "1"}, ROOM, CELLS),
    "resolution true": ({"resolution": "true"}, ROOM, "resolution must be of type float, not True"),
    "resolution with a comma": ({"resolution": "0,05"}, ROOM, "resolution"),
    "resolution nan": ({"resolution": ".nan"}, ROOM, r"resolution must be in \[1e-05, 100\], not nan"),
    "resolution infinite": ({"resolution": ".inf"}, ROOM, r"resolution must be in .*, not inf"),
    "resolution 0": ({"resolution": "0"}, ROOM, r"resolution must be in .*, not 0"),
    "resolution below 0": ({"resolution": "-0.05"}, ROOM, r"resolution must be in .*, not -0.05"),
    "no resolution": ({"resolution": None}, ROOM, "'resolution' is missing"),
    "two resolutions": ({"resolution": "0.05\nresolution: 0.1"}, ROOM, "the key 'resolution' stands there twice"),
    "an origin of two": ({"origin": "[-1, 2]"}, ROOM, CELLS),
    "an origin of four": ({"origin": "[-1, 2, 0, 0]"}, ROOM, "origin.* must be"),
    "an origin in lines": ({"origin": "\n- -1\n- 2\n- 0"}, ROOM, CELLS),
    "an origin in quotes": ({"origin": "['-1', '2', '0']"}, ROOM, CELLS),
    "an origin that is a text": ({"origin": "'123'"}, ROOM, "origin must be of type tuple, not '123'"),
    "an origin that is a mapping": ({"origin": "{1: a, 2: b}"}, ROOM, "origin.* must be"),
    "an origin of truths": ({"origin": "[true, 2, 0]"}, ROOM, "origin.* must be"),
    "an origin of nan": ({"origin": "[.nan, 2, 0]"}, ROOM, "origin.* must be"),
    "a yaw of nan": ({"origin": "[1, 2, .nan]"}, ROOM, r"origin\[2\] must be finite, not nan"),
    "an origin too far": ({"origin": "[1e12, 2, 0]"}, ROOM, "origin.* must be"),
    "no origin": ({"origin": None}, ROOM, "'origin' is missing"),
    "a name in quotes": ({"image": '"a.pgm"'}, ROOM, CELLS),
    "a name with spaces": ({"image": "my map.pgm"}, ROOM, CELLS),
    "a path": ({"image": "../here/a.pgm"}, ROOM, CELLS),
    "an absolute path": ({"image": "{folder}/a.pgm"}, ROOM, CELLS),
    "a picture that is absent": ({"image": "b.png"}, ROOM, "the map's image can't be read"),
    "a picture that is a number": ({"image": "[1]"}, ROOM, r"image must be of type str, not \[1\]"),
    "no picture": ({"image": None}, ROOM, "'image' is missing"),
    "keys of others": ({"cost_translation_table": "[1, 2]", "yaw": "3"}, ROOM, CELLS),
    "two documents": ({"yaw": "3\n---\na: b"}, ROOM, "not valid yaml"),
    "CRLF": ({"yaw": "0\r"}, ROOM, CELLS),
}  # fmt: skip


@pytest.fixture
def read(tmp_path):
    """Reads a map of a picture's bytes and changes of the description, whose values are YAML."""

    def run(content, **changes):
        folder = tmp_path / "here"
        folder.mkdir()
        for name in ("a.pgm", "my map.pgm"):
            (folder / name).write_bytes(content)
        lines = {**YAML, **changes}
        text = "".join(f"{key}: {value}\n" for key, value in lines.items() if value is not None)
        (folder / "a.yaml").write_text(text.replace("{folder}", str(folder)), newline="")
        return read_turned_map(folder / "a.yaml")

    return run


@pytest.mark.parametrize("name", READ)
def test_pictures_are_read(read, name):
    assert (read(READ[name]).grid.cells == CELLS).all()


@pytest.mark.parametrize("name", TWO_COLOURS)
def test_pictures_of_two_colours_are_read(read, name):
    assert (read(TWO_COLOURS[name]).grid.cells == np.where(TWO == 0, OCCUPIED, FREE)).all()


@pytest.mark.parametrize("name", REFUSED)
def test_pictures_are_refused(read, name, capfd):
    with pytest.raises(
        InputFileError, match=r"a\.pgm: (is not a picture|holds several|has numbers of 32)"
    ):
        read(REFUSED[name])
    assert capfd.readouterr().err == ""  # of libraries in C, too


@pytest.mark.parametrize("name", DESCRIPTIONS)
def test_descriptions(read, name):
    changes, pixels, expected = DESCRIPTIONS[name]
    content = netpbm("P5", pixels, 65535 if pixels.dtype == np.uint16 else 255)
    if isinstance(expected, str):
        with pytest.raises(InputFileError, match=expected):
            read(content, **changes)
    else:
        grid = read(content, **changes).grid
        assert (grid.cells == expected).all()
        assert grid.frame[:3] == (float(changes.get("resolution", "0.05").strip("'")), -1.0, 2.0)


@pytest.mark.parametrize("yaw", [0.7, -3.0, 7.0])
def test_a_yaw_turns_the_map(read, yaw):
    grid, placement = read(P5, origin=f"[-1, 2, {yaw}]")
    assert (placement.x, placement.y) == (-1.0, 2.0)
    assert np.exp(1j * placement.theta) == pytest.approx(np.exp(1j * yaw))
    assert (grid.cells == CELLS).all()


def test_what_no_reader_can_place_is_refused(read, tmp_path):
    read(P5, origin="[-1, 2, 0.7]")
    with pytest.raises(InputFileError, match="rotated"):
        read_ros_map(tmp_path / "here" / "a.yaml")
