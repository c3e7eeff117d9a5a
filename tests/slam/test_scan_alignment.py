import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.sim.raycast import cast_rays
from slamgym.slam.branch_and_bound import block_score
from slamgym.slam.config import SlamConfig
from slamgym.slam.graph.matching import align_node, score_levels, search, search_window
from slamgym.slam.graph.surface_map import SURFACE_SIGMA, make_local_map, solve_symmetric
from slamgym.slam.particle_filter import match_settings
from slamgym.slam.particles import ParticleMaps
from slamgym.slam.scan_match import align_freely, match_particles

ROOM = np.array(
    [(-4, -3, 5, -3), (5, -3, 5, 2), (5, 2, 1, 2), (1, 2, 1, 4), (1, 4, -4, 4), (-4, 4, -4, -3),
     (2, -1, 3, -1), (3, -1, 3, 0), (3, 0, 2, 0), (2, 0, 2, -1)], dtype=np.float64,
)  # fmt: skip
CORRIDOR = np.array([(-100, -1, 100, -1), (-100, 1, 100, 1)], dtype=np.float64)
BEAMS = 181


def scan_points(pose, segments=ROOM, range_max=20.0):
    """End points in the robot frame of an exact scan over half a turn."""
    ranges = np.empty(BEAMS)
    cast_rays(*pose, -np.pi / 2, np.pi / 180, segments, range_max, ranges)
    angles = -np.pi / 2 + np.radians(np.arange(BEAMS))
    hit = np.isfinite(ranges)
    return ranges[hit, None] * np.column_stack([np.cos(angles), np.sin(angles)])[hit]


def local_map(poses, segments=ROOM):
    scans = [scan_points(pose, segments) for pose in poses]
    points, counts = np.zeros((len(scans), BEAMS, 2)), np.array([len(scan) for scan in scans])
    for k, scan in enumerate(scans):
        points[k, : len(scan)] = scan
    return make_local_map(points, counts, np.arange(len(scans)), np.array(poses), np.zeros(3), 12.0)


KNOWN = [(-1.0, 0.0, 0.0), (-0.5, 0.2, 1.5), (0.0, 0.0, 3.0), (0.3, -0.3, -1.5)]


@settings(max_examples=25)
@given(st.floats(-0.8, 0.8), st.floats(-0.8, 0.8), st.floats(-0.35, 0.35))
def test_search_and_alignment_find_the_pose_to_a_centimetre(dx, dy, turn):
    room = local_map(KNOWN)
    truth = np.array([0.1, 0.2, 0.4])
    points = scan_points(truth)
    start, score = search(room, points, truth + np.array([dx, dy, turn]), 1.0, 0.4, 0.3)
    assert score > 0.6
    match = align_node(room, points, start, start, np.zeros((3, 3)))
    assert match.fit > 0.8
    assert np.abs(match.pose - truth)[:2].max() < 0.01
    assert abs(match.pose[2] - truth[2]) < 0.005


def test_a_place_outside_the_window_is_not_found():
    room = local_map(KNOWN)
    _, score = search(room, scan_points((0.1, 0.2, 0.4)), np.array([4.0, 0.2, 2.0]), 0.3, 0.1, 0.7)
    assert score <= 0.7


def test_a_corridor_leaves_the_scan_free_to_slide():
    corridor = local_map([(0.0, 0.0, 0.0), (0.5, 0.0, 0.0)], CORRIDOR)
    here = np.array([0.2, 0.05, 0.0])
    match = align_node(corridor, scan_points(here, CORRIDOR), here, here, np.zeros((3, 3)))
    assert abs(match.pose[1] - 0.05) < 0.01
    along, across = match.information[0, 0], match.information[1, 1]
    assert across > 50.0 * along


def test_branch_and_bound_finds_what_brute_force_finds():
    rng = np.random.default_rng(0)
    for _ in range(5):
        index = np.where(rng.random((40, 50)) < 0.05, 1, -1).astype(np.int32)
        points = rng.uniform(-1.5, 1.5, (25, 2))
        centre, angles = np.array([2.5, 2.0, 0.3]), np.array([-0.2, 0.0, 0.2])
        levels = score_levels(index, 4)
        pose = np.empty(3)
        grid, away = (0.0, 0.0), np.array([2.4, 2.2, 0.3])
        found = search_window(levels, grid, points, centre, 7, angles, 0.0, np.zeros(3), pose)
        elsewhere = search_window(levels, grid, points, centre, 7, angles, 0.0, away, pose)
        assert np.hypot(*(pose - away)[:2]) >= 0.3
        best = best_elsewhere = 0
        for angle in angles:
            c, s = np.cos(0.3 + angle), np.sin(0.3 + angle)
            u = np.floor((2.5 + c * points[:, 0] - s * points[:, 1]) / 0.1).astype(np.int32)
            v = np.floor((2.0 + s * points[:, 0] + c * points[:, 1]) / 0.1).astype(np.int32)
            for du in range(-7, 8):
                for dv in range(-7, 8):
                    score = block_score(levels[0], 1, u, v, du, dv)
                    best = max(best, score)
                    if np.hypot(2.5 + 0.1 * du - 2.4, 2.0 + 0.1 * dv - 2.2) >= 0.3:
                        best_elsewhere = max(best_elsewhere, score)
        assert found == pytest.approx(best / (255 * 25))
        assert elsewhere == pytest.approx(best_elsewhere / (255 * 25))


@given(st.lists(st.floats(-2.0, 2.0), min_size=9, max_size=9), st.tuples(*[st.floats(-50.0, 50.0)] * 3))
def test_the_small_solver_agrees_with_numpy(entries, right):
    factor = np.array(entries).reshape(3, 3)
    matrix = factor @ factor.T + 0.1 * np.eye(3)
    expected = np.linalg.solve(matrix + 1e-3 * np.eye(3), right)
    assert solve_symmetric(matrix, *right) == pytest.approx(expected, rel=1e-6, abs=1e-6)


@given(st.floats(0.05, 0.95), st.sampled_from([0, 1, 2, 3]))
def test_a_wall_binds_across_and_not_along_whichever_way_it_runs(offset, quarter):
    angle = quarter * np.pi / 2
    cos, sin = np.cos(angle), np.sin(angle)
    wall = np.column_stack([np.linspace(-1.0, 1.0, 80), np.full(80, 1.0 + 0.1 * offset)])
    points = wall @ np.array([[cos, sin], [-sin, cos]])
    local = make_local_map(points[None], np.array([80]), np.array([0]), np.zeros((1, 3)), np.zeros(3), 3.0)
    normal, along = np.array([-sin, cos]), np.array([cos, sin])
    across = 1.0 / SURFACE_SIGMA**2
    for xx, xy, yy in local.infos:
        info = np.array([[xx, xy], [xy, yy]])
        assert normal @ info @ normal == pytest.approx(across, rel=1e-6)
        assert abs(along @ info @ along) < 1e-6 * across
    # Moved off the wall, a scan comes back to it; along it nothing pulls.
    start = np.array([*(0.04 * normal + 0.03 * along), 0.0])
    found = align_node(local, points, start, start, np.zeros((3, 3))).pose
    assert found[:2] @ normal == pytest.approx(0.0, abs=1e-3)
    assert found[:2] @ along == pytest.approx(0.03, abs=1e-3)


# --- the particle filter's matcher

SEEN_FROM = [(0.0, 0.0, 0.0), (0.0, 0.0, 2.0), (0.0, 0.0, 4.0), (-1.0, 0.5, 1.0), (0.5, -1.0, -1.0)]
MATCHERS = {"coarse_to_fine": SlamConfig(), "hill_climbing": SlamConfig.gmapping()}


def particle_map(shift=(0.0, 0.0), segments=ROOM):
    """The map of one particle that knew where it was, all of it moved by ``shift``."""
    maps = ParticleMaps(1, 0.05, 100.0)
    for pose in SEEN_FROM:
        moved = np.array([pose]) + np.array([*shift, 0.0])
        maps.cover(moved, 12.0)
        maps.register(moved, scan_points(pose, segments))
    return maps


def matched(maps, predicted, points, config=MATCHERS["coarse_to_fine"], deviations=(0.1, 0.05)):
    """Pose and log-likelihood of a scan, predicted with these standard deviations [m], [rad]."""
    poses, likelihoods = np.array([predicted], dtype=np.float64), np.zeros(1)
    match_particles(
        maps.tile_maps,
        poses,
        points,
        deviations[0] ** 2,
        deviations[1] ** 2,
        match_settings(config),
        likelihoods,
    )
    return poses[0], likelihoods[0]


@pytest.fixture(scope="module")
def known_room():
    return particle_map()


small = st.floats(-0.07, 0.07)


@pytest.mark.parametrize("matcher", MATCHERS)
@settings(max_examples=30)
@given(dx=small, dy=small, turn=st.floats(-0.04, 0.04))
def test_a_scan_comes_back_from_where_odometry_has_put_it(known_room, matcher, dx, dy, turn):
    truth = np.array([0.1, -0.15, 0.5])
    points = scan_points(truth)
    found, likelihood = matched(known_room, truth + np.array((dx, dy, turn)), points, MATCHERS[matcher])
    # GMapping's climb is drawn to where more beams end on known walls.
    precision = 0.004 if matcher == "coarse_to_fine" else 0.05
    assert np.hypot(*(found - truth)[:2]) < precision
    assert abs(found[2] - truth[2]) < precision
    _, at_truth = matched(known_room, truth, points, MATCHERS[matcher])
    assert likelihood > at_truth - 0.1


@settings(max_examples=20)
@given(st.integers(-60, 60), st.integers(-60, 60))
def test_where_the_map_lies_does_not_matter(known_room, cols, rows):
    shift = np.array([0.05 * cols, 0.05 * rows, 0.0])
    start, points = np.array([0.13, -0.1, 0.52]), scan_points((0.1, -0.15, 0.5))
    here, likelihood = matched(known_room, start, points)
    there, moved_likelihood = matched(particle_map(shift[:2]), start + shift, points)
    assert there - shift == pytest.approx(here, abs=1e-3)
    assert moved_likelihood == pytest.approx(likelihood, rel=0.02)


def test_where_nothing_is_mapped_the_prediction_stands():
    maps = ParticleMaps(1, 0.05, 100.0)
    maps.cover(np.zeros((1, 3)), 12.0)
    points = scan_points((0.0, 0.0, 0.0))
    pose, likelihood = matched(maps, (0.3, -0.2, 0.1), points)
    assert tuple(pose) == (0.3, -0.2, 0.1)
    assert likelihood == pytest.approx(len(points) * match_settings(SlamConfig()).miss)


def test_along_a_corridor_odometry_decides():
    corridor = particle_map(segments=CORRIDOR)
    truth = np.array([0.2, 0.05, 0.0])
    found, _ = matched(corridor, truth + np.array((0.1, 0.04, 0.02)), scan_points(truth, CORRIDOR))
    assert abs(found[1] - truth[1]) < 0.01
    assert abs(found[2] - truth[2]) < 0.005
    assert found[0] == pytest.approx(0.3, abs=0.03)


def test_what_points_bind_has_the_unit_of_their_noise(known_room):
    rng, sigma, truth = np.random.default_rng(0), 0.01, np.array([0.1, 0.2, 0.4])
    points, found, binding = scan_points(truth), [], np.empty(10)
    for _ in range(200):
        noisy = points + sigma * rng.standard_normal(points.shape)
        align_freely(known_room.tile_maps, 0, truth, noisy, match_settings(SlamConfig()), binding)
        found.append(binding[:3].copy())
    uu, uv, vv, ut, vt, tt = binding[4:]
    covariance = sigma**2 * np.linalg.inv(np.array([[uu, uv, ut], [uv, vv, vt], [ut, vt, tt]]))
    ratio = np.std(found, axis=0) / np.sqrt(np.diag(covariance))
    assert ratio == pytest.approx(np.ones(3), rel=0.4)
