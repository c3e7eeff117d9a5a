"""Small drives whose true transforms are known."""

import functools
import math

import cv2
import numpy as np
import pytest
from drawn_drives import FLAT, HERE, OTHER, ROUND, THERE, draw, drive

from slamgym.core.geometry import wrap_angle
from slamgym.core.types import OCCUPIED, UNKNOWN, OccupancyGrid
from slamgym.metrics.trajectory import align_se2
from slamgym.slam import SlamConfig
from slamgym.slam.graph.relative import seen_from
from slamgym.slam.merge.drawing import Picture, paint
from slamgym.slam.merge.merged import Merged, Refusal, merge_parts
from slamgym.slam.merge.merging import Part, best_places
from slamgym.slam.merge.overlay import FINE, WallAgreement, agreement, piece_numbers
from slamgym.slam.merge.verdict import SAME_BUILDING, UNKNOWN_BUILDINGS, Overlay
from slamgym.slam.replay import replay

MIRRORED = FLAT * [-1.0, 1.0, -1.0, 1.0]
# The same rooms with the door at the other end of an inner wall, and a way through it.
UPSTAIRS = np.array(FLAT)
UPSTAIRS[8:10] = [(3.0, 0.0, 3.0, 3.6), (3.0, 4.6, 3.0, 5.0)]
UP = [*THERE[:6], (3.5, 4.1), (2.3, 4.1), (2.3, 1.5)]
DRIVES = {
    "here": (FLAT, HERE),
    "there": (FLAT, THERE),
    "other": (OTHER, ROUND),
    "mirrored": (MIRRORED, (np.array(THERE) * [-1.0, 1.0]).tolist()),
    "upstairs": (UPSTAIRS, UP),
    "a corner": (FLAT, [(1, 1), (1.2, 1.2)]),
}


@functools.cache
def mapped(name):
    """A mapped drive, and the true pose of its frame in the building's."""
    walls, way = DRIVES[name]
    log, truth = drive(walls, way, seed=len(name))
    config = SlamConfig.for_log(log.geometry.range_max, log.geometry.num_beams)
    result = replay(log, config, np.random.default_rng(0))
    processed = np.searchsorted(result.trajectory.stamps, result.processed.stamps)
    frame = align_se2(result.graph.poses[:, :2], truth[processed, :2])
    return result.graph, np.array(frame)


def part(name):
    return Part.of_graph(name, mapped(name)[0])


def picture(name):
    """The map of a drive without its graph."""
    return Part.of_picture(name, mapped(name)[0].grid())


def off(first, second, found):
    """How far a transform is from the true one [m], [rad]."""
    true = seen_from(mapped(first)[1], mapped(second)[1])
    x, y, turn = seen_from(true, np.array(found))
    return math.hypot(x, y), abs(wrap_angle(turn))


@pytest.mark.parametrize(("first", "second"), [("here", "there"), ("there", "here")])
def test_the_transform_between_two_drives_is_recovered_and_one_graph_made(first, second):
    merged = merge_parts([part(first), part(second)])
    assert isinstance(merged, Merged), merged.verdict.doubt
    metres, radians = off(first, second, merged.placed[1].pose)
    # Each map bends by some centimetres over eight metres, which no transform undoes.
    assert metres < 0.1
    assert radians < math.radians(1.0)
    assert len(merged.graph.poses) == len(mapped(first)[0].poses) + len(mapped(second)[0].poses)
    ties = (merged.graph.edges.first < len(mapped(first)[0].poses)) & (
        merged.graph.edges.second >= len(mapped(first)[0].poses)
    )
    assert ties.sum() > 10
    assert np.linalg.eigvalsh(merged.placed[1].covariance).min() > 0.0


@pytest.mark.parametrize("second", ["other", "mirrored", "upstairs", "a corner"])
def test_what_does_not_belong_together_or_shows_too_little_is_refused(second):
    refusal = merge_parts([part("here"), part(second)])
    assert isinstance(refusal, Refusal)
    assert refusal.verdict.doubt
    assert refusal.part.name == second


@pytest.mark.parametrize("second", ["other", "mirrored", "upstairs"])
def test_nobody_is_believed_who_says_that_another_floor_is_the_same(second):
    assert isinstance(merge_parts([part("here"), part(second)], odds=SAME_BUILDING), Refusal)


@pytest.mark.parametrize(
    ("thing", "is_wall"),
    [
        ([(5.4, 1.0, 6.2, 1.0)], True),
        ([(5.5, 1.0, 5.7, 1.0), (5.7, 1.0, 5.7, 1.2)], False),
        ([(5.2, 1.0, 5.7, 1.0), (5.7, 1.0, 5.7, 1.5), (5.7, 1.5, 5.2, 1.5)], False),
    ],
)
def test_a_wall_in_open_floor_contradicts_and_what_was_moved_does_not(thing, is_wall):
    without = Part.of_picture("without", draw(FLAT, (1, 1)))
    walls = np.vstack([FLAT, np.array(thing, dtype=np.float64)])
    other = Part.of_picture("with", draw(walls, (1, 1)))
    said = agreement(without.fields, other.fields, np.zeros(3), FINE)
    assert said.agreed > 20.0
    assert (said.contradicted > 0.3) == is_wall


@pytest.mark.parametrize(
    ("thing", "is_in_line"), [((3.0, 1.8, 3.0, 2.8), True), ((0.8, 2.3, 2.0, 2.3), False)]
)
def test_a_wall_in_a_door_is_in_line_with_those_beside_it_and_furniture_is_not(thing, is_in_line):
    without = Part.of_picture("without", draw(FLAT, (1, 1)))
    walls = np.vstack([FLAT, np.array([thing])])
    inside = [draw(walls, place) for place in ((1, 1), (4, 1))]
    seen = [Part.of_picture("with", grid) for grid in inside]
    said = [agreement(without.fields, other.fields, np.zeros(3), FINE) for other in seen]
    assert all((one.in_line > 0.1) == is_in_line for one in said)
    assert all(one.contradicted >= one.in_line for one in said)


def test_pieces_of_wall_are_those_that_no_wide_gap_parts():
    rows, cols = np.nonzero(np.random.default_rng(0).random((60, 70)) < 0.015)
    cells = np.column_stack([rows, cols])
    image = np.zeros((60, 70), np.uint8)
    image[rows, cols] = 1
    _, pieces = cv2.connectedComponents(cv2.dilate(image, np.ones((3, 3), np.uint8)))
    numbers = piece_numbers(cells)
    pairs = np.unique(np.column_stack([numbers, pieces[rows, cols]]), axis=0)
    assert len(pairs) == numbers.max() + 1 == len(np.unique(pieces)) - 1 > 5


def test_the_place_with_most_agreement_is_joined_though_bent_walls_contradict_there():
    bent = WallAgreement(agreed=600.0, contradicted=10.0, moved=0.0)
    aligned = Overlay(np.zeros(3), np.eye(3), bent, UNKNOWN_BUILDINGS.evidence(bent))
    others = [
        Overlay(np.array([x, 0.0, 0.0]), np.eye(3), WallAgreement(50.0, 0.5, 0.0), 0.5)
        for x in (5.0, 10.0, 15.0)
    ]
    best = best_places([aligned, *others], part("here"), UNKNOWN_BUILDINGS, 2)
    assert [float(one.pose[0]) for one in best] == [5.0, 10.0, 0.0]


def test_each_part_of_a_bent_picture_is_laid_where_the_walls_near_it_are():
    fields = picture("here").fields
    off_place = np.array([0.12, -0.1, 0.02])
    rigid = agreement(fields, fields, off_place, FINE)
    bent = agreement(fields, fields, off_place, FINE, is_bent=True)
    assert bent.agreed > 1.2 * rigid.agreed
    # What is too far from walls that it could be is left where it is.
    far = np.array([2.0, 1.3, 0.6])
    assert agreement(fields, fields, far, FINE, is_bent=True).agreed < 0.5 * bent.agreed


def test_a_guess_is_made_where_it_is_asked_for_and_stays_in_doubt():
    merged = merge_parts([part("here"), part("a corner")], guess=True)
    assert isinstance(merged, Merged)
    assert merged.placed[1].verdict.doubt


def test_a_third_drive_joins_those_that_are_one_already():
    merged = merge_parts([part("here"), part("there"), part("here")])
    assert isinstance(merged, Merged), merged.verdict.doubt
    assert len(merged.graph.drives) == 3
    # The same drive lies where it lay.
    assert np.abs(merged.placed[2].pose).max() < 0.03


@pytest.mark.parametrize("kinds", [(picture, picture), (part, picture), (picture, part)])
def test_bare_pictures_are_laid_where_they_belong(kinds):
    merged = merge_parts([kinds[0]("here"), kinds[1]("there")])
    assert isinstance(merged, Merged), merged.verdict.doubt
    metres, radians = off("here", "there", merged.placed[1].pose)
    assert metres < 0.1
    assert radians < math.radians(1.0)
    known = merged.grid().cells != UNKNOWN
    own = mapped("here")[0].grid().cells != UNKNOWN
    assert known.sum() > own.sum()


@pytest.mark.parametrize("second", ["other", "mirrored"])
def test_pictures_of_different_buildings_are_refused(second):
    assert isinstance(merge_parts([picture("here"), picture(second)]), Refusal)


def test_what_the_first_picture_knows_stands_cell_by_cell():
    grid = draw(FLAT, (1, 1))
    half = grid.cells.copy()
    half[:, 80:] = UNKNOWN
    turned = np.array([0.3, -0.2, 0.5])
    pictures = [Picture(OccupancyGrid(half, grid.frame), np.zeros(3)), Picture(grid, turned)]
    painted = paint(pictures, grid.frame)
    row, col = painted.frame.to_cell(grid.frame.origin_x + 1e-6, grid.frame.origin_y + 1e-6)
    rows, cols = half.shape
    there = painted.cells[row - rows + 1 : row + 1, col : col + cols]
    assert np.array_equal(there[half != UNKNOWN], half[half != UNKNOWN])
    # Walls stay whole however they are turned.
    assert (painted.cells == OCCUPIED).sum() > 1.3 * (half == OCCUPIED).sum()
