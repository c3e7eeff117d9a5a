"""What the network foresees, and the rule that goes by it."""

import numpy as np
import pytest

from slamgym.agents.explorer import FrontierExplorer
from slamgym.agents.foresight import (
    FORESIGHT_CELL,
    WINDOW_PX,
    Foreseen,
    expected_areas,
    pretrained_completion,
    window_about,
)
from slamgym.agents.registry import make_explorer
from slamgym.agents.rules import ForesightTour
from slamgym.cad import open_plans
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, OccupancyGrid, Pose2D
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.envs.episode import episode_steps
from slamgym.slam import SlamConfig

FRAME = GridFrame(0.05, -8.0, -8.0, 320, 320)


def half_seen_room():
    """The west half of a room of 6 m x 4 m about the origin; its walls go on to the east."""
    cells = np.full(FRAME.shape, UNKNOWN, np.uint8)
    x, y = FRAME.to_point(*np.indices(FRAME.shape))
    cells[(np.abs(y) < 2.1) & (x > -3.1) & (x < 0.0)] = OCCUPIED
    cells[(np.abs(y) < 2.0) & (x > -3.0) & (x < 0.0)] = FREE
    return OccupancyGrid(cells, FRAME)


@pytest.mark.parametrize("pose", [Pose2D(-1.0, 0.3, 0.0), Pose2D(-1.0, -1.7, 2.0), Pose2D(-2.5, 1.0, 0.0)])
def test_the_window_shows_the_map_where_its_frame_says(pose):
    grid = half_seen_room()
    shares, frame = window_about(grid, pose)
    assert shares.shape == (2, WINDOW_PX, WINDOW_PX)
    row, col = frame.to_cell(-1.0, 0.5)
    assert shares[0, row, col] == 1.0
    row, col = frame.to_cell(-1.0, 2.05)
    assert shares[1, row, col] > 0.0
    free = np.count_nonzero(grid.cells == FREE) * 0.05**2
    assert shares[0].sum() * FORESIGHT_CELL**2 == pytest.approx(free, rel=1e-3)


def test_floor_is_foreseen_beyond_the_frontier_and_not_beyond_the_walls():
    foreseen = pretrained_completion().complete(half_seen_room(), Pose2D(-1.0, 0.0, 0.0))
    floor = foreseen.floor.mean(axis=0)

    def at(x, y):
        return float(floor[foreseen.frame.to_cell(x, y)])

    assert at(0.7, 0.0) > 2.0 * at(-4.5, 0.0)
    assert at(-1.5, 0.0) < 0.05  # seen already
    again = pretrained_completion().complete(half_seen_room(), Pose2D(-1.0, 0.0, 0.0))
    assert np.array_equal(foreseen.floor, again.floor)
    assert foreseen.floor.std(axis=0).max() > 0.01


def foreseen_square(wall):
    """Unseen floor of 2 m x 2 m to the east of the middle, behind a wall or not."""
    frame = GridFrame(
        FORESIGHT_CELL,
        -0.5 * WINDOW_PX * FORESIGHT_CELL,
        -0.5 * WINDOW_PX * FORESIGHT_CELL,
        WINDOW_PX,
        WINDOW_PX,
    )
    x, y = frame.to_point(*np.indices(frame.shape))
    floor = ((x > 0.2) & (x < 2.2) & (np.abs(y) < 1.0)).astype(np.float32)
    walls = np.where(np.abs(x - 0.3) < 0.09, wall, 0.0).astype(np.float32)
    return Foreseen(np.stack([floor, 0.5 * floor]), np.stack([walls, walls]), frame)


def test_expected_areas_are_those_of_the_floor_in_sight_and_nearest():
    points = np.array([[0.0, 0.0], [-4.0, 0.0]])
    open_view, closed = (expected_areas(foreseen_square(wall), points) for wall in (0.0, 1.0))
    assert open_view.pocket == pytest.approx([3.0, 0.0], abs=0.4)  # the mean of all of it and of half
    assert open_view.pocket_doubt == pytest.approx([1.0, 0.0], abs=0.2)
    assert open_view.in_sight[0] == pytest.approx(3.0, abs=0.8)
    assert open_view.in_sight[1] == closed.in_sight[1] == 0.0
    assert closed.in_sight[0] < 0.05
    nothing = expected_areas(foreseen_square(0.0), np.zeros((0, 2)))
    assert nothing.pocket.shape == nothing.in_sight.shape == (0,)


def test_the_rule_explores_a_home():
    plan = open_plans("procedural:home:3").load("home_3_00003")
    env = ExploreEnv(
        plan, ExploreConfig(slam=SlamConfig(mode="ground_truth")).for_explorer(), time_limit=400.0
    )
    explorer = make_explorer("foresight@95%:50%", env.explorer_context())
    for info in episode_steps(env, explorer, env.reset(seed=5)):
        coverage = info["coverage"]
    assert explorer.finished
    assert coverage > 0.9


def test_a_frontier_that_hides_nothing_is_left_for_the_end(monkeypatch):
    from slamgym.agents import rules
    from slamgym.agents.foresight import ExpectedArea

    env = ExploreEnv("bundled", ExploreConfig(slam=SlamConfig(mode="ground_truth")).for_explorer())
    explorer = FrontierExplorer(env.explorer_context(), ForesightTour())
    steps = episode_steps(env, explorer, env.reset(seed=2))
    for _ in steps:
        loop = explorer._pilots[0].loop if explorer._pilots else None
        if loop and len(loop.candidates) > 1:
            break
    count = len(loop.candidates)
    area = np.zeros(count)
    area[-1] = 5.0
    monkeypatch.setattr(rules, "foresee", lambda _: ExpectedArea(area, 0.0 * area, area, 0.0 * area))
    scores = ForesightTour()(loop)
    assert int(np.argmax(scores)) == count - 1
