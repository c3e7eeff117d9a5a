"""Scans aligned with the graph's submaps, searched in a window, and matched with the particle filter's maps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, OccupancyGrid
from slamgym.sim.raycast import cast_rays
from slamgym.slam.branch_and_bound import block_score, maxima, search_blocks, turned_cells
from slamgym.slam.config import SlamConfig
from slamgym.slam.end_points import NORMAL_GAP, surface_normals, surfaces_going_on
from slamgym.slam.graph.alignment import FACES, AlignmentTarget
from slamgym.slam.graph.matching import SearchWindow, score_levels
from slamgym.slam.graph.submaps import (
    HAS_NORMAL,
    SUBMAP_CELL,
    Submap,
    known_submap,
    known_surfaces,
    oriented,
)
from slamgym.slam.hill_climbing import match_particles
from slamgym.slam.particle_filter import match_settings
from slamgym.slam.particles import ParticleMaps

ROOM = np.array(
    [(-4, -3, 5, -3), (5, -3, 5, 2), (5, 2, 1, 2), (1, 2, 1, 4), (1, 4, -4, 4), (-4, 4, -4, -3),
     (2, -1, 3, -1), (3, -1, 3, 0), (3, 0, 2, 0), (2, 0, 2, -1)], dtype=np.float64,
)  # fmt: skip
CORRIDOR = np.array([(-100, -1, 100, -1), (-100, 1, 100, 1)], dtype=np.float64)
BEAMS = 181
UNKNOWN_PLACE = np.zeros((3, 3))


def scan_points(pose, segments=ROOM, range_max=20.0):
    """End points in the robot frame of an exact scan over half a turn."""
    ranges = np.empty(BEAMS)
    cast_rays(*pose, -np.pi / 2, np.pi / 180, segments, range_max, ranges)
    angles = -np.pi / 2 + np.radians(np.arange(BEAMS))
    hit = np.isfinite(ranges)
    return ranges[hit, None] * np.column_stack([np.cos(angles), np.sin(angles)])[hit]


# --- the graph's submaps


def with_sides(points):
    return oriented(points, np.zeros(2))


def submap(poses, segments=ROOM):
    """A submap of exact scans; its frame is the map's."""
    drawn = Submap(0, 15.0)
    for pose in poses:
        drawn.add(np.array(pose), with_sides(scan_points(pose, segments)))
    return drawn


def alone(drawn):
    return AlignmentTarget([drawn], np.zeros((1, 3)))


def align(drawn, points, start, known=UNKNOWN_PLACE):
    """Pose, normal matrix and fit."""
    start = np.array(start)
    placed = alone(drawn).align(with_sides(points), start, start, known)
    return placed.pose, placed.total[:3, :3], placed.fit


ROUND = [(-1.0 + 0.1 * k, 0.02 * k, 0.4 * k) for k in range(16)]


@pytest.fixture(scope="module")
def room():
    return submap(ROUND)


@settings(max_examples=25)
@given(st.floats(-0.06, 0.06), st.floats(-0.06, 0.06), st.floats(-0.05, 0.05))
def test_an_exact_scan_is_aligned_to_two_millimetres(room, dx, dy, turn):
    truth = np.array([0.1, 0.2, 0.4])
    pose, _, fit = align(room, scan_points(truth), truth + np.array([dx, dy, turn]))
    assert fit > 0.9
    assert np.hypot(*(pose - truth)[:2]) < 0.002
    assert abs(pose[2] - truth[2]) < 0.001


def test_closing_a_submap_frees_memory_and_changes_no_alignment():
    drawn, points = submap(ROUND), scan_points((0.1, 0.2, 0.4))
    before, size = align(drawn, points, (0.12, 0.18, 0.41)), drawn.grid.nbytes
    drawn.close()
    assert drawn.grid.nbytes < 0.5 * size
    after = align(drawn, points, (0.12, 0.18, 0.41))
    assert after[0] == pytest.approx(before[0], abs=1e-9)
    assert after[2] == pytest.approx(before[2])
    # Its scans can still be moved: it is drawn again.
    drawn.clear()
    for pose in ROUND:
        drawn.add(np.array(pose), with_sides(scan_points(pose)))
    assert align(drawn, points, (0.12, 0.18, 0.41))[0] == pytest.approx(before[0], abs=5e-4)


def test_the_two_faces_of_a_thin_wall_stay_apart():
    faces, drawn = np.array([(1.02, -0.7, 1.02, 0.7), (1.08, -0.7, 1.08, 0.7)]), submap([])
    for side, heading in ((-1, 0.0), (1, np.pi)):
        for away in (1.0, 1.2, 1.4):
            pose = (1.05 + side * away, 0.0, heading)
            drawn.add(np.array(pose), with_sides(scan_points(pose, faces)))
    points, sides = drawn.lines()
    assert points[sides[:, 0] < 0.0, 0] == pytest.approx(1.02, abs=1e-6)
    assert points[sides[:, 0] > 0.0, 0] == pytest.approx(1.08, abs=1e-6)
    assert (sides[:, 0] < 0.0).sum() == (sides[:, 0] > 0.0).sum() > 10
    pose, _, _ = align(drawn, scan_points((0.2, 0.0, 0.0), faces), (0.23, 0.0, 0.01))
    assert pose[[0, 2]] == pytest.approx([0.2, 0.0], abs=1e-3)


def test_the_back_of_a_wall_is_another_wall():
    front = np.array([(2.03, -3.0, 2.03, 3.0)])
    drawn = submap([(0.0, 0.1 * k, 0.0) for k in range(4)], front)
    seen = with_sides(scan_points((0.0, 0.0, 0.0), front))
    for centre, is_found in (
        (np.array([0.1, 0.1, 0.05]), True),
        (np.array([3.9, 0.1, np.pi - 0.05]), False),
    ):
        _, score = SearchWindow(alone(drawn), centre, np.array([0.5, 0.2]), 4.0).search(seen, 0.1)
        placed = alone(drawn).align_freely(seen, centre)
        assert (
            (score > 0.8 and placed.fit > 0.9) if is_found else (score <= 0.1 and placed.fit == 0.0)
        )


@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 2])
def test_nothing_binds_along_a_bare_corridor(angle):
    cos, sin = np.cos(angle), np.sin(angle)
    turned = CORRIDOR.reshape(-1, 2) @ np.array([[cos, sin], [-sin, cos]])
    walls, along, across = turned.reshape(-1, 4), np.array([cos, sin]), np.array([-sin, cos])
    drawn = submap([(*(s * along), angle) for s in (0.0, 0.1, 0.2)], walls)
    truth = np.array([*(0.1 * along + 0.05 * across), angle])
    start = truth + np.array([*(0.03 * along + 0.04 * across), 0.01])
    pose, normal, fit = align(drawn, scan_points(truth, walls), start)
    assert fit > 0.8
    assert (pose - truth)[:2] @ across == pytest.approx(0.0, abs=0.001)
    assert (pose - truth)[:2] @ along == pytest.approx(0.03, abs=0.005)
    assert along @ normal[:2, :2] @ along < 0.01 * (across @ normal[:2, :2] @ across)


def test_an_older_map_is_seen_from_its_free_side():
    cells = np.full((60, 80), UNKNOWN, np.uint8)
    cells[10:50, 10:70], cells[12:48, 12:68] = OCCUPIED, FREE
    grid = OccupancyGrid(cells, GridFrame(0.05, -2.0, -1.5, *cells.shape))
    known = known_surfaces(grid)
    points, sides = known
    assert len(points) == 2 * (36 + 56)
    assert (sides[:, :2] * points).sum(axis=1).max() < 0.0  # to the middle, where it is free
    inner = np.array(
        [
            (-1.4, -0.9, 1.4, -0.9),
            (1.4, -0.9, 1.4, 0.9),
            (1.4, 0.9, -1.4, 0.9),
            (-1.4, 0.9, -1.4, -0.9),
        ]
    )
    start = np.array([0.2, 0.1, 0.3])
    older = AlignmentTarget([known_submap(known, start)], start[None])
    # Cells are marked in their middle, half of them behind the face.
    placed = older.align(with_sides(scan_points(start, inner)), start + 0.03, start, UNKNOWN_PLACE)
    assert placed.fit > 0.4
    assert placed.pose == pytest.approx(start, abs=0.03)


# --- the search


@settings(max_examples=25)
@given(st.floats(-0.8, 0.8), st.floats(-0.8, 0.8), st.floats(-0.35, 0.35))
def test_a_search_finds_the_place_to_within_what_an_alignment_does(room, dx, dy, turn):
    truth, centre = np.array([0.1, 0.2, 0.4]), np.array([0.1 + dx, 0.2 + dy, 0.4 + turn])
    seen = with_sides(scan_points(truth))
    window = SearchWindow(alone(room), centre, np.array([1.0, 0.4]), 12.0)
    found, score = window.search(seen, 0.3)
    assert score > 0.6
    assert align(room, seen.points, found)[0] == pytest.approx(truth, abs=0.003)
    # Of what lies elsewhere, nothing fits as well; and beyond the window nothing is found.
    elsewhere, worse = window.search(seen, 0.1, found)
    assert worse < score - 0.1
    assert np.hypot(*(elsewhere - found)[:2]) >= 0.3 or worse == 0.1
    far = np.array([4.0, 0.2, 2.0])
    narrow = SearchWindow(alone(room), far, np.array([0.3, 0.1]), 12.0)
    assert narrow.search(seen, 0.7)[1] == pytest.approx(0.7, abs=0.01)


def test_branch_and_bound_finds_what_brute_force_finds():
    rng = np.random.default_rng(0)
    for _ in range(5):
        cells = (rng.random((FACES, 40, 50)) < 0.05).astype(np.uint8)
        points, towards = rng.uniform(-1.5, 1.5, (25, 2)), rng.uniform(-np.pi, np.pi, 25)
        sides = np.column_stack([np.cos(towards), np.sin(towards), np.ones(25)])
        angles = np.array([-0.2, 0.0, 0.2])
        levels = score_levels(cells, 4)
        width = levels.shape[2] // FACES
        turned = turned_cells(points, sides, 0.3 + angles, np.array([2.5, 2.0]), width)
        scan = levels, levels[:0], *turned, -7, (7, 7), 0, 0
        found = search_blocks(*scan, (0.0, 0.0, 0.0))[-1, 3]
        u, v, _, elsewhere = search_blocks(*scan, (-1.0, 2.0, 3.0))[-1]
        assert np.hypot(u + 1.0, v - 2.0) >= 3.0
        best = best_elsewhere = 0
        for angle in angles:
            c, s = np.cos(0.3 + angle), np.sin(0.3 + angle)
            u = np.floor((2.5 + c * points[:, 0] - s * points[:, 1]) / SUBMAP_CELL).astype(np.int32)
            v = np.floor((2.0 + s * points[:, 0] + c * points[:, 1]) / SUBMAP_CELL).astype(np.int32)
            quarter = np.round((towards + 0.3 + angle) / (np.pi / 2)).astype(np.int32) % FACES
            u += quarter * width
            for du, dv in np.ndindex(15, 15):
                score = block_score(levels[0], 1, u, v, du - 7, dv - 7)
                best = max(best, score)
                if np.hypot(0.1 + 0.1 * (du - 7), 0.1 * (dv - 7) - 0.2) >= 0.3:
                    best_elsewhere = max(best_elsewhere, score)
        assert (found, elsewhere) == (best, best_elsewhere)


@pytest.mark.parametrize("height", range(4))
def test_a_block_bounds_its_places_and_counts_nothing_beyond_the_grid(height):
    """Against the scores of the places themselves, also where a block hangs over the lower and the left border."""
    scores = np.random.default_rng(height).integers(1, 256, (9, 12), dtype=np.uint8)
    side = 1 << height
    around = np.pad(scores, 2 * side + 4)
    level, zero = maxima(scores, height + 1)[height], np.zeros(1, np.int32)
    for row in range(-side - 2, 12):
        for col in range(-side - 2, 15):
            first_row, first_col = row + 2 * side + 4, col + 2 * side + 4
            block = around[first_row : first_row + side, first_col : first_col + side]
            bound = block_score(level, side, zero, zero, col, row)
            assert bound >= block.max()
            if height == 0 or not block.any():
                assert bound == block.max(), (row, col)


@pytest.mark.parametrize(("stray", "is_wall"), [(0.005, True), (0.02, True), (0.05, False)])
def test_a_surface_has_a_normal_across_it_unless_its_points_stray(stray, is_wall):
    points = np.column_stack([0.1 * np.arange(9), np.full(9, 2.0)])
    points[::2, 1] += stray
    points[1::2, 1] -= stray
    near = np.full(len(points), NORMAL_GAP)
    inner = surface_normals(points, near)[3:-3]  # with three neighbours on both sides
    if is_wall:
        assert np.abs(inner[:, 1]) == pytest.approx(np.ones(3), abs=0.02)
    else:
        assert not inner.any()


def test_a_wall_seen_by_few_beams_has_lines_between_them_but_not_across_a_door():
    step = np.radians(4.0)
    beams = np.arange(-12, 13) * step
    on_wall = 2.0 * np.column_stack([np.tan(beams), np.ones(len(beams))])
    door = np.abs(on_wall[:, 0] - 0.1) < 0.45
    seen = oriented(on_wall[~door], np.zeros(2), step)
    submap = Submap(0, 5.0)
    submap.add(np.zeros(3), seen)
    lines = submap.lines().points
    assert lines[:, 1] == pytest.approx(2.0)
    assert np.diff(np.sort(lines[lines[:, 0] > 0.6, 0])).max() < 2.0 * SUBMAP_CELL
    assert not (np.abs(lines[:, 0] - 0.1) < 0.4).any()
    alone = Submap(0, 5.0)
    alone.add(np.zeros(3), seen._replace(sides=np.minimum(seen.sides, HAS_NORMAL)))
    assert len(alone.lines().points) < 0.5 * len(lines)


def test_a_wall_seen_from_far_aside_does_not_go_on_across_a_door():
    """Neighbouring beams meet it before and behind the door, 0.9 m apart on one line."""
    step = np.radians(0.5)
    normals = np.tile([0.0, -1.0], (12, 1))
    ahead = 12.0 - 0.9 * np.arange(12)
    along = np.column_stack([ahead, np.full(12, 1.0)])
    turns = np.diff(np.arctan2(along[:, 1], along[:, 0]))
    assert (turns[:2] < step).all()
    assert not going_on(along, normals, step)[:2].any()
    near = np.column_stack([np.linspace(0.9, 0.9 - 11 * 0.02, 12), np.full(12, 1.0)])
    assert going_on(near, normals, np.radians(1.0))[:-1].all()


def going_on(points, normals, spacing):
    """Where surfaces go on that a laser at the origin sees."""
    distances = np.hypot(*points.T)
    to_laser = -points / distances[:, None]
    return surfaces_going_on(points, normals, to_laser, spacing * distances, spacing)


# --- the particle filter's matcher

SEEN_FROM = [(0.0, 0.0, 0.0), (0.0, 0.0, 2.0), (0.0, 0.0, 4.0), (-1.0, 0.5, 1.0), (0.5, -1.0, -1.0)]


def particle_map(shift=(0.0, 0.0), segments=ROOM):
    """The map of one particle that knew where it was, all of it moved by ``shift``."""
    maps = ParticleMaps(1, 0.05, 100.0)
    for pose in SEEN_FROM:
        moved = np.array([pose]) + np.array([*shift, 0.0])
        maps.cover(moved, 12.0)
        maps.register(moved, scan_points(pose, segments))
    return maps


def matched(maps, predicted, points, config=None):
    """Pose and log-likelihood of a scan that is predicted at a pose."""
    poses, likelihoods = np.array([predicted], dtype=np.float64), np.zeros(1)
    match_particles(
        maps.tile_maps, poses, points, match_settings(config or SlamConfig()), likelihoods
    )
    return poses[0], likelihoods[0]


@pytest.fixture(scope="module")
def known_room():
    return particle_map()


small = st.floats(-0.07, 0.07)


@settings(max_examples=30)
@given(dx=small, dy=small, turn=st.floats(-0.04, 0.04))
def test_a_scan_comes_back_from_where_odometry_has_put_it(known_room, dx, dy, turn):
    truth = np.array([0.1, -0.15, 0.5])
    points = scan_points(truth)
    found, likelihood = matched(known_room, truth + np.array((dx, dy, turn)), points)
    # The climb is drawn to where more beams end on known walls.
    assert np.hypot(*(found - truth)[:2]) < 0.05
    assert abs(found[2] - truth[2]) < 0.05
    _, at_truth = matched(known_room, truth, points)
    assert likelihood > at_truth - 0.1


@settings(max_examples=20)
@given(st.integers(-60, 60), st.integers(-60, 60))
def test_where_the_map_lies_does_not_matter(known_room, cols, rows):
    shift = np.array([0.05 * cols, 0.05 * rows, 0.0])
    start, points = np.array([0.13, -0.1, 0.52]), scan_points((0.1, -0.15, 0.5))
    here, likelihood = matched(known_room, start, points)
    there, moved_likelihood = matched(particle_map(shift[:2]), start + shift, points)
    # A point on the border of two cells has other neighbours in each.
    assert there - shift == pytest.approx(here, abs=5e-3)
    assert moved_likelihood == pytest.approx(likelihood, rel=0.1)


def test_where_nothing_is_mapped_the_prediction_stands():
    maps = ParticleMaps(1, 0.05, 100.0)
    maps.cover(np.zeros((1, 3)), 12.0)
    points = scan_points((0.0, 0.0, 0.0))
    pose, likelihood = matched(maps, (0.3, -0.2, 0.1), points)
    assert tuple(pose) == (0.3, -0.2, 0.1)
    assert likelihood == pytest.approx(len(points) * match_settings(SlamConfig()).miss)


def test_a_match_below_the_minimum_score_is_refused(known_room):
    start, points = (0.13, -0.1, 0.52), scan_points((0.1, -0.15, 0.5))
    moved, likelihood = matched(known_room, start, points, SlamConfig(minimum_score=50.0))
    kept, unmoved_likelihood = matched(
        known_room, start, points, SlamConfig(minimum_score=BEAMS + 1.0)
    )
    assert tuple(moved) != start
    assert tuple(kept) == start
    assert unmoved_likelihood < likelihood
