"""The map overrules a model."""

from dataclasses import dataclass

import numpy as np
import pytest
import shapely
from drawing.painted import Painted, painted, shares
from shapely import affinity

from slamgym.core.types import OccupancyGrid
from slamgym.drawing import make_drawing
from slamgym.metrics.layers import MapLayers

HALL = shapely.box(0, 0, 8, 5)


@pytest.mark.parametrize("turn", [0.0, 20.0])
def test_a_wall_that_was_seen_from_both_sides_is_drawn_against_the_model(turn):
    wall, door = shapely.box(4.0, 1.0, 4.1, 5.0), shapely.box(4.0, 0.0, 4.1, 1.0)
    grid, _, _ = painted(HALL.difference(wall), turn_deg=turn)
    blind = Painted(*(affinity.rotate(shape, turn, origin=(0, 0)) for shape in (HALL, door)))
    drawing = make_drawing(grid, model=blind)
    assert len(drawing.rooms) == 2
    (door,) = drawing.doors
    assert door.width == pytest.approx(1.0, abs=0.15)


@dataclass
class Unsure:
    """A model that gives part of its floor another probability."""

    floor: Painted
    part: shapely.Polygon
    sure: float

    def __call__(self, grid: OccupancyGrid, angle_deg: float) -> MapLayers:
        layers = self.floor(grid, angle_deg)
        free = np.where(shares(self.part, grid.frame) >= 0.5, np.float32(self.sure), layers.free)
        return MapLayers.of_floor(free, layers.door > 0.0)


@pytest.mark.parametrize("turn", [0.0, 20.0])
@pytest.mark.parametrize(("sure", "drawn"), [(0.25, False), (0.75, True)])
def test_floor_that_nobody_has_seen_at_one_room_is_drawn_as_the_model_has_it(turn, sure, drawn):
    wardrobe = shapely.box(3.0, 0.0, 5.0, 0.9)
    grid, _, _ = painted(HALL.difference(wardrobe), turn_deg=turn)
    hall, behind = (affinity.rotate(shape, turn, origin=(0, 0)) for shape in (HALL, wardrobe))
    drawing = make_drawing(grid, model=Unsure(Painted(hall), behind, sure))
    hidden = 0.0 if drawn else wardrobe.area
    # Beside the free space, where faces lie, the model is right.
    assert drawing.area == pytest.approx(HALL.area - hidden, abs=0.5)


@pytest.mark.parametrize("turn", [0.0, 20.0])
@pytest.mark.parametrize(("reaches", "parted"), [(4.0, True), (2.0, False)])
def test_what_nobody_has_seen_between_two_rooms_is_no_floor_and_a_cupboard_in_one_is(
    turn, reaches, parted
):
    """A block that leaves a door's width between two rooms stays; one that leaves them a hall is furniture."""
    block, rest = shapely.box(3.8, 0.0, 4.6, reaches), shapely.box(3.8, reaches, 4.6, 5.0)
    grid, _, _ = painted(HALL.difference(block), turn_deg=turn)
    hall, hidden, door = (
        affinity.rotate(shape, turn, origin=(0, 0)) for shape in (HALL, block, rest)
    )
    drawing = make_drawing(grid, model=Unsure(Painted(hall, door), hidden, 0.98))
    assert len(drawing.rooms) == (2 if parted else 1)
    assert drawing.area == pytest.approx(HALL.area - parted * block.area, abs=1.2)


def test_an_island_that_nobody_looked_into_is_furniture():
    """Passages beside it are as narrow as doors, but it stands at no wall."""
    island = shapely.box(3.5, 1.0, 4.5, 4.0)
    grid, _, _ = painted(HALL.difference(island))
    drawing = make_drawing(grid, model=Unsure(Painted(HALL), island, 0.98))
    assert len(drawing.rooms) == 1
    assert drawing.area == pytest.approx(HALL.area, abs=0.5)


def test_a_corridor_that_a_pilaster_narrows_has_no_door_there():
    corridor = shapely.box(0, 0, 12, 1.8)
    grid, _, model = painted(corridor.difference(shapely.box(5.9, 0.0, 6.1, 0.4)))
    assert len(make_drawing(grid, model=model).rooms) == 1
    # A door to the hall at its end is one.
    door = shapely.box(12.0, 0.5, 12.1, 1.4)
    grid, _, model = painted(shapely.union_all([corridor, door, shapely.box(12.1, 0, 18, 5)]))
    assert len(make_drawing(grid, model=model).rooms) == 2
