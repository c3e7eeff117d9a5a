"""What a map leaves open, and when a promise about it is kept."""

import numpy as np
import pytest

from slamgym.core.errors import ConfigError
from slamgym.core.types import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    GridFrame,
    LaserGeometry,
    OccupancyGrid,
    Pose2D,
)
from slamgym.planning import CostmapConfig, ExplorerContext, find_frontiers, make_costmap
from slamgym.planning.exploration_loop import ExplorationLoop, ExplorationLoopConfig
from slamgym.planning.frontiers import Frontier, fits_through
from slamgym.planning.promise import (
    SMALLEST_CALIBRATED,
    Promise,
    is_kept,
    is_offered,
    split_promise,
)

FRAME = GridFrame(0.05, -6.0, -6.0, 240, 240)
HERE = Pose2D(0.0, 0.0, 0.0)
EASY = Promise(0.98, None, 0.92)


def room(door=0.0, half=3.0):
    """A square room about the origin with a door of some width in its east wall [m]."""
    cells = np.full(FRAME.shape, UNKNOWN, np.uint8)
    x, y = FRAME.to_point(*np.indices(FRAME.shape))
    far = np.maximum(np.abs(x), np.abs(y))
    cells[far < half] = FREE
    cells[(far >= half) & (far < half + 0.1) & ~((x > 0.0) & (np.abs(y) < 0.5 * door))] = OCCUPIED
    return OccupancyGrid(cells, FRAME)


def test_a_robot_fits_through_a_door_and_not_through_a_slit():
    for door, fits in ((1.0, True), (0.6, True), (0.3, False)):
        costmap = make_costmap(room(door), CostmapConfig(inscribed_radius=0.1))
        (frontier,) = find_frontiers(costmap, HERE, 0.2)
        assert fits_through(costmap, frontier, 0.22) == fits


def test_a_robot_does_not_fit_through_a_frontier_shorter_than_it_is_wide_though_no_wall_is_near():
    costmap = make_costmap(OccupancyGrid(np.full(FRAME.shape, FREE, np.uint8), FRAME))
    for size, fits in ((8, False), (9, True)):  # 0.4 and 0.45 m; the robot is 0.44 m wide
        cells = np.column_stack([np.arange(size), np.full(size, 100)]).astype(np.int32)
        frontier = Frontier(size, 1.0, (0.0, 0.0), (0.0, 0.0), (0.0, 0.0), cells)
        assert fits_through(costmap, frontier, 0.22) == fits


def test_nothing_is_promised_of_small_maps_with_a_way_on_and_where_ways_on_are_unknown():
    assert is_kept(EASY, [], 1000.0)
    assert is_kept(EASY, [], SMALLEST_CALIBRATED)
    assert not is_kept(EASY, [], SMALLEST_CALIBRATED - 1.0)
    assert not is_kept(EASY, None, 50.0)
    costmap = make_costmap(room(1.0), CostmapConfig(inscribed_radius=0.1))
    assert not is_kept(EASY, find_frontiers(costmap, HERE, 0.2), 50.0)


@pytest.mark.parametrize(
    ("text", "promise"),
    [
        ("98%:95%", Promise(0.98, None, 0.95)),
        ("99.5%", Promise(0.995, None, 0.95)),
        ("2m2:90%", Promise(None, 2.0, 0.9)),
    ],
)
def test_a_promise_is_read_as_it_is_written(text, promise):
    assert Promise.parse(text) == promise
    assert Promise.parse(str(promise)) == promise
    assert split_promise(f"rl@{text}") == ("rl", promise)


def test_what_is_no_promise_is_refused_and_part_of_a_name():
    for text in ("98", "98%:", "100%", "2m2:100%", "most"):
        with pytest.raises(ConfigError):
            Promise.parse(text)
    with pytest.raises(ConfigError, match="share to be seen or of an area"):
        Promise(0.98, 2.0)
    assert split_promise("rl:me@home/policy") == ("rl:me@home/policy", None)


def test_a_promise_is_offered_if_no_more_explorations_broke_it_than_it_allows_with_one_to_spare():
    share = np.append(np.full(2, 0.03), np.zeros(37))  # two of 39 saw too little
    unseen = {"share": share, "area": 100.0 * share}
    for confidence, offered in ((0.9, True), (0.925, True), (0.93, False), (0.95, False)):
        assert is_offered(Promise(0.98, None, confidence), unseen) == offered
        assert is_offered(Promise(None, 2.0, confidence), unseen) == offered
    assert is_offered(Promise(0.96, None, 0.975), unseen)
    assert not is_offered(Promise(0.96, None, 0.98), unseen)  # 39 explorations can't show that


def test_what_the_package_can_keep_is_offered():
    assert is_kept(Promise.parse("98%:90%"), [], 50.0)
    assert not is_kept(Promise.parse("99.99%:99.99%"), [], 50.0)


def see(loop, door, time):
    loop.observe(
        {
            "map": room(door).cells[np.newaxis],
            "scan": np.full(180, 3.5, np.float32),
            "pose": np.array(HERE, np.float32),
            "time": np.array([time], np.float32),
        }
    )


@pytest.fixture
def loop():
    """A loop that began long ago, too late for a look around, with a promise that is easily kept."""
    geometry = LaserGeometry(180, -np.pi / 2, np.pi / 179, 0.12, 3.5)
    loop = ExplorationLoop(ExplorerContext(FRAME, geometry), ExplorationLoopConfig(promise=EASY))
    loop._recovery.note_time(0.0)
    return loop


@pytest.mark.parametrize(("door", "ends"), [(0.0, True), (1.0, False)])
def test_the_loop_ends_where_the_promise_is_kept_and_goes_on_where_a_door_is_open(loop, door, ends):
    for time in range(60, 66, 2):
        assert not loop.finished
        see(loop, door, time)
    # While nothing is offered the next of the two narrower footprints may find something.
    assert loop.finished == ends


def test_a_door_that_was_given_up_is_a_way_on_until_it_was_offered_again(loop):
    see(loop, 2.0, 60)
    (door,) = loop.candidates
    assert loop.ways_on() == [door.frontier]
    loop._blacklist.add(door, reached=True)
    loop._offer()
    assert loop.candidates == []
    assert loop.ways_on() is None  # something is still to be tried
    loop.candidates = [door]
    assert len(loop.ways_on()) == 1
    loop._recovery.round = 1
    loop._blacklist.add(door, reached=True)
    loop._offer()
    loop.candidates = [door]
    assert loop.ways_on() == []


def corridor(blocked):
    """The room, and a metre of a corridor behind its door, in which somebody may stand."""
    grid = room(1.0)
    x, y = FRAME.to_point(*np.indices(FRAME.shape))
    grid.cells[(x > 2.9) & (x < 4.0) & (np.abs(y) < 0.5)] = FREE
    grid.cells[(x > 2.9) & (x < 4.0) & (np.abs(np.abs(y) - 0.525) < 0.05)] = OCCUPIED
    if blocked:
        grid.cells[(np.abs(x - 3.025) < 0.03) & (np.abs(np.abs(y) - 0.2) < 0.1)] = OCCUPIED
    return grid


@pytest.mark.parametrize("leaves", [True, False])
def test_somebody_in_the_only_door_is_given_time_to_leave_it(loop, leaves):
    here, legs = Pose2D(2.85, 0.0, 0.0), np.zeros(180, np.float32)
    legs[80:100] = 0.2
    offered = []
    for time in np.arange(60.0, 90.0, 0.2):
        grid = corridor(blocked=time > 62.0 and not (leaves and time > 66.0))
        loop.observe(
            {
                "map": grid.cells[np.newaxis],
                "scan": legs,
                "pose": np.array(here, np.float32),
                "time": np.array([time], np.float32),
            }
        )
        offered.append(len(loop.candidates))
        loop.command()
    assert offered[0] > 0
    assert 0 in offered
    assert loop.finished != leaves  # and if the door stays closed, that is believed in the end
    assert (offered[-1] > 0) == leaves


def test_a_promise_is_true_of_a_share_or_of_an_area():
    share, area = Promise.parse("98%:95%"), Promise.parse("2m2:90%")
    assert share.holds(0.98, 500.0)
    assert not share.holds(0.979, 10.0)
    assert area.holds(0.985, 100.0)
    assert not area.holds(0.97, 100.0)
