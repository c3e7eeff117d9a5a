"""The whole model: identity without errors, seeds, severities, and what each method and preset gives."""

import cv2
import numpy as np
import pytest

from slamgym.core.errors import ConfigError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, Trajectory
from slamgym.parametric.config import ParametricConfig, ScannerView, TwoPhaseConfig
from slamgym.parametric.model import DRIFT_MARGIN, _drift_px, deform
from slamgym.parametric.visibility import observe

METHODS = ("two_phase", "ekf_schur", "ekf")


def config_of(method: str, **changes) -> ParametricConfig:
    return ParametricConfig(method=method, resolution=0.1, **changes)


@pytest.mark.parametrize("method", METHODS)
def test_severity_zero_gives_the_cad_map_back_where_the_robot_looked(flat, tour, method) -> None:
    result = deform(flat, tour, config_of(method, severity=0.0), np.random.default_rng(0))
    np.testing.assert_allclose(result.believed.poses, result.true.poses, atol=1e-9)
    np.testing.assert_allclose(result.odometry.poses, result.true.poses, atol=1e-9)
    np.testing.assert_allclose(result.field, 0.0, atol=1e-9)
    np.testing.assert_array_equal(result.grid.cells[result.seen], result.cad.cells[result.seen])
    assert (result.grid.cells[~result.seen] == UNKNOWN).all()
    assert result.seen.mean() > 0.3


@pytest.mark.parametrize("method", METHODS)
def test_the_same_seed_gives_the_same_bytes_and_another_another_map(flat, tour, method) -> None:
    maps = [deform(flat, tour, config_of(method), np.random.default_rng(s)) for s in (1, 1, 2)]
    assert maps[0].grid.cells.tobytes() == maps[1].grid.cells.tobytes()
    assert maps[0].field.tobytes() == maps[1].field.tobytes()
    assert maps[0].parameters == maps[1].parameters
    assert maps[0].field.tobytes() != maps[2].field.tobytes()
    assert set(np.unique(maps[0].grid.cells)) == {OCCUPIED, UNKNOWN, FREE}
    assert maps[0].field.dtype == np.float32
    assert maps[0].field.shape == (2, *maps[0].grid.cells.shape)


def test_a_given_frame_is_kept(flat, tour) -> None:
    frame = GridFrame(0.1, -0.5, -0.5, 64, 100)
    result = deform(
        flat, tour, config_of("two_phase", severity=3.0), np.random.default_rng(0), frame
    )
    assert result.grid.frame == frame
    assert result.cad.frame == frame


def test_an_open_frame_grows_until_every_displaced_wall_is_inside(flat, tour) -> None:
    config = config_of("two_phase", severity=8.0)
    result = deform(flat, tour, config, np.random.default_rng(5))
    border = np.ones(result.grid.cells.shape, dtype=bool)
    border[1:-1, 1:-1] = False
    assert (result.grid.cells[border] == OCCUPIED).mean() < 0.05
    assert result.grid.frame.width_px > GridFrame.covering(flat.bounds, 0.1, DRIFT_MARGIN).width_px


@pytest.mark.parametrize(
    ("x", "y", "half", "grows"),
    [
        (0.0, -1.0, "upper", 10),
        (0.0, 1.0, "lower", 10),
        (0.0, 1.0, "upper", 0),
        (0.0, -1.0, "lower", 0),
        (1.0, 0.0, "left", 10),
        (-1.0, 0.0, "right", 10),
        (-1.0, 0.0, "left", 0),
        (0.0, -30.0, "upper", 20),
    ],
)
def test_a_picture_grows_by_as_much_as_walls_are_measured_beyond_it(x, y, half, grows) -> None:
    """Of a room that fills it, one half is displaced, true minus measured; by half its size at most."""
    occupied = np.zeros((40, 40), dtype=bool)
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    frame = GridFrame(0.1, 0.0, 0.0, 40, 40)
    visibility = observe(occupied, frame, np.array([[2.0, 2.0, 0.0]]), ScannerView(mount_x=0.0))
    forward = np.zeros((2, 40, 40), dtype=np.float32)
    part = {
        "upper": np.s_[:20],
        "lower": np.s_[20:],
        "left": np.s_[:, :20],
        "right": np.s_[:, 20:],
    }[half]
    forward[0][part] = x
    forward[1][part] = y
    assert _drift_px(forward, visibility) == grows


def test_displacement_grows_with_severity(flat, tour) -> None:
    def rms(severity: float) -> float:
        fields = [
            deform(
                flat, tour, config_of("two_phase", severity=severity), np.random.default_rng(s)
            ).field
            for s in range(6)
        ]
        return float(np.mean([np.sqrt((field**2).mean()) for field in fields]))

    assert rms(0.3) < rms(1.0) < rms(3.0)


def test_the_field_says_where_the_walls_went(flat, tour) -> None:
    # The map at q shows the CAD map at q + d(q): reading the CAD map through the field finds its walls.
    result = deform(flat, tour, config_of("two_phase"), np.random.default_rng(4))
    frame = result.grid.frame
    rows, cols = np.nonzero(result.grid.cells == OCCUPIED)
    x, y = frame.to_point(rows, cols)
    to = frame.to_cell(x + result.field[0, rows, cols], y + result.field[1, rows, cols])
    rows = to[0].clip(0, frame.height_px - 1)
    cols = to[1].clip(0, frame.width_px - 1)
    walls = result.cad.cells == OCCUPIED
    # All but the cells of short and random beams, 4 % of the wall beams, and of walls seen again, beside the first.
    assert 0.75 < walls[rows, cols].mean() < 0.99
    assert 0.92 < cv2.dilate(walls.astype(np.uint8), np.ones((3, 3)))[rows, cols].mean() < 0.995


def test_landmarks_keep_the_path_near_the_truth_and_dead_reckoning_does_not(flat, tour) -> None:
    def end_error(method: str) -> float:
        errors = []
        for seed in range(8):
            result = deform(
                flat, tour, config_of(method, severity=2.0), np.random.default_rng(seed)
            )
            errors.append(np.hypot(*(result.believed.poses - result.true.poses)[-1, :2]))
        return float(np.mean(errors))

    dead_reckoning = end_error("two_phase")
    assert end_error("ekf_schur") < 0.7 * dead_reckoning
    assert end_error("ekf") < 0.7 * dead_reckoning


def test_all_conversions_are_given_the_same_robot(flat, tour) -> None:
    # The wheels of the EKF and the coefficients of the two phases are two descriptions of one robot.
    quiet = TwoPhaseConfig(s_l=0.0, s_lt=0.0, s_t=0.0)
    ends = [
        deform(flat, tour, config_of(m, two_phase=quiet), np.random.default_rng(3)).odometry.poses[
            -1
        ]
        for m in METHODS[:2]
    ]
    errors = [end[:2] - tour.poses[-1, :2] for end in ends]
    assert np.dot(*errors) > 0.9 * np.linalg.norm(errors[0]) * np.linalg.norm(errors[1])


@pytest.mark.parametrize("method", METHODS)
def test_the_printed_equations_give_another_map_of_the_same_robot(flat, tour, method) -> None:
    results = [
        deform(flat, tour, config_of(method, equations=equations), np.random.default_rng(1))
        for equations in ("corrected", "printed")
    ]
    assert results[0].parameters == results[1].parameters
    displaced = [float(np.hypot(*r.field)[r.seen].mean()) for r in results]
    # The weighted sum moves each wall by decimetres, whatever the robot's errors.
    assert displaced[1] > 0.3
    assert displaced[1] > 1.5 * displaced[0]
    exact = deform(
        flat, tour, config_of(method, equations="printed", severity=0.0), np.random.default_rng(1)
    )
    np.testing.assert_allclose(exact.field, 0.0, atol=1e-6)


def test_ekf_and_its_answer_at_once_bend_the_map_alike(flat, tour) -> None:
    fields = [
        deform(flat, tour, config_of(m), np.random.default_rng(2)).field[:, 10:-10, 10:-10]
        for m in ("ekf", "ekf_schur")
    ]
    assert np.corrcoef(fields[0].ravel(), fields[1].ravel())[0, 1] > 0.98


def square(side_px: int) -> GridFrame:
    return GridFrame(10.0 / side_px, -0.5, -2.0, side_px, side_px)


def test_displacements_of_a_small_grid_are_enlarged_to_a_large_map(flat, tour) -> None:
    config = config_of("ekf")
    small = deform(flat, tour, config, np.random.default_rng(2), square(64))
    large = deform(flat, tour, config, np.random.default_rng(2), square(64), square(256))
    assert large.grid.cells.shape == (256, 256)
    assert large.grid.frame == square(256)
    np.testing.assert_array_equal(large.believed.poses, small.believed.poses)
    # The same field: half a cell of the small grid of its slope, a few per cent.
    np.testing.assert_allclose(large.field[:, 2::4, 2::4], small.field, atol=0.01)
    walls = large.grid.cells == OCCUPIED
    assert walls.mean() < 0.75 * (small.grid.cells == OCCUPIED).mean()  # walls of 0.1 m are drawn


@pytest.mark.parametrize(("pixels", "fits"), [(128, True), (129, False)])
def test_a_map_too_large_for_the_filter_is_refused_with_its_memory(flat, tour, pixels, fits):
    def make():
        return deform(flat, tour, config_of("ekf"), np.random.default_rng(0), square(pixels))

    if fits:
        assert make().grid.cells.shape == (128, 128)
        return
    with pytest.raises(ConfigError, match=r"[0-9.e-]+ GB.*129 x 129 px; give --size 128"):
        make()


def test_a_long_path_is_thinned_until_it_can_be_solved(flat, tour, monkeypatch, capsys) -> None:
    monkeypatch.setattr("slamgym.parametric.model.MAX_SCANS", 60)
    result = deform(flat, tour, config_of("ekf_schur"), np.random.default_rng(0))
    assert 30 < len(result.true) <= 60
    np.testing.assert_array_equal(result.true.poses[[0, -1]], tour.poses[[0, -1]])
    said = capsys.readouterr().err
    assert "more than ekf_schur can solve for" in said
    assert said.count("\n") == 1
    assert len(deform(flat, tour, config_of("two_phase")).true) > 60
    assert not capsys.readouterr().err


def test_a_path_through_a_wall_is_refused(flat, tour) -> None:
    through = Trajectory(tour.stamps, tour.poses.copy())
    through.poses[len(tour) // 2, :2] = [3.05, 1.0]
    with pytest.raises(ConfigError, match="lies in a wall"):
        deform(flat, through)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"severity": -0.1}, "severity must be at least 0, not -0.1"),
        ({"severity": float("nan")}, "severity must be at least 0, not nan"),
        ({"resolution": 0.0}, "resolution must be above 0, not 0.0"),
        ({"method": "two_phases"}, "ekf_schur.*ekf.*two_phase.*did you mean 'two_phase'"),
        ({"equations": "correct"}, "corrected.*printed.*did you mean 'corrected'"),
    ],
)
def test_settings_that_make_no_sense_are_refused(changes, message) -> None:
    with pytest.raises(ConfigError, match=message):
        ParametricConfig(**changes)
