import math

import numpy as np
import pytest
from drawn_drives import CORRIDOR, FLAT, draw, drive

from slamgym.core.errors import SlamgymError
from slamgym.core.geometry import compose, wrap_angle
from slamgym.core.types import FREE, UNKNOWN, LaserGeometry, OccupancyGrid, Pose2D
from slamgym.metrics.trajectory import relative_poses
from slamgym.sim.raycast import cast_rays
from slamgym.slam.config import LocalizationConfig, SlamConfig
from slamgym.slam.graph.submaps import oriented_scan
from slamgym.slam.graph.wheels import WheelCalibration
from slamgym.slam.hit_count_kernels import BeamTable
from slamgym.slam.localization.global_search import is_same
from slamgym.slam.localization.hypothesis import Hypothesis
from slamgym.slam.localization.known_map import MOST_MISSED, KnownMap, explain_scan
from slamgym.slam.localization.logs import localize_log

HERE = Pose2D(0.0, 0.0, 0.0)
ROUND_TRIP = [(1, 1), (2.2, 2.3), (3.8, 2.3), (4.7, 2.4), (4.7, 3.6), (7, 3.8)]
UPPER_ROOM = [(7.3, 4.2), (5.0, 3.5), (3.7, 3.6), (3.6, 4.5), (4.6, 3.8), (6.5, 3.4)]


def localize(log, grid, placement=HERE, **settings):
    return localize_log(log, grid, placement, LocalizationConfig(**settings))


def errors(result, truth):
    """Position [m] and heading [rad] at the processed scans."""
    away = np.array([belief.pose for belief in result.beliefs]) - truth[list(result.processed)]
    return np.hypot(away[:, 0], away[:, 1]), np.abs(wrap_angle(away[:, 2]))


def test_the_robot_finds_itself_anywhere_and_knows_how_well():
    log, truth = drive(FLAT, ROUND_TRIP)
    result = localize(log, draw(FLAT, (1, 1)))
    localised = np.array([belief.state == "localised" for belief in result.beliefs])
    away, turned = errors(result, truth)
    assert localised[-1]
    assert localised.mean() > 0.5
    assert away[localised].max() < 0.1
    assert turned[localised].max() < math.radians(4.0)
    deviations = np.array([math.sqrt(belief.covariance[0, 0]) for belief in result.beliefs])
    assert 0.01 < deviations[-1] < 0.1
    assert np.array_equal(
        result.trajectory.stamps[-3:], [record.stamp for record in log.records[-3:]]
    )


def test_the_same_log_gives_the_same_beliefs():
    log, _ = drive(FLAT, ROUND_TRIP[:3])
    first, second = (localize(log, draw(FLAT, (1, 1))) for _ in range(2))
    assert [belief.pose for belief in first.beliefs] == [belief.pose for belief in second.beliefs]
    assert [belief.hypotheses for belief in first.beliefs] == [
        belief.hypotheses for belief in second.beliefs
    ]


def test_a_corridor_that_looks_the_same_from_both_ends_is_ambiguous():
    log, truth = drive(CORRIDOR, [(1.2, 0.8), (5.6, 0.8), (2.0, 0.8)])
    result = localize(log, draw(CORRIDOR, (1, 1)))
    assert {belief.state for belief in result.beliefs} == {"ambiguous"}
    (first, weight), (second, other) = result.beliefs[-1].hypotheses[:2]
    assert weight + other > 0.95
    assert other > 0.05
    mirrored = Pose2D(7.0 - truth[-1, 0], 1.6 - truth[-1, 1], truth[-1, 2] + math.pi)
    for wanted in (Pose2D(*truth[-1]), mirrored):
        assert min(math.hypot(p.x - wanted.x, p.y - wanted.y) for p in (first, second)) < 0.15
    assert len(result.trajectory) == 0


def test_a_robot_that_is_carried_off_notices_and_finds_itself_again():
    log, truth = drive(FLAT, ROUND_TRIP[:4], carried=UPPER_ROOM)
    result = localize(log, draw(FLAT, (1, 1)))
    states = [belief.state for belief in result.beliefs]
    away, _ = errors(result, truth)
    before_scans = len(drive(FLAT, ROUND_TRIP[:4])[0])
    before = len([index for index in result.processed if index < before_scans])
    assert states[before - 1] == "localised"
    assert states[before + 8] != "localised"
    assert states[-1] == "localised"
    assert away[-1] < 0.15
    # Twice as far as the first time has it to be sure of the other place; half a turn counts a metre.
    steps = relative_poses(truth[:-1], truth[1:])
    steps[before_scans - 1] = 0.0
    driven = np.cumsum(np.hypot(steps[:, 0], steps[:, 1]) + np.abs(steps[:, 2]) / math.pi)
    again = next(k for k in range(before + 8, len(states)) if states[k] == "localised")
    way = driven[result.processed[again] - 1] - driven[before_scans - 1]
    assert way > 2.0 * LocalizationConfig().confirm_distance


@pytest.mark.parametrize("off", [(0.2, -0.1, 0.1), (0.6, 0.2, -0.1)])
def test_a_known_start_is_believed_and_followed(off):
    log, truth = drive(FLAT, ROUND_TRIP)
    start = Pose2D(*(truth[0] + off))
    result = localize_log(log, draw(FLAT, (1, 1)), HERE, LocalizationConfig(), start)
    assert {belief.state for belief in result.beliefs} == {"localised"}
    assert errors(result, truth)[0][10:].max() < 0.1


def test_a_robot_that_leaves_the_map_is_led_by_what_it_sees_beyond():
    log, truth = drive(FLAT, ROUND_TRIP, noise=0.1)
    grid = draw(FLAT, (1, 1))
    grid.cells[:, grid.frame.to_cell(2.9, 0.0)[1] :] = UNKNOWN
    result = localize_log(log, grid, HERE, LocalizationConfig(), Pose2D(*truth[0]))
    away, _ = errors(result, truth)
    deviations = np.sqrt([np.trace(belief.covariance[:2, :2]) for belief in result.beliefs])
    assert (away < 4.0 * deviations).all()
    assert away.max() < 0.1
    assert {belief.state for belief in result.beliefs} == {"localised"}


def test_poses_come_in_the_frame_of_a_turned_map():
    log, _ = drive(FLAT, ROUND_TRIP)
    placement = Pose2D(3.0, -2.0, 0.7)
    straight, turned = (localize(log, draw(FLAT, (1, 1)), placement=p) for p in (HERE, placement))
    expected = compose(placement, straight.beliefs[-1].pose)
    assert turned.beliefs[-1].pose == pytest.approx(expected)
    cos, sin = math.cos(placement.theta), math.sin(placement.theta)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    for before, after in zip(straight.beliefs, turned.beliefs, strict=True):
        assert after.covariance == pytest.approx(turn @ before.covariance @ turn.T, abs=1e-12)


def test_places_are_the_same_across_half_a_turn_too():
    places = np.array([(1.0, 2.0, math.pi - 0.05), (1.0, 2.0, 0.2 - math.pi), (1.0, 2.4, -math.pi)])
    assert is_same(places, np.array([1.1, 2.0, 0.05 - math.pi])).tolist() == [True, True, False]


@pytest.mark.parametrize("heading", [0.0, 1.5, 3.0, -2.0])
def test_a_scanner_mounted_aside_is_explained_from_where_the_robot_stands(heading):
    pose = Pose2D(1.6, 1.5, heading)
    mount = Pose2D(0.1, -0.3, 0.8)
    ranges = np.empty(180)
    cast_rays(*compose(pose, mount), -math.pi, math.pi / 90, FLAT, 4.0, ranges)
    geometry = LaserGeometry(180, -math.pi, math.pi / 90, 0.1, 4.0, mount)
    beams = BeamTable.of(geometry, SlamConfig())
    known = KnownMap(draw(FLAT, (1, 1)))
    scan = ranges.astype(np.float32)
    missed, missed_beside = known.no_misses(), known.no_misses()
    against, fit = explain_scan(known.field, np.array(pose), scan, beams, 1, False, missed)
    beside = np.array([pose.x, pose.y + 0.6, heading])
    against_beside, fit_beside = explain_scan(
        known.field, beside, scan, beams, 1, False, missed_beside
    )
    assert fit > 0.97
    assert fit_beside < fit
    assert against_beside > against + 1.0
    # A place speaks as loudly as some beams, however often it is seen.
    for _ in range(40):
        last, _ = explain_scan(known.field, beside, scan, beams, 1, False, missed_beside)
    assert last < 0.1 * against_beside
    assert missed_beside.max() == MOST_MISSED


@pytest.mark.parametrize("scale", [0.97, 1.04])
def test_a_wrong_scale_of_the_odometry_is_learned_from_the_map(scale):
    log, truth = drive(FLAT, ROUND_TRIP[:4], noise=0.0)
    known, wheels = KnownMap(draw(FLAT, (1, 1))), WheelCalibration()
    beams = BeamTable.of(log.geometry, SlamConfig())
    place = Hypothesis.around(truth[0].copy(), (0.1, 0.1, 0.05), known.no_misses())
    for first in range(0, len(truth) - 3, 3):
        motions = relative_poses(truth[first : first + 3], truth[first + 1 : first + 4])
        step = wheels.step(motions * [scale, scale, 1.0])
        place.move(step, wheels.variances(step.slips))
        ranges = log.records[first + 3].scan.ranges
        place.align(known.surfaces, oriented_scan(ranges, beams, np.inf))
        assert np.hypot(*(place.pose - truth[first + 3])[:2]) < 0.1
    # What is measured times 1 plus the error is the way: learned at least in part, and not away from it.
    assert place.systematic[0] == pytest.approx(1.0 / scale - 1.0, abs=0.6 * abs(1.0 / scale - 1.0))


def test_furniture_that_was_moved_does_not_lose_the_robot():
    log, truth = drive(FLAT, ROUND_TRIP)
    without_pillar = FLAT[:-4]
    moved = np.array([(6.0, 0.6, 6.6, 0.6), (6.6, 0.6, 6.6, 1.4), (4.0, 0.5, 4.0, 1.2)])
    result = localize(log, draw(np.vstack([without_pillar, moved]), (1, 1)))
    assert result.beliefs[-1].state == "localised"
    assert errors(result, truth)[0][-1] < 0.1


def test_a_map_without_walls_is_one_clear_error():
    log, _ = drive(FLAT, ROUND_TRIP[:2])
    grid = draw(FLAT, (1, 1))
    with pytest.raises(SlamgymError, match="wall"):
        localize(log, OccupancyGrid(np.full_like(grid.cells, FREE), grid.frame))


def test_the_mode_map_needs_a_map():
    from slamgym.slam import make_mapper

    with pytest.raises(SlamgymError, match="finished map"):
        make_mapper(
            SlamConfig(mode="map"),
            drive(FLAT, [(1, 1), (1, 2)])[0].geometry,
            HERE,
            np.random.default_rng(0),
        )
