"""Maps through a translator: sizes, frames, scales, files, bad input; the network copies what is free."""

import dataclasses
from itertools import pairwise

import cv2
import numpy as np
import pytest
import torch
from torch import nn

from slamgym.commands import cli
from slamgym.commands.cli import TABLE
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, OccupancyGrid
from slamgym.gan.config import GeneratorConfig, TranslatorConfig
from slamgym.gan.device import choose_compute
from slamgym.gan.networks.factory import build_generator, on_device
from slamgym.gan.networks.generators import GeneratorOutput
from slamgym.gan.networks.plain_unet import PlainUNet
from slamgym.gan.translation.finishing import thinned_walls
from slamgym.gan.translation.tiling import tile_starts, translate_tiled
from slamgym.gan.translation.translate import LearnedTranslator, Translator, load_translator
from slamgym.gan.weights import (
    PRETRAINED_FOLDER,
    ModelCard,
    load_tensors,
    load_weights,
    save_translator,
)
from slamgym.interop.ros_map import read_ros_map, write_ros_map
from slamgym.metrics.wall_direction import turned


def main(argv):
    return TABLE.run("slamgym", ["gan", "translate", *map(str, argv)])


CPU = choose_compute("cpu", "float32")
CONFIG = TranslatorConfig(
    input_size=64,
    output_size=64,
    input_encoding="free_occupied",
    output_encoding="layers",
    derotate=True,
    metres_per_px=(0.05, 0.1, 0.2),
    generator=GeneratorConfig("residual", width=8, depth=2),
)


class Copy(nn.Module):
    """Draws what is free in the input as floor, what is occupied as walls; or all that is free as grey."""

    def __init__(self, shrink=1):
        super().__init__()
        self.shrink = shrink

    def forward(self, x, resolution=None, fade=1.0):
        if self.shrink > 1:
            return GeneratorOutput(nn.functional.avg_pool2d(x, self.shrink)[:, :1])
        free, occupied = x.split(1, dim=1)
        return GeneratorOutput(
            torch.cat([free, occupied, -torch.ones_like(free), -free - occupied - 1.0], dim=1)
        )


def copying(config=CONFIG, **kwargs):
    return LearnedTranslator(on_device(Copy(**kwargs), config, CPU), config, ModelCard())


def building(rows, cols, margin=0.2, fill=UNKNOWN):
    cells = np.full((rows, cols), fill, np.uint8)
    top, left = round(margin * rows), round(margin * cols)
    cells[top : rows - top, left : cols - left] = FREE
    cells[top : rows - top, cols // 2 : cols // 2 + 3] = OCCUPIED
    return cells


def agreement(free, cells):
    return float(np.mean((free > 0.5) == (cells == FREE)))


def test_it_is_a_translator():
    assert isinstance(copying(), Translator)


@pytest.mark.parametrize("shape", [(64, 64), (40, 40), (64, 50), (150, 90), (300, 280), (700, 80)])
@pytest.mark.parametrize("scale", [None, 0.02, 0.05, 0.3])
def test_any_size_and_scale_comes_back_in_place(shape, scale):
    cells = building(*shape)
    free = copying().translate(cells, scale)
    assert free.shape == shape
    assert free.dtype == np.float32
    assert 0.0 <= free.min() <= free.max() <= 1.0
    # Resampling blurs the borders by a pixel of the network's image: five pixels at 0.02 m.
    assert agreement(free, cells) > 0.9


def test_a_map_of_a_trained_scale_is_not_resampled():
    cells = building(64, 64)
    assert agreement(copying().translate(cells, 0.1), cells) == 1.0


@pytest.mark.parametrize(
    ("shape", "scale", "expected"),
    [
        ((40, 30), 0.1, (40, 30)),  # of a trained scale: as it is
        ((64, 20), 0.01, (13, 4)),  # too fine: the finest that was trained, 0.05
        ((30, 20), 0.4, (60, 40)),  # too coarse: 0.2
        ((100, 50), 0.1, (100, 50)),  # its own scale, in tiles
        ((400, 200), 0.05, (400, 200)),
        ((32, 16), None, (64, 32)),  # of unknown scale: fitted
        ((640, 64), None, (160, 16)),  # but shrunk by 4 at most
    ],
)
def test_the_working_scale(shape, scale, expected):
    assert copying()._working_shape(shape, scale) == expected


def test_a_turned_map_comes_back_turned():
    cells = building(101, 101, margin=0.3)
    matrix = cv2.getRotationMatrix2D((50, 50), 25.0, 1.0)
    turned = cv2.warpAffine(cells, matrix, (101, 101), flags=cv2.INTER_NEAREST, borderValue=UNKNOWN)
    assert agreement(copying().translate(turned), turned) > 0.96


def test_a_drifted_map_is_straightened_on_demand():
    cells = building(64, 64)
    matrix = cv2.getRotationMatrix2D((31.5, 31.5), 4.0, 1.0)
    drifted = cv2.warpAffine(cells, matrix, (64, 64), flags=cv2.INTER_NEAREST, borderValue=UNKNOWN)
    straight, back = copying().translate(drifted, straighten=True), copying().translate(drifted)
    assert agreement(straight, cells) > agreement(straight, drifted)
    assert agreement(back, drifted) > agreement(back, cells)
    assert agreement(back, drifted) > 0.97


def test_a_smaller_output_is_enlarged():
    config = dataclasses.replace(
        CONFIG, output_size=32, output_encoding="grey", generator=GeneratorConfig(width=2)
    )
    cells = building(64, 64)
    assert agreement(copying(config, shrink=2).translate(cells), cells) > 0.9


@pytest.mark.parametrize("value", [UNKNOWN, FREE, OCCUPIED])
def test_maps_of_one_value_are_translated(value):
    cells = np.full((50, 70), value, np.uint8)
    free = copying().translate(cells)
    assert free.shape == (50, 70)
    assert (free > 0.5).all() == (value == FREE)


def test_cad_to_slam_draws_the_three_values():
    config = dataclasses.replace(
        CONFIG,
        direction="cad2slam",
        derotate=False,
        input_encoding="grey",
        output_encoding="free_occupied",
        generator=GeneratorConfig(),
    )

    class Inverse(nn.Module):
        def forward(self, x, resolution=None, fade=1.0):
            return GeneratorOutput(torch.cat([x, -torch.ones_like(x)], dim=1))

    translator = LearnedTranslator(on_device(Inverse(), config, CPU), config, ModelCard())
    cad = building(90, 64, fill=OCCUPIED)
    slam = translator.translate_cells(cad, 0.1)
    assert slam.shape == cad.shape
    assert set(np.unique(slam)) == {UNKNOWN, FREE}
    assert np.mean((slam == FREE) == (cad == FREE)) > 0.95
    one, other = (
        translator.translate_cells(cad, 0.1, drift=np.random.default_rng(seed)) for seed in (1, 2)
    )
    assert set(np.unique(one)) == {UNKNOWN, FREE}
    for a, b in ((one, other), (one, slam)):
        assert 0.0 < np.mean(a != b) < 0.2
    with pytest.raises(ConfigError, match="to SLAM maps"):
        translator.translate(cad)


@pytest.mark.parametrize(
    "cells", [np.zeros((3, 3, 3), np.uint8), np.zeros((3, 3)), np.zeros((0, 5), np.uint8)]
)
def test_what_is_no_map_is_refused(cells):
    with pytest.raises(ConfigError, match="a map is an array"):
        copying().translate(cells)


@pytest.mark.parametrize("length", [1, 64, 65, 100, 128, 129, 500])
def test_tiles_cover_everything_and_overlap(length):
    starts = tile_starts(length, 64)
    assert starts[0] == 0
    assert max(length, 64) == starts[-1] + 64
    assert all(b - a <= 0.75 * 64 + 1 for a, b in pairwise(starts))


def test_tiles_blend_to_the_same_image():
    cells = np.random.default_rng(0).integers(0, 255, (150, 90), dtype=np.uint8)
    whole = translate_tiled(cells, 64, 0, lambda tiles: tiles[:, None].astype(np.float32))
    assert np.allclose(whole[0], cells, atol=1e-3)


@pytest.fixture
def weights(tmp_path):
    path = tmp_path / "tiny.safetensors"
    config = dataclasses.replace(CONFIG, input_size=32, output_size=32)
    save_translator(path, build_generator(config, seed=1), config, ModelCard(preset="tiny"))
    return path


def test_weights_load_with_one_call(weights):
    translator = load_translator(weights, "slam2cad")
    assert translator.translate(building(40, 50)).shape == (40, 50)


def test_an_image_becomes_an_image(tmp_path, weights):
    cv2.imwrite(str(tmp_path / "map.png"), building(50, 40))
    assert (
        main(
            [
                str(tmp_path / "map.png"),
                "-o",
                str(tmp_path / "out" / "cad.png"),
                "--weights",
                str(weights),
            ]
        )
        == 0
    )
    image = cv2.imread(str(tmp_path / "out" / "cad.png"), cv2.IMREAD_UNCHANGED)
    assert image.shape == (50, 40)
    assert set(np.unique(image)) <= {0, 254}


def test_probabilities_are_written_on_demand(tmp_path, weights):
    cv2.imwrite(str(tmp_path / "map.png"), building(50, 40))
    arguments = [
        str(tmp_path / "map.png"),
        "-o",
        str(tmp_path),
        "--weights",
        str(weights),
        "--probability",
    ]
    (tmp_path / "map.png").rename(tmp_path / "slam.pgm.png")
    arguments[0] = str(tmp_path / "slam.pgm.png")
    arguments[2] = str(tmp_path / "p.png")
    assert main(arguments) == 0
    assert len(np.unique(cv2.imread(str(tmp_path / "p.png"), cv2.IMREAD_UNCHANGED))) > 2


def test_a_ros_map_becomes_a_ros_map_of_the_same_frame(tmp_path, weights):
    frame = GridFrame(0.05, -3.0, 1.5, 60, 45)
    source = write_ros_map(tmp_path / "flat", OccupancyGrid(building(60, 45), frame))
    (tmp_path / "out").mkdir()
    assert main([str(source), "-o", str(tmp_path / "out"), "--weights", str(weights)]) == 0
    translated = read_ros_map(tmp_path / "out" / "flat.yaml")
    assert translated.frame == frame


def test_a_folder_of_both_is_translated_once_each(tmp_path, weights, capsys):
    source, out = tmp_path / "in", tmp_path / "out"
    source.mkdir()
    write_ros_map(
        source / "flat", OccupancyGrid(building(60, 45), GridFrame(0.05, 0.0, 0.0, 60, 45))
    )
    cv2.imwrite(str(source / "sketch.png"), building(30, 30))
    (source / "broken.png").write_bytes(b"no picture")
    assert main([str(source), "-o", str(out), "--weights", str(weights)]) == 0
    assert sorted(path.name for path in out.iterdir()) == ["flat.pgm", "flat.yaml", "sketch.png"]
    captured = capsys.readouterr()
    assert "2 maps in" in captured.out
    assert "skipped" in captured.err
    assert "broken.png: is not a picture" in captured.err
    # What is translated is never written over, and pictures of one name become two.
    before = {path.name: path.read_bytes() for path in source.iterdir()}
    with pytest.raises(InputFileError, match="nothing that could be translated"):
        main([str(source), "-o", str(source), "--weights", str(weights)])
    assert {path.name: path.read_bytes() for path in source.iterdir()} == before
    (source / "sketch.png").rename(source / "flat2.png")
    cv2.imwrite(str(source / "flat2.bmp"), building(30, 30))
    assert main([str(source), "-o", str(tmp_path / "two"), "--weights", str(weights)]) == 0
    assert {path.name for path in (tmp_path / "two").glob("*.png")} == {
        "in_flat2_bmp.png",
        "in_flat2_png.png",
    }


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (["absent.png", "-o", "x.png"], InputFileError, "doesn't exist"),
        (["map.png", "-o", "x.docx"], InputFileError, "is no image name"),
        (
            ["map.png", "-o", "x.png", "--metres-per-px", "-1"],
            ConfigError,
            r"--metres-per-px must be in \(0, 100\)",
        ),
        (["empty", "-o", "x"], InputFileError, "no images"),
        (["broken.png", "-o", "x.png"], InputFileError, "is not a picture"),
        (["colour.png", "-o", "x.png"], InputFileError, "is coloured"),
    ],
)
def test_bad_input_is_one_clear_error(tmp_path, weights, monkeypatch, arguments, error, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    (tmp_path / "broken.png").write_bytes(b"")
    cv2.imwrite("map.png", building(20, 20))
    colour = np.zeros((8, 8, 3), np.uint8)
    colour[..., 0] = 200
    cv2.imwrite("colour.png", colour)
    with pytest.raises(error, match=message):
        main([*arguments, "--weights", str(weights)])


def test_weights_of_the_way_back_are_refused(tmp_path):
    cv2.imwrite(str(tmp_path / "map.png"), building(20, 20))
    with pytest.raises(ConfigError, match="use `slamgym deform PLAN --method modelprog"):
        main([str(tmp_path / "map.png"), "-o", str(tmp_path / "x.png"), "--weights", "modelprog"])


def test_walls_of_an_enlarged_map_are_one_cell_thick():
    cells = np.full((60, 80), UNKNOWN, np.uint8)
    cells[10:50, 10:70] = FREE
    cells[8:16, 8:72] = cells[44:52, 8:72] = OCCUPIED
    cells[8:52, 8:16] = cells[8:52, 64:72] = cells[8:52, 36:44] = OCCUPIED
    thin = thinned_walls(cells)
    assert set(np.unique(thin)) == {OCCUPIED, UNKNOWN, FREE}
    assert (thin == OCCUPIED).sum() < 1.2 * (2 * 56 + 3 * 36)
    # The two rooms stay apart and closed.
    count, labels = cv2.connectedComponents((thin == FREE).astype(np.uint8), connectivity=4)
    assert count == 3
    assert labels[30, 25] != labels[30, 55]
    assert cv2.connectedComponents((thin != OCCUPIED).astype(np.uint8), connectivity=4)[0] == 4


def test_the_command_line_shows_no_traceback(tmp_path, capsys):
    assert cli.main(["gan", "translate", str(tmp_path / "absent.png"), "-o", "x.png"]) == 2
    assert "doesn't exist" in capsys.readouterr().err
    assert cli.main(["gan", "trane"]) == 2
    assert "did you mean 'train'" in capsys.readouterr().err
    assert cli.main(["gan", "--help"]) == 0
    assert "translate" in capsys.readouterr().out


def test_tiles_without_anything_known_are_left_out():
    cells = np.full((300, 300), 7, np.uint8)
    cells[10:20, 10:20] = 9
    counted = []

    def run(tiles):
        counted.append(len(tiles))
        return tiles[:, None].astype(np.float32)

    whole = translate_tiled(cells, 64, 7, run)
    assert sum(counted) == 1
    assert whole[0, 15, 15] == pytest.approx(9.0)
    assert whole[0, 200, 200] == -1.0


def test_layers_add_up_and_tell_walls_from_what_nobody_saw():
    cells = building(60, 80)
    layers = copying().layers(cells, 0.1)
    assert np.allclose(layers.floor + layers.wall + layers.door + layers.unseen, 1.0, atol=1e-5)
    assert np.array_equal(layers.free > 0.5, cells == FREE)
    assert np.array_equal(layers.wall > 0.5, cells == OCCUPIED)
    assert np.array_equal(layers.unseen > 0.5, cells == UNKNOWN)
    config = dataclasses.replace(
        CONFIG, output_size=32, output_encoding="grey", generator=GeneratorConfig(width=2)
    )
    with pytest.raises(ConfigError, match="no layers"):
        copying(config, shrink=2).layers(cells)


def test_a_thin_wall_of_a_turned_map_stays_closed():
    cells = np.full((120, 120), UNKNOWN, np.uint8)
    cells[20:100, 20:100] = FREE
    cells[20:100, 58:61] = OCCUPIED
    slam = turned(cells, 7.0)
    floor = copying().translate(slam, 0.1) >= 0.5
    count, _ = cv2.connectedComponents(floor.astype(np.uint8), connectivity=4)
    assert count == 3


class Stripes(nn.Module):
    """Draws floor with walls of one cell, whatever it sees."""

    def forward(self, x, resolution=None, fade=1.0):
        wall = torch.full_like(x[:, :1], -1.0)
        wall[..., ::13] = 1.0
        return GeneratorOutput(torch.cat([-wall, wall, -torch.ones_like(x)], dim=1))


def test_walls_thinner_than_a_pixel_of_the_map_stay_closed():
    config = dataclasses.replace(
        CONFIG, input_size=128, output_size=128, metres_per_px=(0.05, 0.05, 0.05)
    )
    translator = LearnedTranslator(on_device(Stripes(), config, CPU), config, ModelCard())
    # A wall covers a third of a pixel. The network's image is 120 cells wide, in the middle of a tile of 128.
    layers = translator.layers(np.full((40, 40), FREE, np.uint8), 0.15)
    count, _ = cv2.connectedComponents((layers.free >= 0.5).astype(np.uint8), connectivity=8)
    assert count - 1 == len(range(13, 124, 13)) + 1
    assert np.allclose(layers.floor + layers.wall + layers.door + layers.unseen, 1.0, atol=1e-5)


def test_the_shipped_network_draws_the_same_without_torch():
    config, _, tensors = load_tensors(PRETRAINED_FOLDER / "slam2cad.safetensors")
    generate = on_device(load_weights("slam2cad").generator, config, CPU)
    cells = np.random.default_rng(0).choice(
        np.array([OCCUPIED, UNKNOWN, FREE], np.uint8), (2, config.input_size, config.input_size)
    )
    plain = PlainUNet(tensors, config.generator.depth)
    np.testing.assert_allclose(plain(cells), generate(cells), atol=1e-4)
