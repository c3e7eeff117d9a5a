"""Maps of large buildings are real: what reading, writing and making one costs grows with it, not with its square."""

import dataclasses
import json

import cv2
import numpy as np
from growth import MOST, growth
from room_drive import good_drive

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, OccupancyGrid
from slamgym.interop import read_map, read_ros_map, write_ros_map
from slamgym.slam import SlamConfig
from slamgym.slam.replay import replay

CELLS = 800**2
ROOMS = 400
SCANS = 100


def map_of_rooms(count):
    """A map of so many cells with a room for each 30 x 30 of them."""
    side = round(count**0.5)
    along = np.arange(side) % 30
    cells = np.full((side, side), FREE, np.uint8)
    cells[along < 2] = OCCUPIED
    cells[:, along < 2] = OCCUPIED
    cells[(along >= 10) & (along < 14)] = UNKNOWN
    return OccupancyGrid(cells, GridFrame(0.05, 0.0, 0.0, side, side))


def test_writing_and_reading_a_ros_map(tmp_path):
    maps = {count: map_of_rooms(count) for count in (CELLS, 4 * CELLS)}

    def write_and_read(count):
        return read_ros_map(write_ros_map(tmp_path / str(count), maps[count]))

    np.testing.assert_array_equal(write_and_read(CELLS).cells, maps[CELLS].cells)
    assert growth(write_and_read, CELLS) < MOST


def test_reading_a_map_from_a_picture(tmp_path):
    for count in (CELLS, 4 * CELLS):
        cv2.imwrite(str(tmp_path / f"{count}.png"), map_of_rooms(count).cells)
        text = f"image: {count}.png\nresolution: 0.05\norigin: [0, 0, 0]\n"
        (tmp_path / f"{count}.yaml").write_text(text)

    def read(count):
        return read_ros_map(tmp_path / f"{count}.yaml")

    np.testing.assert_array_equal(read(CELLS).cells, map_of_rooms(CELLS).cells)
    assert growth(read, CELLS) < MOST


def test_reading_a_vacuums_map_of_many_rooms(tmp_path):
    for count in (ROOMS, 4 * ROOMS):
        runs = [
            number
            for room in range(count)
            for row in range(28)
            for number in (30 * (room % 20), 30 * (room // 20) + row, 28)
        ]
        layers = [
            {"type": "floor", "compressedPixels": runs},
            {"type": "wall", "compressedPixels": [28, 0, 1]},
        ]
        document = {"pixelSize": 5, "layers": layers}
        (tmp_path / f"{count}.json").write_text(json.dumps(document))
    assert growth(lambda count: read_map(tmp_path / f"{count}.json"), ROOMS) < MOST


def test_making_a_map_from_a_log():
    log = good_drive()
    config = SlamConfig.for_log(log.geometry.range_max, log.geometry.num_beams)

    def make(count):
        part = dataclasses.replace(log, records=log.records[:count], recorded_track=None)
        return replay(part, config, np.random.default_rng(0))

    assert growth(make, SCANS) < MOST
