"""Days of one building: what has changed is drawn as it is now, and the graph stays as large as the building."""

import functools

import numpy as np
import pytest
from drawn_drives import FLAT, HERE, drive
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN
from slamgym.slam import SlamConfig
from slamgym.slam.graph.map_graph import joined_graph
from slamgym.slam.hit_count_kernels import BeamTable
from slamgym.slam.hit_counts import HitCountMap
from slamgym.slam.merge.continuing import continue_map
from slamgym.slam.merge.days import are_smears, count_now, draw_days, sharpness
from slamgym.slam.merge.merging import Part
from slamgym.slam.merge.thinning import KEPT_DRIVES, thinned
from slamgym.slam.replay import replay

SAID = {"f": FREE, "o": OCCUPIED, ".": UNKNOWN}


@pytest.mark.parametrize(
    ("said", "counting"),
    [
        ("fff", "yyy"),
        ("o.o", "yyy"),
        ("of", "ny"),  # gone at once
        ("fo", "yn"),  # come, seen once
        ("f.o.", "yyny"),
        ("fo.o", "nyyy"),  # seen by two
        ("fof", "yny"),
        ("fofo", "ynyn"),  # each time another one
        ("ofoo", "nnyy"),
        ("..of", "nnny"),
        ("fooof", "nnnny"),
    ],
)
def test_drives_count_from_the_last_change_on(said, counting):
    votes = np.array([SAID[letter] for letter in said], np.uint8)[:, None, None]
    counts = count_now(votes)[:, 0, 0]
    # A drive that says nothing of a cell adds nothing, whether it counts or not.
    spoken = votes[:, 0, 0] != UNKNOWN
    expected = np.array([letter == "y" for letter in counting])
    assert np.array_equal(counts[spoken], expected[spoken])


def counted(row):
    """A drive that saw one row of cells: letters as in SAID, or a share of hits in tenths."""
    config = SlamConfig()
    drawn = HitCountMap(BeamTable.of(drive(FLAT, HERE[:2])[0].geometry, config), config)
    drawn.cover((0, 0, 1, len(row)))
    for col, letter in enumerate(row):
        hits = {"f": 0, "o": 10, ".": 0}.get(letter, letter)
        drawn.counts[0, col] = int(hits), 0 if letter == "." else 10
    drawn._dirty = drawn.box
    return drawn


def test_a_wall_that_a_worse_laser_smears_beside_a_sharper_one_is_left_out():
    sharp, smeared = counted("ffffffo......"), counted("fffff4555....")
    assert sharpness(sharp.counts) > sharpness(smeared.counts)
    for drives in ([sharp, smeared], [smeared, sharp]):
        are = are_smears(drives, np.ones((2, *sharp.counts.shape[:2]), dtype=bool))
        left_out = {index for index, one in enumerate(are) if one.any()}
        assert left_out == {drives.index(smeared)}
        assert np.flatnonzero(are[drives.index(smeared)][0, :13]).tolist() == [5, 6, 7, 8]


def test_the_other_face_of_a_thin_wall_is_no_smear():
    sharp, other = counted("ffffffo......"), counted("........4ffff")
    are = are_smears([sharp, other], np.ones((2, *sharp.counts.shape[:2]), dtype=bool))
    assert not are.any()


def box(x, y, side=0.5):
    corners = [(x, y), (x + side, y), (x + side, y + side), (x, y + side), (x, y)]
    return np.array([(*corners[k], *corners[k + 1]) for k in range(4)], dtype=np.float64)


OLD, NEW = (1.6, 0.4), (5.6, 0.5)
"""Where a box stood on the first day, and stands from the second day on."""


@functools.cache
def mapped(place, seed):
    """A drive past a box, mapped."""
    log, _ = drive(np.vstack([FLAT, box(*place)]), HERE, seed=seed)
    config = SlamConfig.for_log(log.geometry.range_max, log.geometry.num_beams)
    return replay(log, config, np.random.default_rng(0))


@functools.cache
def days(count):
    """The map after some days."""
    first = mapped(OLD, 1)
    if count == 1:
        return first
    older = Part.of_graph("older", days(count - 1).graph)
    return continue_map(older, mapped(NEW, 1 + (count - 1) % 3), "today")


def drawn(grid, place):
    """Share of a box's outline that is occupied on a map whose frame begins at the drive's start."""
    sides = box(*place)
    points = np.concatenate([np.linspace(side[:2], side[2:], 12) for side in sides]) - (1.0, 1.0)
    rows, cols = np.nonzero(grid.cells == OCCUPIED)
    x, y = grid.frame.to_point(rows, cols)
    turn = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    heading = np.arctan2(HERE[1][1] - HERE[0][1], HERE[1][0] - HERE[0][0])
    back = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
    placed = points @ back @ turn.T
    away = np.hypot(x[:, None] - placed[:, 0], y[:, None] - placed[:, 1]).min(axis=0)
    return float((away < 0.12).mean())


def test_what_is_gone_goes_at_once_and_what_comes_is_drawn_on_its_second_day():
    first, second, third = (days(count).grid for count in (1, 2, 3))
    # Of a box the robot sees the sides that face its way.
    assert drawn(first, OLD) > 0.4
    assert drawn(second, OLD) < 0.15
    assert drawn(second, NEW) < 0.15
    assert drawn(third, NEW) > 0.4
    assert drawn(third, OLD) < 0.15


def test_walls_stay_through_the_days():
    first, last = days(1).grid, days(6).grid
    rows, cols = np.nonzero(first.cells == OCCUPIED)
    x, y = first.frame.to_point(rows, cols)
    now_x, now_y = last.frame.to_point(*np.nonzero(last.cells == OCCUPIED))
    away = np.hypot(x[:, None] - now_x, y[:, None] - now_y).min(axis=1)
    # The box of the first day is gone: less than a tenth of what was drawn.
    assert (away < 0.1).mean() > 0.9


def test_a_graph_of_many_days_is_no_larger_than_one_of_a_few_and_hangs_together():
    few, many = days(KEPT_DRIVES).graph, days(6).graph
    assert len(many.poses) <= 1.2 * len(few.poses)
    assert len(many.drives) <= KEPT_DRIVES + 1
    ends = many.edges.first, many.edges.second
    count = len(many.poses)
    parts, _ = connected_components(coo_array((np.ones(len(ends[0])), ends), (count, count)), False)
    assert parts == 1
    assert sum(len(drive.stamps) for drive in many.drives) == count


def test_thinning_takes_out_only_what_newer_drives_or_their_own_show():
    graph = days(1).graph
    alone = thinned(graph)
    assert len(alone.poses) == len(graph.poses)
    several = graph
    for _ in range(KEPT_DRIVES):
        several = joined_graph(several, graph)
    kept = thinned(several)
    assert len(kept.drives) == KEPT_DRIVES
    assert len(kept.poses) < KEPT_DRIVES * len(graph.poses)  # the drive sees much of it twice
    before, now = draw_days(several), draw_days(kept)
    rows, cols = now.frame.to_cell(*before.frame.to_point(*np.nonzero(before.cells == OCCUPIED)))
    is_inside = (
        (rows >= 0) & (cols >= 0) & (rows < now.cells.shape[0]) & (cols < now.cells.shape[1])
    )
    assert (now.cells[rows[is_inside], cols[is_inside]] == OCCUPIED).sum() > 0.9 * len(rows)
