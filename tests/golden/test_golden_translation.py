"""A small map through every pretrained translator, and through the cleaning without learning."""

import cv2
import numpy as np
import pytest

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN
from slamgym.metrics.cleaning import clean_map

SCALE = 0.08  # [m/px]
# Kinds of processors sum in different orders, so that a pixel near the threshold may fall on either side.
MOST_DIFFERENT = 0.005


def cad_map():
    """Three rooms with doors, (96, 112)."""
    cad = np.full((96, 112), OCCUPIED, np.uint8)
    cad[10:86, 8:104] = FREE
    cad[10:60, 44:47] = OCCUPIED
    cad[58:61, 8:90] = OCCUPIED
    cad[58:61, 20:32] = FREE
    cad[28:40, 44:47] = FREE
    return cad


def slam_map():
    """The same building as a robot may have mapped it: faces of walls with gaps, a corner unseen, turned a little."""
    free = (cad_map() == FREE).astype(np.uint8)
    faces = (cv2.dilate(free, np.ones((3, 3), np.uint8)) > 0) & (free == 0)
    rows, cols = np.indices(free.shape)
    slam = np.where(free > 0, FREE, UNKNOWN).astype(np.uint8)
    slam[faces & ((7 * rows + 11 * cols) % 13 > 1)] = OCCUPIED
    slam[70:, 92:] = UNKNOWN
    turn = cv2.getRotationMatrix2D((55.5, 47.5), 3.0, 1.0)
    return cv2.warpAffine(
        slam, turn, slam.shape[::-1], flags=cv2.INTER_NEAREST, borderValue=UNKNOWN
    )


def test_the_maps_themselves(golden):
    golden.check("translation/input/cad", golden.of_cells(cad_map()))
    golden.check_picture("slam_map", slam_map(), MOST_DIFFERENT)


@pytest.mark.parametrize("weights", ["slam2cad", "model32", "modelprog"])
def test_pretrained_weights(golden, weights):
    pytest.importorskip("torch")
    from slamgym.gan.translation.translate import load_translator

    translator = load_translator(weights)
    cells = cad_map() if translator.config.direction == "cad2slam" else slam_map()
    golden.check_picture(f"by_{weights}", translator.translate_cells(cells, SCALE), MOST_DIFFERENT)


def test_cleaning_without_learning(golden):
    cells = np.where(clean_map(slam_map(), SCALE), FREE, OCCUPIED).astype(np.uint8)
    golden.check_picture("by_classical", cells, MOST_DIFFERENT)
