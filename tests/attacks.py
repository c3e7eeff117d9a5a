"""Hostile files, each a few kilobytes to make, and what reading one costs, measured in a process of its own.

Times are multiples of a loop of a million additions in the same process: machines differ by a factor of three, and
a core that is shared with other work slows both.
"""

import atexit
import functools
import gzip
import io
import json
import lzma
import struct
import subprocess
import sys
import tarfile
import zlib
from pathlib import Path

import numpy as np

MAX_LOOPS, MAX_MEGABYTES = 100.0, 100.0
"""Loops of a million additions, about 0.04 s each; the worst costs a quarter of them."""

MEASURE = """
import importlib, json, os, resource, sys, warnings
import cv2, ezdxf, shapely
from slamgym.cad import check_plan, open_plans
from slamgym.cad import dxf, houseexpo, image_plan, room_lines
from pathlib import Path
from slamgym.agents.pretrained_policy import read_policy
from slamgym.core.errors import SlamgymError
from slamgym.core.pictures import read_png
from slamgym.dataset.format import read_manifest
from slamgym.dataset.generate.recipe import open_recipe
from slamgym.interop import open_log, read_map, read_ros_map, ros_map
shapely.STRtree(shapely.box([0], [0], [1], [1])).query(shapely.box(0, 0, 1, 1))
def read(kind, path):
    if kind == "plans":
        source = open_plans(path)
        check_plan(source.load(source.ids[0]), 0.22, 64.0)
    else:
        readers = {"map": read_ros_map, "any map": read_map, "log": open_log, "recipe": open_recipe}
        readers |= {"dataset": lambda path: list(read_manifest(path)), "weights": lambda path: read_policy(Path(path))}
        readers |= {"picture": lambda path: read_png(Path(path))}
        readers[kind](path)
def used():
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024
def loop(count=1_000_000):
    total = 0
    for number in range(count):
        total += number
def spent(work, *arguments):
    start = used()[0]
    work(*arguments)
    return used()[0] - start
def measure(kind, path):
    unit = min(spent(loop) for _ in range(3))
    before = used()
    try:
        read(kind, path)
        message = "accepted"
    except SlamgymError as error:
        message = str(error)
    except MemoryError:
        message = "MemoryError"
    after = used()
    unit = max(unit, min(spent(loop) for _ in range(3)))
    return (after[0] - before[0]) / unit, after[1] - before[1], message
for line in sys.stdin:
    child = os.fork()
    if not child:
        print(json.dumps(measure(*json.loads(line))), flush=True)
        os._exit(0)
    _, status = os.waitpid(child, 0)
    if status:
        print(json.dumps((0.0, 0.0, f"exit status {status}")), flush=True)
"""


@functools.cache
def _measurer() -> subprocess.Popen[str]:
    """A process that has imported all readers, and forks for each file."""
    command = [sys.executable, "-W", "ignore", "-c", MEASURE]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    atexit.register(process.communicate)
    return process


def measure(kind: str, path: Path | str) -> tuple[float, float, str]:
    """CPU time in loops of a million additions, megabytes beyond start-up and the message, or ``accepted``."""
    process = _measurer()
    assert process.stdin
    assert process.stdout
    process.stdin.write(json.dumps([kind, str(path)]) + "\n")
    process.stdin.flush()
    loops, megabytes, message = json.loads(process.stdout.readline())
    return loops, megabytes, message


def aliases(folder: Path) -> Path:
    """A map's description of 420 bytes in which each of nine lists holds the one before nine times."""
    lines = ["image: a.pgm", "a0: &a0 [x,x,x,x,x,x,x,x,x]"]
    lines += [f"a{i}: &a{i} [{','.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 9)]
    return _write(folder / "aliases.yaml", "\n".join([*lines, "resolution: *a8"]))


def aliased_recipe(folder: Path) -> Path:
    """The same as a recipe."""
    lines = ["a0: &a0 [x,x,x,x,x,x,x,x,x]"]
    lines += [f"a{i}: &a{i} [{','.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 9)]
    return _write(folder / "recipe.yaml", "\n".join([*lines, "lidar.sigma: *a8"]))


def random_outline(folder: Path, count: int = 20_000) -> Path:
    """A polygon that crosses itself some hundred million times."""
    return _plan(folder / "random.json", np.random.default_rng(0).uniform(0, 20, (count, 2)))


def jagged_outline(folder: Path, count: int = 100_000) -> Path:
    """A valid star whose spikes make every buffer of it explode."""
    rng = np.random.default_rng(0)
    angle, radius = np.sort(rng.uniform(0, 2 * np.pi, count)), rng.uniform(5, 15, count)
    return _plan(
        folder / "jagged.json", np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    )


def comb(folder: Path, count: int = 12_000) -> Path:
    """A valid comb of narrow teeth, with fewer corners than good plans have."""
    x = np.linspace(0, 20, count)
    teeth = np.column_stack([x, np.where(np.arange(count) % 2, 10.0, 0.0)])
    return _plan(folder / "comb.json", np.vstack([teeth, [[20, -5], [0, -5]]]))


def holes(folder: Path, count: int = 90_000) -> Path:
    """A hall with a pillar every few centimetres."""
    side = int(np.ceil(np.sqrt(count)))
    place, size = np.arange(count), 8.0 / side
    corner = np.column_stack([place % side, place // side]) * 20.0 / side
    rings = np.stack(
        [corner, corner + np.array([size, 0]), corner + size, corner + np.array([0, size])], axis=1
    )
    hall = np.array([(-1, -1), (21, -1), (21, 21), (-1, 21)], dtype=float)
    return _plan(folder / "holes.json", hall, rings.round(3).tolist())


def archive_bomb(folder: Path, size: int = 6_400_000_000, members: int = 1) -> Path:
    """A ``.tar.gz`` whose plans are blanks."""
    path = folder / "bomb.tar.gz"
    with path.open("wb") as file:
        stream = zlib.compressobj(1, zlib.DEFLATED, 31)
        blanks = b" " * (1 << 24)
        for number in range(members):
            info = tarfile.TarInfo(f"json/{number}.json")
            info.size = size // members
            file.write(stream.compress(info.tobuf()))
            for start in range(0, info.size, len(blanks)):
                file.write(stream.compress(blanks[: info.size - start]))
            file.write(stream.compress(b"\0" * (-info.size % 512)))
        file.write(stream.flush())
    return path


def xz_bomb(folder: Path, size: int = 64 << 20) -> Path:
    """A ``.jsonl.xz`` of blanks; xz streams may follow each other, so one is made and repeated."""
    part = lzma.compress(b" " * (1 << 25), preset=0)
    path = folder / "bomb.jsonl.xz"
    path.write_bytes(part * (size >> 25))
    return path


def log_bomb(folder: Path) -> Path:
    """A log of empty lines."""
    path = folder / "bomb.log.gz"
    path.write_bytes(gzip.compress(b"\n" * (1 << 26), 1))
    return path


def picture_bomb(folder: Path, side: int = 30_000) -> Path:
    """A map with a black PNG of 900 million pixels."""
    stream = zlib.compressobj(1)
    row = b"\0" * (side + 1)
    content = b"".join(stream.compress(row) for _ in range(side)) + stream.flush()
    _png(folder / "huge.png", side, [(b"IDAT", content)])
    return _map(folder, "huge.png")


def jpeg_of_passes(folder: Path, side: int = 9000) -> Path:
    """A grey JPEG of 300 kB that is drawn again and again: 100 passes took 6 s."""
    from PIL import Image

    content = io.BytesIO()
    Image.new("L", (side, side), 128).save(content, "JPEG", progressive=True)
    whole = content.getvalue()
    last = whole[whole.rindex(b"\xff\xda") : -2]
    path = folder / "passes.jpg"
    path.write_bytes(whole[:-2] + 200 * last + whole[-2:])
    return path


def tiff(folder: Path, data: bytes, fields: dict[int, tuple[int, int, int]]) -> Path:
    """A TIFF of 10 x 10 pixels with more fields: kind, count and value of each tag."""
    one = {256: 10, 257: 10, 258: 8, 262: 1, 273: 8, 277: 1, 278: 10, 279: 100}
    every = {tag: (4, 1, value) for tag, value in one.items()} | fields
    directory = b"".join(struct.pack("<HHII", tag, *every[tag]) for tag in sorted(every))
    head = b"II*\0" + struct.pack("<I", 8 + len(data))
    path = folder / "a.tif"
    path.write_bytes(head + data + struct.pack("<H", len(every)) + directory + bytes(4))
    return path


def tiff_of_one_field(folder: Path, size: int = 1_000_000, count: int = 1000) -> Path:
    """A TIFF of 1 MB whose fields, of 1 GB, are all the same bytes."""
    return tiff(folder, bytes(size), {1000 + tag: (1, size, 8) for tag in range(count)})


def tiff_of_one_tile(folder: Path, side: int = 30_000) -> Path:
    """A TIFF of 10 x 10 pixels in a tile of 900 MB."""
    tile = zlib.compress(bytes(1 << 20))
    fields = {259: 8, 322: side, 323: side, 324: 8, 325: len(tile)}
    return tiff(folder, tile, {tag: (4, 1, value) for tag, value in fields.items()})


def png_of_profiles(folder: Path, count: int = 3000) -> Path:
    """A PNG of 16 pixels with thousands of colour profiles of 900 kB."""
    profile = (b"iCCP", b"a\0\0" + zlib.compress(bytes(900_000), 9))
    return _png(
        folder / "profiles.png", 4, [profile] * count + [(b"IDAT", zlib.compress(bytes(20)))]
    )


def vacuum_of_runs(folder: Path, layers: int = 1) -> Path:
    """A vacuum's map of a few kB whose runs paint the same pixels again and again."""
    layer = {"type": "floor", "compressedPixels": [0, 0, 1_000_000] * (300 // layers)}
    return _write(folder / "runs.json", json.dumps({"pixelSize": 5, "layers": [layer] * layers}))


def vacuum_of_segments(folder: Path, count: int = 300) -> Path:
    """A vacuum's map of two far pixels and many rooms of one."""
    layers = [{"type": "floor", "pixels": [0, 0, 9000, 9000]}]
    layers += [{"type": "segment", "pixels": [number, 0]} for number in range(count)]
    return _write(folder / "segments.json", json.dumps({"pixelSize": 5, "layers": layers}))


def vacuum_of_texts(folder: Path) -> Path:
    """A vacuum's map of a long text among a million numbers."""
    layer = {"type": "floor", "pixels": ["x" * 100_000, *([0] * 99_999)]}
    return _write(folder / "texts.json", json.dumps({"pixelSize": 5, "layers": [layer]}))


def vacuum_picture(folder: Path, size: int = 60 << 20) -> Path:
    """A PNG of 60 kB that holds a vacuum's map of 60 MB."""
    head, tail = b'{"pixelSize":5,"layers":[', b"{}]}"
    text = zlib.compress(head + b"{}," * ((size - len(head)) // 3) + tail, 9)
    return _png(
        folder / "card.png",
        4,
        [(b"zTXt", b"ValetudoMap\0\0" + text), (b"IDAT", zlib.compress(bytes(20)))],
    )


def endless_line(folder: Path) -> Path:
    """A dataset whose manifest is one line of zeros, which take no place on the disk."""
    with (folder / "manifest.jsonl").open("wb") as file:
        file.truncate(8 << 30)
    return folder


def huge_weights(folder: Path) -> Path:
    """Weights of zeros."""
    path = folder / "policy.safetensors"
    with path.open("wb") as file:
        file.truncate(8 << 30)
    return path


def device_as_image(folder: Path) -> Path:
    """A map whose image has no end."""
    return _map(folder, "/dev/zero")


def _png(path: Path, side: int, chunks: list[tuple[bytes, bytes]]) -> Path:
    """A square grey picture of these chunks."""
    header = side.to_bytes(4, "big") * 2 + b"\x08\0\0\0\0"
    content = b"\x89PNG\r\n\x1a\n"
    for kind, data in ((b"IHDR", header), *chunks, (b"IEND", b"")):
        content += (
            len(data).to_bytes(4, "big") + kind + data + zlib.crc32(kind + data).to_bytes(4, "big")
        )
    path.write_bytes(content)
    return path


def _map(folder: Path, image: str) -> Path:
    return _write(folder / "map.yaml", f"image: {image}\nresolution: 0.05\norigin: [0, 0, 0]\n")


def _plan(path: Path, outline: np.ndarray, rings: list | None = None) -> Path:
    return _write(
        path, json.dumps({"id": "a", "verts": outline.round(6).tolist(), "holes": rings or []})
    )


def _write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path
