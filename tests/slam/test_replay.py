import json

import cv2
import numpy as np
import pytest

from slamgym.commands.cli import TABLE
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.geometry import transform_poses
from slamgym.core.types import (
    GridFrame,
    LaserGeometry,
    LaserScan,
    OccupancyGrid,
    Pose2D,
    Trajectory,
)
from slamgym.interop import LogRecord, read_ros_map, read_tum, write_carmen, write_tum
from slamgym.sim.raycast import cast_rays
from slamgym.slam import SlamConfig
from slamgym.slam.motion_model import poses_between
from slamgym.viz.map_pictures import draw_map


def main(argv):
    return TABLE.run("slamgym", ["slam", *map(str, argv)])


ROOM = np.array(
    [(0, 0, 6, 0), (6, 0, 6, 4), (6, 4, 0, 4), (0, 4, 0, 0), (2, 0, 2, 1.5)], dtype=np.float64
)
GEOMETRY = LaserGeometry(180, -np.pi / 2, np.pi / 180, 0.1, 10.0, Pose2D(0.0, 0.0, 0.0))


def write_episode(folder, scans):
    poses = [Pose2D(1.0 + 0.1 * k, 2.5, 0.02 * k) for k in range(scans)]
    records = []
    for k, pose in enumerate(poses):
        ranges = np.empty(180)
        cast_rays(*pose, GEOMETRY.angle_min, GEOMETRY.angle_increment, ROOM, 10.0, ranges)
        records.append(
            LogRecord(0.2 * k, pose, LaserScan(0.2 * k, ranges.astype(np.float32), GEOMETRY))
        )
    write_carmen(folder / "scans.log", records, GEOMETRY)
    write_tum(folder / "truth.tum", Trajectory(0.2 * np.arange(scans), np.array(poses)))
    return folder


@pytest.fixture(scope="module")
def episode(tmp_path_factory):
    """A folder as an exploration leaves it: a log and the truth."""
    return write_episode(tmp_path_factory.mktemp("episode"), 40)


@pytest.mark.parametrize("mode", ["rbpf", "pose_graph", "dead_reckoning"])
def test_a_log_becomes_a_map_a_path_a_picture_and_a_summary(tmp_path, episode, mode, capsys):
    out = tmp_path / "out"
    assert main([str(episode), "-o", str(out), "--mode", mode, "--particles", "5"]) == 0
    grid = read_ros_map(out / "map.yaml")
    # The room is 6 x 4 m, of which the metre behind the start is never seen; walls are up to two cells thick.
    assert np.array(grid.cells.shape) * 0.05 == pytest.approx((4.0, 5.0), abs=0.25)
    assert len(read_tum(out / "trajectory.tum")) == 40
    assert cv2.imread(str(out / "map.png")).shape[0] > 300
    summary = json.loads((out / "summary.json").read_text())
    assert summary["scans"] == 40
    assert summary["truth"]["ate_rmse_m"] < 0.03
    assert summary["config"]["mode"] == mode
    assert (summary["findings"], summary["has_odometry"], summary["distrusted_seconds"]) == (
        [],
        True,
        [],
    )
    graph = ["graph.g2o", "scans.npz"] if mode == "pose_graph" else []
    assert sorted(path.name for path in out.iterdir()) == sorted([
        "map.pgm", "map.png", "map.yaml", "summary.json", "trajectory.tum", "trajectory_doubt.csv", *graph,
    ])  # fmt: skip
    assert mode in capsys.readouterr().out


def test_the_same_seed_gives_the_same_map(tmp_path, episode):
    for name in ("a", "b"):
        main([str(episode), "-o", str(tmp_path / name), "--particles", "5", "--seed", "3"])
    for file in ("map.pgm", "trajectory.tum", "map.png"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_relations_are_scored(tmp_path, episode, capsys):
    relations = tmp_path / "a.relations"
    relations.write_text("0.0 2.0 1.0 0 0 0 0 0.2\n0.05 99.0 1.0 0 0 0 0 0.2\n")
    main(
        [
            str(episode),
            "-o",
            str(tmp_path / "out"),
            "--mode",
            "dead_reckoning",
            "--relations",
            str(relations),
        ]
    )
    printed = capsys.readouterr().out
    assert "relations, all: " in printed
    assert "of 1 of 2" in printed
    relations.write_text("9e9 9.1e9 1 0 0 0 0 0\n")
    with pytest.raises(ConfigError, match="same log"):
        main([str(episode), "-o", str(tmp_path / "out"), "--relations", str(relations)])


@pytest.mark.parametrize("name", ["film.mp4", "film.gif"])
def test_a_film_of_the_growing_map(tmp_path, name):
    film, episode = tmp_path / name, write_episode(tmp_path, 8)
    main([str(episode), "-o", str(tmp_path / "out"), "--particles", "3", "--video", str(film)])
    assert film.stat().st_size > 10_000
    assert list(tmp_path.glob(".*part*")) == []


class TestErrors:
    def test_a_film_needs_a_known_ending_before_a_log_is_read(self, tmp_path):
        with pytest.raises(ConfigError, match=r"\.mp4 or \.gif"):
            main(
                ["nowhere.log", "-o", str(tmp_path / "out"), "--video", str(tmp_path / "film.txt")]
            )
        assert not (tmp_path / "out").exists()

    def test_a_missing_log_writes_nothing(self, tmp_path):
        with pytest.raises(InputFileError, match="doesn't exist"):
            main([str(tmp_path / "none.log"), "-o", str(tmp_path / "out")])
        assert not (tmp_path / "out").exists()

    def test_an_output_that_is_a_file_is_refused(self, tmp_path, episode):
        (tmp_path / "out").write_text("mine")
        with pytest.raises(InputFileError, match="name a folder"):
            main([str(episode), "-o", str(tmp_path / "out")])
        assert (tmp_path / "out").read_text() == "mine"

    def test_settings_from_a_file_are_checked_before_the_log_is_read(self, tmp_path):
        (tmp_path / "s.json").write_text('{"sigmaa": 1}')
        (tmp_path / "broken.log").write_text("")
        arguments = [str(tmp_path / "broken.log"), "-o", str(tmp_path / "out")]
        with pytest.raises(InputFileError, match="sigma"):
            main([*arguments, "--config", str(tmp_path / "s.json")])

    def test_ground_truth_is_not_for_logs(self, tmp_path, episode):
        with pytest.raises(ConfigError, match="simulation"):
            main([str(episode), "-o", str(tmp_path / "out"), "--mode", "ground_truth"])


def test_scans_between_processed_ones_share_the_correction():
    odometry = np.column_stack([np.arange(5.0), np.zeros(5), np.zeros(5)])
    poses = np.array([[0.0, 0.0, 0.0], [4.0, 0.4, 0.0]])
    filled = poses_between(poses, np.array([0, 4]), odometry)
    assert filled[:, 0] == pytest.approx([0, 1, 2, 3, 4])
    assert filled[:, 1] == pytest.approx([0, 0.1, 0.2, 0.3, 0.4])


@pytest.mark.parametrize("turn", [0.0, 1.0, 3.0, -3.1])
def test_a_shared_correction_is_the_same_in_a_turned_map(turn):
    odometry = np.column_stack([np.arange(5.0), np.zeros(5), 0.1 * np.arange(5.0)])
    poses = np.array([[0.0, 0.0, 0.1], [4.0, 0.4, 0.3]])
    frame = Pose2D(1.0, 2.0, turn)
    straight, turned = (
        poses_between(p, np.array([0, 4]), odometry) for p in (poses, transform_poses(frame, poses))
    )
    expected = transform_poses(frame, straight)
    assert turned[:, :2] == pytest.approx(expected[:, :2])
    assert np.cos(turned[:, 2] - expected[:, 2]) == pytest.approx(1.0)


def test_settings_follow_the_scanner():
    near = SlamConfig.for_log(3.5, 180)
    far = SlamConfig.for_log(81.0, 180)
    assert near.max_usable_range == pytest.approx(3.45)
    assert (near.mode, near.no_return, near.linear_update) == ("pose_graph", "clear", 0.1)
    assert (far.no_return, far.beam_skip) == ("ignore", 0)
    assert SlamConfig.for_log(30.0, 1081).beam_skip == 2
    assert far.max_usable_range > 75.0


@pytest.mark.parametrize("shape", [(1, 1), (5, 4000), (300, 200)])
def test_pictures_of_any_map_have_a_sensible_size(shape):
    cells = np.random.default_rng(0).choice(np.array([0, 205, 254], np.uint8), shape)
    grid = OccupancyGrid(cells, GridFrame(0.05, 0.0, 0.0, *shape))
    picture = draw_map(grid, [np.zeros((1, 3))], "name")
    assert picture.ndim == 3
    assert 64 < picture.shape[0] < 3000
    assert 600 < picture.shape[1] < 3000


def test_no_line_joins_the_paths_of_two_drives():
    grid = OccupancyGrid(np.full((40, 40), 254, np.uint8), GridFrame(0.1, 0.0, 0.0, 40, 40))
    left = np.array([[1.0, 0.5], [1.0, 3.5]])
    right = left + np.array([2.0, 0.0])
    both = draw_map(grid, [left, right])
    assert (both != draw_map(grid, [left])).any()
    middle = slice(both.shape[1] * 2 // 5, both.shape[1] * 3 // 5)
    assert (both[:, middle] == draw_map(grid, [])[:, middle]).all()
    assert (draw_map(grid, [np.concatenate([left, right])])[:, middle] != both[:, middle]).any()
