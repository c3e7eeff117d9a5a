"""When nothing is left to explore."""

import numpy as np
import pytest

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, OccupancyGrid, Pose2D
from slamgym.envs import completion
from slamgym.envs.completion import CompletionDetector
from slamgym.planning import make_costmap

RESOLUTION = 0.05
POSE = Pose2D(1.5, 1.5, 0.0)


def room(opening: float = 0.0, wall: int = OCCUPIED) -> OccupancyGrid:
    """A known room of 3 x 3 m with walls all round, but for an opening [m] in the right one."""
    cells = np.full((100, 100), UNKNOWN, dtype=np.uint8)
    cells[19:81, 19:81] = wall
    cells[20:80, 20:80] = FREE
    half = round(0.5 * opening / RESOLUTION)
    cells[50 - half : 50 + half, 80] = FREE
    return OccupancyGrid(cells, GridFrame(RESOLUTION, -1.0, -1.0, 100, 100))


def test_a_closed_room_is_explored():
    assert CompletionDetector(0.22, 0.35).is_explored(room(), POSE)


def test_a_tight_map_that_ends_in_free_cells_is_not():
    cells = np.full((40, 40), FREE, dtype=np.uint8)
    grid = OccupancyGrid(cells, GridFrame(RESOLUTION, 0.5, 0.5, 40, 40))
    assert not CompletionDetector(0.22, 0.35).is_explored(grid, POSE)


@pytest.mark.parametrize(("opening", "explored"), [(0.9, False), (0.3, True), (0.1, True)])
def test_only_frontiers_of_some_size_count(opening: float, explored: bool):
    assert CompletionDetector(0.22, 0.35).is_explored(room(opening), POSE) is explored


def test_a_frontier_out_of_reach_does_not_count():
    grid = room()
    grid.cells[5:15, 40:70] = FREE  # known through a window, but no path leads there
    assert CompletionDetector(0.22, 0.35).is_explored(grid, POSE)


def test_a_robot_off_the_map_has_not_explored():
    assert not CompletionDetector(0.22, 0.35).is_explored(room(), Pose2D(50.0, 50.0, 0.0))


def test_no_search_while_the_last_frontier_stands(monkeypatch: pytest.MonkeyPatch):
    searches = []
    search = completion.frontier_runs

    def counted(*args, **kwargs):
        searches.append(1)
        return search(*args, **kwargs)

    monkeypatch.setattr(completion, "frontier_runs", counted)
    watch = CompletionDetector(0.22, 0.35)
    for _ in range(5):
        assert not watch.is_explored(room(0.9), POSE)
    assert len(searches) == 1
    # Once it is closed, a search finds that nothing else is left.
    assert watch.is_explored(room(), POSE)
    assert len(searches) == 2


def test_costs_of_the_body_are_those_of_a_costmap():
    cells = np.random.default_rng(0).choice(
        [FREE, UNKNOWN, OCCUPIED], (80, 90), p=[0.7, 0.28, 0.02]
    )
    grid = OccupancyGrid(cells.astype(np.uint8), GridFrame(RESOLUTION, 0.0, 0.0, 80, 90))
    for radius in (0.1, 0.22, 0.25):
        watch = CompletionDetector(radius, 0.35)
        expected = make_costmap(grid, watch._costs).costs
        np.testing.assert_array_equal(watch._body_costs(grid).costs, expected)
