"""What becomes of wall cells: the mixture of beams, and the model as printed."""

import numpy as np
import pytest

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame
from slamgym.parametric import wall_beams
from slamgym.parametric.config import ScannerView
from slamgym.parametric.lidar_error import LidarErrors
from slamgym.parametric.visibility import beam_angles, observe
from slamgym.parametric.wall_beams import corrected_beams, observed_cad, printed_beams

NO_ERRORS = LidarErrors()


def one_wall():
    """A wall 2 m ahead of a robot at the origin that looks along +x, on a 5 cm grid."""
    frame = GridFrame(0.05, -1.0, -3.0, 120, 110)
    occupied = np.zeros(frame.shape, dtype=bool)
    occupied[:, frame.to_cell(2.0 + 0.025, 0.0)[1]] = True
    return frame, occupied, observe(occupied, frame, np.zeros((1, 3)), ScannerView(mount_x=0.0))


def beams_of(visibility, errors=NO_ERRORS, severity=0.0, seed=0):
    return corrected_beams(visibility, errors, 3.5, severity, np.random.default_rng(seed))


def test_a_constant_range_error_displaces_a_wall_along_the_beam() -> None:
    frame, _, visibility = one_wall()
    beams = beams_of(visibility, LidarErrors(a0=0.1))
    rows, cols = np.nonzero(beams.hit)
    x, y = frame.to_point(rows, cols)
    away = np.hypot(x, y)
    # Measured 0.1 m short: true minus measured points from the robot to the wall. The median of five cells in a row
    # is that of the middle one, but for the wall's ends.
    inner = np.abs(y) < 1.3
    np.testing.assert_allclose(
        beams.field[0, rows, cols][inner], (0.1 * x / away)[inner], atol=2e-3
    )
    np.testing.assert_allclose(
        beams.field[1, rows, cols][inner], (0.1 * y / away)[inner], atol=1e-6
    )


def test_a_bearing_error_displaces_a_wall_across_the_beam() -> None:
    frame, _, visibility = one_wall()
    beams = beams_of(visibility, LidarErrors(b3=0.01))
    row, col = (int(v) for v in frame.to_cell(2.01, 0.01))
    # Ahead, da = b3: measured to the right of its place, so true minus measured points to the left (+y).
    assert beams.field[1, row, col] == pytest.approx(2.0 * 0.01, rel=0.05)
    assert abs(beams.field[0, row, col]) < 0.001


def test_a_turned_scanner_displaces_in_the_world() -> None:
    frame, occupied, _ = one_wall()
    looking_left = np.array([[0.0, 0.0, np.pi / 2]])
    turned = observe(occupied, frame, looking_left, ScannerView(mount_x=0.0))
    beams = beams_of(turned, LidarErrors(a0=0.1))
    row, col = (int(v) for v in frame.to_cell(2.01, 0.01))
    assert beams.field[0, row, col] == pytest.approx(0.1, abs=2e-3)


def test_no_error_no_displacement_and_only_walls_have_beams() -> None:
    _, occupied, visibility = one_wall()
    beams = beams_of(visibility)
    assert np.abs(beams.field).max() < 1e-6
    assert not (beams.hit | beams.lost)[~occupied].any()
    assert not beams.lost.any()
    seen = observed_cad(occupied, visibility, beams)
    assert (seen[visibility.seen] == np.where(occupied, OCCUPIED, FREE)[visibility.seen]).all()
    assert (seen[~visibility.seen] == UNKNOWN).all()


def test_the_median_filter_removes_a_lone_outlier(monkeypatch) -> None:
    frame, _, visibility = one_wall()
    rows = frame.to_cell(2.01, np.linspace(-0.3, 0.3, 13))[0]
    col = frame.to_cell(2.01, 0.0)[1]

    def spread() -> tuple[float, int]:
        found = [beams_of(visibility, severity=1.0, seed=seed) for seed in range(20)]
        ahead = np.concatenate([b.field[0, rows, col][b.hit[rows, col]] for b in found])
        return float(ahead.std()), len(ahead)

    smooth, _ = spread()
    monkeypatch.setattr("slamgym.parametric.wall_beams._MEDIAN_PX", 1)
    raw, count = spread()
    assert smooth < 0.7 * raw
    # One centimetre of noise, as of a range straight ahead; five standard errors.
    assert raw == pytest.approx(0.01, rel=5.0 / np.sqrt(2.0 * count))


@pytest.mark.parametrize("severity", [1.0, 6.0, 100.0])
def test_other_beams_lose_the_wall_in_their_shares(severity) -> None:
    visibility = one_wall()[2]
    found = [beams_of(visibility, severity=severity, seed=seed) for seed in range(20)]
    lost = sum(beams.lost.sum() for beams in found)
    count = 20 * (found[0].hit | found[0].lost).sum()
    share = min(1.0, 0.05 * severity)  # short, max and rand: a twentieth
    assert lost / count == pytest.approx(share, abs=5.0 * np.sqrt(share * (1.0 - share) / count))
    # Short and random ones set a cell, those without return none: four of five.
    stray = sum(len(beams.set_points) for beams in found)
    assert stray / count == pytest.approx(0.8 * share, abs=5.0 * np.sqrt(0.8 * share / count))
    for beams in found:
        assert not beams.field[:, beams.lost].any()
        assert not (beams.hit & beams.lost).any()


def strays(monkeypatch, short: float, rand: float) -> np.ndarray:
    """End points of many beams that are all short or random, as points in the plane."""
    shares = wall_beams.Shares(hit=0.0, short=short, max=0.0, rand=rand)
    monkeypatch.setattr(wall_beams, "BEAMS", shares)
    visibility = one_wall()[2]
    return np.concatenate(
        [beams_of(visibility, severity=1.0, seed=seed).set_points for seed in range(30)]
    )


@pytest.mark.parametrize("heading", [0.0, 1.5, 3.0, -2.0])
def test_beams_that_miss_their_wall_go_towards_it_whichever_way_the_robot_looks(heading) -> None:
    frame, occupied, _ = one_wall()
    pose = np.array([[0.0, 0.0, heading]])
    beams = beams_of(observe(occupied, frame, pose, ScannerView(mount_x=0.0)), severity=100.0)
    away = beams.set_points
    assert len(away) > 20
    # The wall stands at x = 2 m from y = -3 m to 3 m.
    assert np.degrees(np.abs(np.arctan2(away[:, 1], away[:, 0]))).max() < 57.0


@pytest.mark.parametrize("range_min", [0.1, 2.3, 2.8])
def test_a_wall_nearer_than_a_scanner_measures_is_seen_but_not_hit(range_min) -> None:
    frame, occupied, _ = one_wall()
    scanner = ScannerView(range_min=range_min, mount_x=0.0)
    visibility = observe(occupied, frame, np.zeros((1, 3)), scanner)
    rows, cols = np.nonzero(occupied & visibility.seen)
    away = np.hypot(*visibility.frame.to_points(rows, cols).T)
    is_hit = visibility.cells.best[rows, cols] >= 0
    clearly = np.abs(away - range_min) > 0.1  # a beam meets a cell's border, not its middle
    np.testing.assert_array_equal(is_hit[clearly], (away > range_min)[clearly])
    assert (~is_hit).any() == (range_min > 2.0)


@pytest.mark.parametrize("count", [2, 5, 180])
def test_beams_lie_evenly_from_end_to_end_of_a_view_and_all_round(count) -> None:
    part = beam_angles(ScannerView(field_of_view=2.0, num_beams=count), 0.05)
    np.testing.assert_allclose(part, np.linspace(-1.0, 1.0, count), atol=1e-12)
    whole = beam_angles(ScannerView(field_of_view=2.0 * np.pi, num_beams=count), 0.05)
    steps = np.diff(whole, append=whole[0] + 2.0 * np.pi)
    np.testing.assert_allclose(steps, 2.0 * np.pi / count)


def test_short_beams_end_before_the_wall(monkeypatch) -> None:
    points = strays(monkeypatch, short=1.0, rand=0.0)
    assert points[:, 0].max() < 2.06
    # Where they end is random: the density falls by a third only up to the wall.
    assert 0.7 < points[:, 0].mean() < 1.0


def test_random_beams_end_anywhere_and_do_not_pile_up_on_the_wall(monkeypatch) -> None:
    points = strays(monkeypatch, short=0.0, rand=1.0)
    length = np.hypot(*points.T)
    assert length.max() > 3.4
    share, _ = np.histogram(length, bins=7, range=(0.0, 3.5))
    even = len(points) / 7.0
    np.testing.assert_allclose(share, even, atol=5.0 * np.sqrt(even))
    # The wall's own 10 cm are no fuller than any others.
    on_wall = np.abs(points[:, 0] - 2.025) < 0.05
    assert on_wall.mean() < 0.08


def test_a_random_beam_sets_a_cell_beyond_the_wall_but_not_beyond_the_map() -> None:
    frame, occupied, visibility = one_wall()
    beams = beams_of(visibility)
    points = np.array([[3.1, 0.2], [60.0, 0.0], [0.0, -60.0]])
    stray = wall_beams.WallBeams(beams.field, beams.hit, beams.lost, points)
    seen = observed_cad(occupied, visibility, stray)
    assert seen[frame.to_cell(3.1, 0.2)] == OCCUPIED
    assert (seen == OCCUPIED).sum() == (occupied & visibility.seen).sum() + 1


def test_walls_that_are_seen_again_are_drawn_again_as_one_piece(monkeypatch) -> None:
    monkeypatch.setattr(wall_beams, "BEAMS", wall_beams.Shares(1.0 - 1e-9, 1e-9, 0.0, 0.0))
    frame, occupied, _ = one_wall()
    poses = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])  # the last scan is the farther one
    visibility = observe(occupied, frame, poses, ScannerView(mount_x=0.0))
    both = (visibility.cells.best == 0) & (visibility.cells.last == 1)
    assert both.sum() > 20
    shifts = []
    for seed in range(40):
        points = beams_of(visibility, severity=1.0, seed=seed).set_points
        shift = points - frame.to_points(*np.nonzero(both))
        np.testing.assert_allclose(shift, np.broadcast_to(shift[0], shift.shape))
        shifts.append(shift[0])
    # Five centimetres in x and y; four standard errors.
    assert np.std(shifts) == pytest.approx(0.05, rel=4.0 / np.sqrt(160.0))
    assert not len(printed_of(visibility).set_points)
    np.testing.assert_allclose(
        beams_of(visibility).set_points, frame.to_points(*np.nonzero(both)), atol=1e-12
    )


def printed_of(visibility, errors=NO_ERRORS, severity=1.0, seed=0):
    return printed_beams(visibility, errors, 3.5, severity, np.random.default_rng(seed))


def test_the_print_sums_up_four_displacements_and_loses_no_wall() -> None:
    _, occupied, visibility = one_wall()
    beams = printed_of(visibility)
    assert not beams.lost.any()
    assert not len(beams.set_points)
    seen = observed_cad(occupied, visibility, beams)
    assert (seen[occupied & visibility.seen] == OCCUPIED).all()
    half = printed_of(visibility, severity=0.5)
    np.testing.assert_allclose(half.field, 0.5 * beams.field, atol=1e-6)


def test_the_print_takes_errors_for_ranges_with_the_papers_weights(monkeypatch) -> None:
    # With D 2 m, alpha 0 and known readings, (11) is the sum by hand.
    visibility = one_wall()[2]
    known = {"short_ranges": 1.0, "rand_ranges": 0.5, "max_ranges": 3.5}
    for name, value in known.items():
        monkeypatch.setattr(wall_beams, name, lambda *_, value=value: value)
    monkeypatch.setattr(
        wall_beams,
        "_median_of_known",
        lambda field, *_: np.stack([np.full_like(field[0], 2.0), np.zeros_like(field[1])]),
    )
    beams = printed_of(visibility, LidarErrors(a0=0.1))
    bracket = 0.4 * 1.9 + 0.3 * (2.0 - 1.0) + 0.2 * (2.0 - 3.5) + 0.1 * (2.0 - 0.5)
    np.testing.assert_allclose(beams.field[0, beams.hit], 2.0 - bracket, atol=1e-6)
    np.testing.assert_allclose(beams.field[1, beams.hit], 0.0, atol=1e-6)


def test_the_print_draws_range_and_bearing_of_each_pixel_whatever_the_path() -> None:
    frame, occupied, _ = one_wall()
    occupied[: frame.height_px // 2 - 10] = False
    occupied[frame.height_px // 2 + 10 :] = False
    view = ScannerView(mount_x=0.0)
    poses = np.array([[0.0, 0.0, 0.0], [0.5, 0.3, 1.0]])
    first, second = (observe(occupied, frame, poses[[k]], view) for k in range(2))
    np.testing.assert_array_equal(first.cells.best >= 0, second.cells.best >= 0)
    np.testing.assert_array_equal(printed_of(first).field, printed_of(second).field)
    assert (beams_of(first, LidarErrors(a0=0.1)).field != beams_of(second).field).any()
    # Displacements point along alpha, which is any.
    x, y = np.hstack([printed_of(first, seed=s).field[:, first.cells.best >= 0] for s in range(9)])
    quadrants = {(bool(right), bool(up)) for right, up in zip(x > 0.0, y > 0.0, strict=True)}
    assert len(quadrants) == 4
