"""What a map leaves open, and when a promise about it is kept."""

from dataclasses import replace

import numpy as np
import pytest

from slamgym.core.errors import ConfigError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, LaserGeometry, OccupancyGrid, Pose2D
from slamgym.planning import ExplorerContext
from slamgym.planning.exploration_loop import ExplorationLoop, ExplorationLoopConfig
from slamgym.planning.promise import (
    FAMILIAR_AREA,
    LARGEST_CALIBRATED,
    Promise,
    UnseenFloor,
    is_kept,
    pretrained_limit,
    pretrained_unseen_floor,
    split_promise,
)
from slamgym.planning.remaining import FRONTIER_FEATURES, measure_remains

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


def remains_of(grid, offered=()):
    return measure_remains(grid, HERE, 0.22, 3.5, offered)


def test_a_closed_room_has_no_frontier_and_a_door_is_one():
    closed, opened = remains_of(room()), remains_of(room(door=1.0), offered=[(3.05, 0.0)])
    assert len(closed.frontiers) == 0
    assert closed.known_area == pytest.approx(36.0, rel=0.05)
    (door,) = opened.frontiers
    values = dict(zip(FRONTIER_FEATURES, door, strict=True))
    assert 3.0 * values["size"] == pytest.approx(1.0, abs=0.2)
    assert values["offered"] == 1.0
    assert values["opening"] == pytest.approx(0.5, abs=0.1)
    (alone,) = remains_of(room(door=1.0)).frontiers
    assert dict(zip(FRONTIER_FEATURES, alone, strict=True))["offered"] == 0.0


def test_an_open_door_leaves_more_to_be_expected_than_a_closed_room():
    unseen = pretrained_unseen_floor()
    closed, opened = remains_of(room()), remains_of(room(door=1.0), offered=[(3.05, 0.0)])
    assert unseen.area_behind(opened).shape == (1,)
    assert unseen.share(opened) > 3.0 * unseen.share(closed)


def test_an_open_door_counts_as_much_in_a_school_as_in_a_home():
    unseen = pretrained_unseen_floor()
    opened = remains_of(room(door=1.0), offered=[(3.05, 0.0)])
    small, home, school = (
        unseen.share(replace(opened, known_area=area)) for area in (36.0, FAMILIAR_AREA, 3000.0)
    )
    assert small > home == school


def test_beyond_the_floor_of_a_home_a_way_on_is_taken_before_a_promise_is_kept():
    opened = remains_of(room(door=1.0), offered=[(3.05, 0.0)])
    loose = Promise(0.5, None, 0.5)
    assert is_kept(loose, replace(opened, known_area=FAMILIAR_AREA))
    larger = replace(opened, known_area=FAMILIAR_AREA + 1.0)
    assert not is_kept(loose, larger)
    for name in ("offered", "in_reach"):
        frontiers = opened.frontiers.copy()
        frontiers[:, FRONTIER_FEATURES.index(name)] = 0.0
        assert is_kept(loose, replace(larger, frontiers=frontiers))


def test_nothing_is_promised_in_buildings_larger_than_the_calibrated_ones():
    closed = remains_of(room())
    assert is_kept(EASY, replace(closed, known_area=LARGEST_CALIBRATED))
    assert not is_kept(EASY, replace(closed, known_area=LARGEST_CALIBRATED + 1.0))


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


def calibrated(lowest_while_broken):
    """An estimate whose explorations break a promise of 98 % until their estimate falls to some value."""
    rows = [
        row
        for index, low in enumerate(lowest_while_broken)
        for row in ((index, 0.5, 0.5, 50.0), (index, low, 0.03, 3.0), (index, 0.0, 0.001, 0.1))
    ]
    names = ("exploration", "estimate", "share", "area")
    return UnseenFloor(dict(zip((f"calibration.{name}" for name in names), np.array(rows).T, strict=True)))


def test_the_limit_lets_no_more_explorations_fail_than_promised_with_one_to_spare():
    lows = np.arange(1, 20) / 100.0  # 19 explorations
    unseen = calibrated(lows)
    for confidence, failures in ((0.95, 0), (0.9, 1), (0.5, 9)):
        limit = unseen.limit(Promise(0.98, None, confidence))
        assert np.count_nonzero(lows < limit) == failures
    assert unseen.limit(Promise(0.98, None, 0.99)) == 0.0  # 19 explorations can't show that
    assert unseen.limit(Promise(None, 5.0, 0.95)) == pytest.approx(0.5)
    assert unseen.limit(Promise(None, 2.0, 0.95)) == pytest.approx(0.01)


def test_an_exploration_that_never_sees_enough_allows_no_limit():
    unseen = calibrated([0.1])
    unseen._arrays["calibration.share"][-1] = 0.05
    assert unseen.limit(Promise(0.98, None, 0.5)) == 0.0


def test_weaker_promises_stop_sooner():
    limits = [pretrained_limit(Promise.parse(text)) for text in ("98%:95%", "98%:90%", "95%:90%", "95%:50%")]
    assert limits == sorted(limits)
    assert limits[0] > 0.0


def test_the_loop_ends_where_the_promise_is_kept_and_goes_on_where_a_door_is_open():
    geometry = LaserGeometry(180, -np.pi / 2, np.pi / 179, 0.12, 3.5)
    lax = Promise(0.5, None, 0.5)
    for door, promise, ends_at in ((0.0, EASY, 64), (1.0, lax, 60), (1.0, EASY, None)):
        loop = ExplorationLoop(ExplorerContext(FRAME, geometry), ExplorationLoopConfig(promise=promise))
        loop._recovery.note_time(0.0)  # it began long ago: too late for a look around
        ended = []
        for time in range(60, 66, 2):
            see(loop, door, time)
            ended += [time] if loop.finished else []
        # While nothing is offered the next of the two narrower footprints may find something.
        assert ended[:1] == ([ends_at] if ends_at else [])


def see(loop, door, time):
    loop.observe(
        {
            "map": room(door).cells[np.newaxis],
            "scan": np.full(180, 3.5, np.float32),
            "pose": np.array(HERE, np.float32),
            "time": np.array([time], np.float32),
        }
    )


def test_a_promise_is_true_of_a_share_or_of_an_area():
    share, area = Promise.parse("98%:95%"), Promise.parse("2m2:90%")
    assert share.holds(0.98, 500.0)
    assert not share.holds(0.979, 10.0)
    assert area.holds(0.985, 100.0)
    assert not area.holds(0.97, 100.0)
