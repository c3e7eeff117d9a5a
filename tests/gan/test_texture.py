"""The texture network: its likelihood, the order of its passes, the dice, and a training that goes on."""

import numpy as np
import pytest
import torch

from slamgym.core.errors import InputFileError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN
from slamgym.gan.texture.generator import TextureGenerator, load_texture
from slamgym.gan.texture.network import PASSES, TextureConfig, TextureNetwork, pass_numbers
from slamgym.gan.texture.training import TextureExample, TextureTrainingConfig, train_texture

SMALL = TextureConfig(width=8, dilations=(1, 2))
STYLE = np.zeros(6, np.float32)


def room(side: int = 60) -> TextureExample:
    """A square room that was seen from its middle, its walls hit often."""
    counted = np.zeros((3, side, side), np.float32)
    counted[0, 10:-10, 10:-10] = 0.5
    walls = np.zeros((side, side), bool)
    walls[10, 10:-10] = walls[-11, 10:-10] = walls[10:-10, 10] = walls[10:-10, -11] = True
    counted[1, walls], counted[2, walls] = 0.5, 1.0
    cells = np.where(walls, OCCUPIED, np.where(counted[0] > 0, FREE, UNKNOWN)).astype(np.uint8)
    return TextureExample(counted, STYLE, cells)


def network() -> TextureNetwork:
    torch.manual_seed(0)
    return TextureNetwork(SMALL)


def test_passes_are_spread_evenly_and_each_is_as_large_as_all_before() -> None:
    passes = pass_numbers(64, 64)
    assert np.bincount(passes.ravel()).tolist() == [512, 512, 1024, 2048]
    assert passes.max() == PASSES - 1
    # No two cells of the first three passes are neighbours in a row or a column.
    early = passes < PASSES - 1
    assert not (early[:, 1:] & early[:, :-1]).any()
    assert not (early[1:] & early[:-1]).any()


def test_a_cell_never_sees_itself_or_later_passes() -> None:
    # The loss of a pass must not change with the classes that it and later passes draw.
    net, passes = network().eval(), torch.from_numpy(pass_numbers(16, 16))
    counted = torch.rand(1, 3, 16, 16)
    features = net.trunk(counted, torch.zeros(1, 6))
    one, other = (torch.nn.functional.one_hot(torch.randint(3, (1, 16, 16)), 3) for _ in range(2))
    for number in range(PASSES):
        known = (passes < number).float()[None, None]
        same = torch.where(known[0, 0].bool()[None, :, :, None], one, other)
        logits = [net.head(features, c.permute(0, 3, 1, 2) * known, known) for c in (one, same)]
        torch.testing.assert_close(logits[0], logits[1])


def test_dice_decide_and_the_map_lies_where_it_was_seen() -> None:
    generator, example = TextureGenerator(network()), room()
    maps = [generator.draw(example.counted, STYLE, np.random.default_rng(s)) for s in (1, 1, 2)]
    assert maps[0].shape == example.cells.shape
    assert (maps[0] == maps[1]).all()
    assert (maps[0] != maps[2]).any()
    assert (maps[0][:5] == UNKNOWN).all()
    nothing = generator.draw(np.zeros((3, 20, 30), np.float32), STYLE, np.random.default_rng(0))
    assert (nothing == UNKNOWN).all()


def test_tiles_draw_the_same_map_as_one_picture(monkeypatch) -> None:
    generator, example = TextureGenerator(network()), room(100)
    whole = generator.draw(example.counted, STYLE, np.random.default_rng(3))
    monkeypatch.setattr("slamgym.gan.texture.generator.DRAWN_TILE", 32)
    tiled = generator.draw(example.counted, STYLE, np.random.default_rng(3))
    assert (whole == tiled).mean() > 0.999  # half precision may round a tie otherwise


def test_a_training_learns_goes_on_and_is_read_back(tmp_path) -> None:
    config = TextureTrainingConfig(network=SMALL, tile=32, batch=2, average=0.5, learning_rate=1e-2)
    first = train_texture([room()], tmp_path, config, minutes=0.02)
    second = train_texture([room()], tmp_path, config, minutes=0.04)
    assert second < first
    steps = torch.load(tmp_path / "checkpoint.pt", weights_only=True)["steps"]
    assert steps > 5
    drawn = load_texture(tmp_path).draw(room().counted, STYLE, np.random.default_rng(0))
    assert (drawn == room().cells).mean() > 0.6
    with pytest.raises(InputFileError, match="other settings"):
        train_texture([room()], tmp_path, TextureTrainingConfig(network=SMALL), minutes=0.01)


def test_weights_of_another_method_are_refused() -> None:
    with pytest.raises(InputFileError, match="another method"):
        load_texture("modelprog")
