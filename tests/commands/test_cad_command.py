"""``slamgym cad``: maps and folders in, drawings out, one sentence for what can't be drawn."""

import struct
import subprocess
import sys
import zlib

import pytest
from drawing.painted import FLAT, painted

from slamgym.commands.cli import main
from slamgym.interop import write_ros_map
from slamgym.viz.canvas import write_picture

TEXT = "svg,geojson,json,png"


@pytest.fixture
def flat(tmp_path):
    grid, _, _ = painted(FLAT)
    (tmp_path / "maps").mkdir()
    return write_ros_map(tmp_path / "maps" / "flat", grid)


def test_a_map_becomes_a_drawing_in_every_format_without_torch(flat, tmp_path):
    out = tmp_path / "out"
    words = ["cad", str(flat), "-o", str(out), "--model", "none", "--formats", f"dxf,{TEXT}"]
    code = f"import sys; from slamgym.commands.cli import main; main({words}); assert 'torch' not in sys.modules"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert sorted(path.name for path in out.iterdir()) == [
        "flat.dxf", "flat.geojson", "flat.json", "flat.png", "flat.svg",
    ]  # fmt: skip
    assert "2 rooms, 1 door," in done.stdout
    assert done.stderr == ""


def test_cad_draw_is_the_same_command(flat, tmp_path):
    for words in (["cad"], ["cad", "draw"]):
        out = tmp_path / "-".join(words)
        assert main([*words, str(flat), "-o", str(out), "--model", "none", "--formats", "svg"]) == 0
    assert (tmp_path / "cad" / "flat.svg").read_bytes() == (
        tmp_path / "cad-draw" / "flat.svg"
    ).read_bytes()


def test_the_network_draws_too_without_torch(flat, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    assert (
        main(["cad", str(flat), "-o", str(tmp_path / "out"), "--formats", "json", "--angle", "0"])
        == 0
    )
    assert "flat: " in capsys.readouterr().out


def test_one_map_that_fails_does_not_stop_a_folder(flat, tmp_path, capsys):
    (flat.parent / "broken.yaml").write_text(
        "image: missing.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n"
    )
    (flat.parent / "zero.yaml").write_text("image: flat.pgm\nresolution: 0\norigin: [0, 0, 0]\n")
    out = tmp_path / "out"
    assert (
        main(["cad", str(flat.parent), "-o", str(out), "--model", "none", "--formats", "svg"]) == 1
    )
    said = capsys.readouterr()
    assert "1 of 3 maps drawn" in said.out
    assert "missing.pgm" in said.err
    assert "resolution must be in" in said.err
    assert [path.name for path in out.iterdir()] == ["flat.svg"]


def test_a_picture_needs_a_scale(flat, tmp_path, capsys):
    grid, _, _ = painted(FLAT)
    picture = tmp_path / "plain.png"
    write_picture(picture, grid.cells)
    command = [
        "cad",
        str(picture),
        "-o",
        str(tmp_path / "out"),
        "--model",
        "none",
        "--formats",
        "json",
    ]
    assert main(command) == 2
    assert "--resolution" in capsys.readouterr().err
    assert main([*command, "--resolution", "0.05"]) == 0


def test_a_giant_picture_is_refused_before_it_is_decoded(tmp_path, capsys):
    header = struct.pack(">IIBBBBB", 30_000, 30_000, 8, 0, 0, 0, 0)
    chunk = b"IHDR" + header
    giant = tmp_path / "giant.png"
    giant.write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + struct.pack(">I", 13)
        + chunk
        + struct.pack(">I", zlib.crc32(chunk))
        + b"\0\0\1\0IDAT"
    )
    assert (
        main(["cad", str(giant), "-o", str(tmp_path), "--model", "none", "--resolution", "0.05"])
        == 2
    )
    assert "SLAMGYM_MAX_PIXELS" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nowhere.yaml"], "doesn't exist"),
        (["{flat}", "--formats", "dwg"], "--formats must be any of dxf"),
        (["{flat}", "--resolution", "-1"], "resolution"),
        (["{flat}", "--model", "nothing-like-it"], "nothing-like-it"),
    ],
)
def test_wrong_arguments_get_one_sentence(flat, tmp_path, capsys, words, message):
    words = [word.format(flat=flat) for word in words]
    assert main(["cad", *words, "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert "Traceback" not in said


def test_a_folder_without_maps_is_refused(tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    assert (
        main(["cad", str(tmp_path / "empty"), "-o", str(tmp_path / "out"), "--model", "none"]) == 2
    )
    assert "holds no ROS maps" in capsys.readouterr().err
