"""Small synthetic pairs: rooms, and what a robot with drift would draw of them."""

import cv2
import numpy as np
import pytest

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN


def draw_pair(seed, side=32):
    """A building with one inner wall, and its SLAM map: thick wall faces with gaps, unknown outside."""
    rng = np.random.default_rng(seed)
    top, left = rng.integers(2, side // 5, 2)
    bottom, right = side - rng.integers(2, side // 5, 2)
    cad = np.full((side, side), OCCUPIED, np.uint8)
    cad[top:bottom, left:right] = FREE
    wall = int(rng.integers(left + side // 4, right - side // 4))
    cad[top : bottom - side // 5, wall] = OCCUPIED
    # Walls a pixel too thick: a defect that can be learnt.
    free = cv2.erode((cad == FREE).astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    faces = cv2.dilate(free.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool) & ~free
    slam = np.where(free, FREE, UNKNOWN).astype(np.uint8)
    slam[faces & (rng.random(faces.shape) > 0.1)] = OCCUPIED
    return cad, slam


def write_pairs(root, count=6, side=32, split="train", manifest=False, first=0):
    lines = []
    for index in range(first, first + count):
        for name, image in zip("AB", draw_pair(index, side), strict=True):
            folder = root / split / name if split else root / name
            folder.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(folder / f"{index:03d}.png"), image)
        lines.append(
            f'{{"name": "{index:03d}", "plan_id": "p{index // 2}", "metres_per_px": 0.1}}\n'
        )
    if manifest:
        with (root / "manifest.jsonl").open("a") as file:
            file.writelines(lines)
    return root


@pytest.fixture
def make_pair():
    """Draw a pair."""
    return draw_pair


@pytest.fixture
def make_images():
    """Write a folder of pairs."""
    return write_pairs


@pytest.fixture(autouse=True)
def one_thread():
    torch = pytest.importorskip("torch")
    torch.set_num_threads(1)
