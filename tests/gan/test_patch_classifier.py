"""The network that looks at patches: what it is shown, and that it finds a plain difference, the same one each time."""

import numpy as np
import pytest

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN
from slamgym.gan.evaluation import patch_classifier
from slamgym.gan.evaluation.patch_classifier import PatchLearner, cut_patches
from slamgym.metrics.two_sample import distinguish


@pytest.fixture(autouse=True)
def small(monkeypatch):
    sizes = {
        "PATCH_SIDE": 32,
        "PER_MAP": 8,
        "PER_KIND": 64,
        "JUDGED": 4,
        "WIDTH": 4,
        "EPOCHS": 10,
        "LEARNING_RATE": 1e-2,
    }
    for name, value in sizes.items():
        monkeypatch.setattr(patch_classifier, name, value)


def room(wall: int, side: int):
    cells = np.full((side + 20, side + 20), UNKNOWN, np.uint8)
    cells[10 - wall : 10 + side + wall, 10 - wall : 10 + side + wall] = OCCUPIED
    cells[10 : 10 + side, 10 : 10 + side] = FREE
    return cells


def test_patches_lie_on_the_border_of_the_floor_and_reach_beyond_the_map():
    patches = cut_patches(room(1, 50), np.random.default_rng(0))
    assert patches.shape == (8, 32, 32)
    assert all({OCCUPIED, FREE, UNKNOWN} == set(np.unique(patch)) for patch in patches)


def test_thick_walls_are_told_from_thin_ones_and_always_alike():
    maps = [room(1 + 3 * (i % 2), 40 + i) for i in range(12)]
    of_second = np.arange(12) % 2 == 1
    buildings = [str(i) for i in range(12)]
    first, again = (distinguish(of_second, buildings, PatchLearner(maps, 0), 3) for _ in range(2))
    assert first.value > 0.9
    assert first == again
