"""The command: what it writes, and one clear error with nothing written for every kind of bad input."""

import json

import numpy as np
import pytest
import shapely

from slamgym.cad.floorplan import FloorPlan
from slamgym.cad.houseexpo import write_houseexpo
from slamgym.commands.deform import main
from slamgym.core.errors import ConfigError, InputFileError, PlanError, SlamgymError
from slamgym.core.types import Trajectory
from slamgym.interop import read_ros_map, read_tum, write_tum
from slamgym.parametric.paths import plan_trajectory, read_waypoints


@pytest.fixture
def plan_file(flat, tmp_path):
    path = tmp_path / "flat.json"
    write_houseexpo(path, flat)
    return path


def csv(path, rows) -> str:
    path.write_text("x,y\n" + "".join(",".join(str(v) for v in row) + "\n" for row in rows))
    return str(path)


def test_it_writes_whole_samples_that_read_back(plan_file, tmp_path, capsys) -> None:
    out = tmp_path / "out"
    assert main([str(plan_file), "-o", str(out), "--samples", "2", "--resolution", "0.1", "--seed", "3"]) == 0
    assert "2 map(s) of flat" in capsys.readouterr().out
    assert sorted(path.name for path in out.iterdir()) == ["000", "001"]
    for sample in out.iterdir():
        grid = read_ros_map(sample / "map.yaml")
        field = np.load(sample / "field.npz")["field"]
        assert field.shape == (2, *grid.cells.shape)
        true, believed = read_tum(sample / "true.tum"), read_tum(sample / "believed.tum")
        assert len(true) == len(believed) > 20
        np.testing.assert_allclose(true.poses[0], believed.poses[0], atol=1e-5)
        record = json.loads((sample / "parameters.json").read_text())
        assert record["plan"] == "flat"
        assert record["config"]["severity"] == 1.0
        assert {"wheels", "phases", "lidar", "failures"} <= set(record["parameters"])
        assert (sample / "cad.png").exists()
        assert (sample / "overview.png").exists()
    first, second = (read_ros_map(out / name / "map.yaml").cells for name in ("000", "001"))
    assert first.shape != second.shape or (first != second).any()


def test_the_same_seed_writes_the_same_map(plan_file, tmp_path) -> None:
    for name in ("a", "b"):
        main([str(plan_file), "-o", str(tmp_path / name), "--resolution", "0.1", "--preset", "realistic"])
    assert (tmp_path / "a/000/map.pgm").read_bytes() == (tmp_path / "b/000/map.pgm").read_bytes()
    assert (tmp_path / "a/000/field.npz").read_bytes() == (tmp_path / "b/000/field.npz").read_bytes()


@pytest.mark.parametrize("method", ["two_phase", "ekf", "ekf_schur"])
def test_a_waypoint_file_and_a_size(plan_file, tmp_path, tour_points, method) -> None:
    way = csv(tmp_path / "way.csv", tour_points)
    out = tmp_path / "out"
    main([str(plan_file), "-o", str(out), "--trajectory", way, "--size", "64", "--method", method])
    assert read_ros_map(out / "000/map.yaml").cells.shape == (64, 64)
    np.testing.assert_allclose(read_tum(out / "000/true.tum").poses[-1, :2], tour_points[-1], atol=1e-5)


def test_a_recorded_path_and_an_explorer(plan_file, tmp_path, tour) -> None:
    recorded = tmp_path / "recorded.tum"
    write_tum(recorded, tour.as_trajectory())
    main([str(plan_file), "-o", str(tmp_path / "a"), "--trajectory", str(recorded), "--resolution", "0.1"])
    calls = []

    def record_path(plan: FloorPlan, name: str, seed: int, make_explorer: object) -> Trajectory:
        calls.append((plan.id, name, seed, make_explorer))
        return tour.as_trajectory()

    main(
        [
            str(plan_file),
            "-o",
            str(tmp_path / "b"),
            "--explorer",
            "nearest",
            "--seed",
            "5",
            "--resolution",
            "0.1",
        ],
        make_explorer="factory",
        record_path=record_path,
    )
    assert calls == [("flat", "nearest", 5, "factory")]
    assert len(read_tum(tmp_path / "b/000/true.tum")) > 20


BAD_PATHS = {
    "through a wall": ([(1.5, 1.5), (4.5, 1.5)], "leads through a wall"),
    "in a wall": ([(1.5, 1.5), (3.05, 1.0)], "waypoint 2 at .* lies in a wall"),
    "outside": ([(1.5, 1.5), (15.0, 1.5)], "lies outside the plan"),
    "one point": ([(1.5, 1.5)], "has 1 waypoint"),
    "NaN": ([(1.5, 1.5), ("nan", 1.0)], "not a pair of finite numbers"),
    "decreasing times": ([(1.5, 1.5, 9.0), (1.5, 2.5, 3.0)], "times of arrival must increase"),
    "words": ([(1.5, 1.5), ("north", 1.0)], "not a line of numbers"),
    "ragged": ([(1.5, 1.5), (1.5, 2.5, 3.0)], "like the rest"),
    "empty": ([], "has no waypoint"),
}


@pytest.mark.parametrize("case", BAD_PATHS)
def test_bad_trajectories_give_one_clear_error_and_write_nothing(plan_file, tmp_path, case) -> None:
    rows, message = BAD_PATHS[case]
    way = csv(tmp_path / "way.csv", rows)
    with pytest.raises(SlamgymError, match=message) as error:
        main([str(plan_file), "-o", str(tmp_path / "out"), "--trajectory", way])
    assert "way.csv" in str(error.value)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["flat.json", "way.csv"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--severity", "-1"], "severity must be at least 0, not -1"),
        (["--samples", "0"], "--samples must be at least 1, not 0"),
        (["--resolution", "-0.1"], "resolution must be above 0, not -0.1"),
        (["--size", "3"], "--size must be 0 or at least 16, not 3"),
        (["--seed", "-4"], "--seed must be at least 0, not -4"),
        (["--prm", "--explorer", "nearest"], "exclude each other"),
        (["--explorer", "nearest"], "--explorer needs the agents package"),
        (["--trajectory", "missing.csv"], "missing.csv"),
        (["--calibration", "missing.json"], "missing.json"),
        (["--plan-id", "nowhere"], "has no plan 'nowhere'"),
    ],
)
def test_bad_arguments_give_one_clear_error_and_write_nothing(
    plan_file, tmp_path, arguments, message
) -> None:
    with pytest.raises(SlamgymError, match=message):
        main([str(plan_file), "-o", str(tmp_path / "out"), *arguments])
    assert [path.name for path in tmp_path.iterdir()] == ["flat.json"]


def test_an_existing_folder_is_kept_unless_overwrite_is_given(plan_file, tmp_path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "precious").write_text("mine")
    with pytest.raises(InputFileError, match="--overwrite"):
        main([str(plan_file), "-o", str(out), "--resolution", "0.2"])
    assert (out / "precious").read_text() == "mine"
    main([str(plan_file), "-o", str(out), "--resolution", "0.2", "--overwrite"])
    assert [path.name for path in out.iterdir()] == ["000"]


def test_a_plan_without_free_space_is_refused() -> None:
    narrow = FloorPlan("slit", shapely.box(0.0, 0.0, 6.0, 0.3))
    from slamgym.parametric.config import MotionConfig

    with pytest.raises(PlanError, match="slit"):
        plan_trajectory(narrow, MotionConfig(), np.random.default_rng(0))
    hairline = FloorPlan("hairline", shapely.box(0.0, 0.0, 6.0, 0.001))
    with pytest.raises(PlanError, match="hairline"):
        plan_trajectory(hairline, MotionConfig(), np.random.default_rng(0))


def test_waypoint_files_may_have_comments_semicolons_and_times(tmp_path) -> None:
    path = tmp_path / "way.csv"
    path.write_text("# tour\n1;2;0\n3;2;20 # door\n\n")
    waypoints = read_waypoints(path)
    np.testing.assert_allclose(waypoints.points, [[1.0, 2.0], [3.0, 2.0]])
    np.testing.assert_allclose(waypoints.times, [0.0, 20.0])


def test_unknown_preset_is_refused_by_the_parser(plan_file, tmp_path) -> None:
    with pytest.raises((SystemExit, ConfigError)):
        main([str(plan_file), "-o", str(tmp_path / "out"), "--preset", "real"])
