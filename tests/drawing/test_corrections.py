"""The map overrules a model, and rooms that were only partly seen are unexplored."""

from dataclasses import dataclass

import numpy as np
import pytest
import shapely
from drawing.painted import Painted, painted, shares
from shapely import Polygon, affinity

from slamgym.core.types import FREE, UNKNOWN, OccupancyGrid
from slamgym.drawing import make_drawing
from slamgym.drawing.evidence import filled
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

    def layers(self, grid: OccupancyGrid, angle_deg: float) -> MapLayers:
        layers = self.floor.layers(grid, angle_deg)
        free = np.where(shares(self.part, grid.frame) >= 0.5, np.float32(self.sure), layers.free)
        return MapLayers.of_floor(free, layers.door > 0.0)


@pytest.mark.parametrize("turn", [0.0, 20.0])
@pytest.mark.parametrize(("sure", "drawn"), [(0.75, False), (0.95, True)])
def test_floor_that_nobody_has_seen_takes_a_sure_model(turn, sure, drawn):
    wardrobe = shapely.box(3.0, 0.0, 5.0, 0.9)
    grid, _, _ = painted(HALL.difference(wardrobe), turn_deg=turn)
    hall, behind = (affinity.rotate(shape, turn, origin=(0, 0)) for shape in (HALL, wardrobe))
    drawing = make_drawing(grid, model=Unsure(Painted(hall), behind, sure))
    hidden = 0.0 if drawn else wardrobe.area
    # Beside the free space, where faces lie, the model is right.
    assert drawing.area == pytest.approx(HALL.area - hidden, abs=0.5)


@pytest.mark.parametrize("turn", [0.0, 20.0])
@pytest.mark.parametrize(("reaches", "parted"), [(4.0, True), (2.0, False)])
def test_what_nobody_has_seen_between_two_rooms_is_no_floor_and_a_cupboard_in_one_is(turn, reaches, parted):
    """A block that leaves a door's width between two rooms stays; one that leaves them a hall is furniture."""
    block, rest = shapely.box(3.8, 0.0, 4.6, reaches), shapely.box(3.8, reaches, 4.6, 5.0)
    grid, _, _ = painted(HALL.difference(block), turn_deg=turn)
    hall, hidden, door = (affinity.rotate(shape, turn, origin=(0, 0)) for shape in (HALL, block, rest))
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


@pytest.mark.parametrize("turn", [0.0, 20.0])
def test_what_was_only_partly_seen_through_a_door_is_unexplored(turn):
    """A fan of rays behind a door ends at nothing: no room, no walls, but a door that leads there."""
    door = shapely.box(8.0, 2.0, 8.1, 2.9)
    fan = Polygon([(8.1, 2.0), (11.0, 0.9), (11.0, 4.0), (8.1, 2.9)])
    floor = shapely.union_all([HALL, door, fan])
    grid, _, _ = painted(floor, turn_deg=turn)
    turned, beyond = (affinity.rotate(shape, turn, origin=(0, 0)) for shape in (floor, fan))
    near = filled(beyond.buffer(0.15), grid.frame) & ~filled(
        affinity.rotate(HALL.buffer(0.12), turn, origin=(0, 0)), grid.frame
    )
    cells = np.where(near & (grid.cells != FREE), np.uint8(UNKNOWN), grid.cells)  # its echoes are taken away
    drawing = make_drawing(OccupancyGrid(cells, grid.frame), model=Painted(turned))
    (room,) = drawing.rooms
    assert room.area == pytest.approx(HALL.area, abs=0.7)
    (way,) = drawing.doors
    assert way.rooms == (room.id,)
    assert way.width == pytest.approx(0.9, abs=0.1)
    assert sum(part.intersection(beyond).area for part in drawing.unexplored) > 0.8 * fan.area
    assert drawing.area == pytest.approx(HALL.area, abs=0.7)
    assert all(wall.polygon.intersection(beyond.buffer(-0.3)).area < 1e-3 for wall in drawing.walls)


def test_a_map_that_shows_few_walls_is_drawn_all_the_same():
    """Where most rooms end at nothing that is how the robot maps, not what it glimpsed."""
    floor = shapely.union_all(
        [shapely.box(0, 0, 4, 4), shapely.box(4.1, 0, 8, 4), shapely.box(4.0, 1.5, 4.1, 2.4)]
    )
    grid, _, _ = painted(floor)
    few = grid.cells.copy()
    few[:, 20:][few[:, 20:] != FREE] = UNKNOWN
    drawing = make_drawing(OccupancyGrid(few, grid.frame), model=Painted(floor))
    assert drawing.area == pytest.approx(floor.area, abs=0.7)
    assert not drawing.unexplored


def test_a_corridor_that_a_pilaster_narrows_has_no_door_there():
    corridor = shapely.box(0, 0, 12, 1.8)
    grid, _, model = painted(corridor.difference(shapely.box(5.9, 0.0, 6.1, 0.4)))
    assert len(make_drawing(grid, model=model).rooms) == 1
    # A door to the hall at its end is one.
    door = shapely.box(12.0, 0.5, 12.1, 1.4)
    grid, _, model = painted(shapely.union_all([corridor, door, shapely.box(12.1, 0, 18, 5)]))
    assert len(make_drawing(grid, model=model).rooms) == 2
