"""The zoo of robots and places that ``benchmarks/slam/zoo.py`` judges mappers on."""

import argparse
import gzip
import json
import math
from itertools import pairwise

import drives
import karto
import numpy as np
import pytest
import zoo
from recorded_logs import (
    JudgedLog,
    read_judged_log,
    variants,
    with_fewer_beams,
    with_range,
    with_turns,
)
from zoo_robots import FIRST_SEED, PLACES, ROBOTS

from slamgym.cad.floorplan import check_plan
from slamgym.core.geometry import between, compose, transform_poses
from slamgym.core.types import LaserGeometry, LaserScan, Pose2D, Trajectory
from slamgym.interop import Log, LogRecord, Relations
from slamgym.interop.records import OdometryTrack
from slamgym.metrics import absolute_trajectory_error

GEOMETRY = LaserGeometry(9, -1.0, 0.25, 0.1, 20.0, time_increment=0.01)
STEP = Pose2D(0.1, 0.0, 0.05)


@pytest.fixture
def log():
    """A circle in forty scans; the log holds the odometry between them, too."""
    pose, poses, records = Pose2D(1.0, 2.0, 0.3), [], []
    for k in range(80):
        poses.append(pose)
        if k % 2 == 0:
            scan = LaserScan(0.5 * k, np.arange(9, dtype=np.float32) + k / 8, GEOMETRY, STEP)
            records.append(LogRecord(0.5 * k, pose, scan))
        pose = compose(pose, STEP)
    track = OdometryTrack(0.5 * np.arange(80), np.array(poses), np.arange(0, 80, 2))
    return Log("circle", records, GEOMETRY, recorded_track=track)


def path_of(log):
    stamps = np.array([record.stamp for record in log])
    return Trajectory(stamps, np.array([record.odometry for record in log]))


def test_the_robots_differ_as_those_that_are_sold():
    lidars = [robot.lidar for robot in ROBOTS.values()]
    assert len(ROBOTS) == 10
    assert {robot.odometry for robot in ROBOTS.values()} == {"ideal", "low", "medium", "high"}
    for values in (
        [lidar.range_max / 3.5 for lidar in lidars],
        [80.0 / lidar.range_max for lidar in lidars],
        [lidar.field_of_view_deg / 180.0 for lidar in lidars],
        [lidar.rate / 5.0 for lidar in lidars],
        [40.0 / lidar.rate for lidar in lidars],
    ):
        assert min(values) == 1.0


@pytest.mark.parametrize("name", ROBOTS)
def test_a_laser_stands_on_its_robot_and_turns_evenly(name):
    lidar, _, body = ROBOTS[name]
    assert math.hypot(*lidar.mount[:2]) < body.radius
    # All but the SICK, which takes two turns of its mirror, sweep their view at the rate of their turns.
    turn = lidar.field_of_view_deg / 360.0 / lidar.rate
    assert lidar.sweep < 1.0 / lidar.rate
    if name != "sick-lms":
        assert lidar.sweep == pytest.approx(turn, rel=0.01)


@pytest.mark.parametrize("name", PLACES)
def test_every_robot_can_explore_a_place(name):
    plan = PLACES[name].make(FIRST_SEED)
    check_plan(plan, robot_radius=max(robot.body.radius for robot in ROBOTS.values()))
    assert plan.segments() == pytest.approx(PLACES[name].make(FIRST_SEED).segments())
    if name == "corridor":
        assert plan.free_space.interiors  # it leads round
        assert plan.free_space.buffer(-1.3).is_empty  # and is nowhere wide
    if name == "hall":
        assert min(plan.bounds[2:]) > 15.0


def arguments(cache, **others):
    settings = {"modes": ["pose_graph"], "sweep": "on", "minutes": 0.25, "pictures": None}
    return argparse.Namespace(**settings | {"cache": cache} | others)


def test_a_drive_is_simulated_once_and_mapped_from_the_true_start(tmp_path, monkeypatch):
    task = zoo.Task("lds-02", "empty-home", 0, arguments(tmp_path / "drives"))
    length, (figures,) = zoo.measure(task)
    assert length > 1.0
    # Fifteen seconds leave no room for drift: a wall is seen to 3 % of at most 8 m, by hundreds of beams.
    assert figures.aligned <= figures.start < 0.1
    monkeypatch.setattr(drives, "run_episode", None)  # from now on the cache must do
    assert zoo.measure(task)[1][0]._replace(milliseconds=0.0) == figures._replace(milliseconds=0.0)
    log = task.drive().log
    assert log.geometry.scan_time == pytest.approx(0.199)
    assert any(record.scan.motion.theta for record in log)


def test_without_the_sweep_all_beams_are_taken_at_once(tmp_path):
    task = zoo.Task("lds-02", "empty-home", 0, arguments(tmp_path, sweep="off", minutes=0.05))
    assert task.drive().log.geometry.time_increment == 0.0


def test_the_worst_drive_stands_for_a_cell():
    good = zoo.Figures(0.1, 0.05, "sure", 1.0)
    worse = zoo.Figures(0.3, 0.02, "broken", 3.0)
    assert zoo.cell_figures([(10.0, [good]), (20.0, [worse])], ["rbpf"]) == {
        "driven [m]": 15,
        "rbpf start [m]": 0.3,
        "rbpf aligned [m]": 0.05,
        "rbpf says": "broken",
        "rbpf [ms]": 2.0,
    }


def test_a_shorter_laser_sees_nothing_beyond_its_range(log):
    short = with_range(log, 4.0)
    assert short.geometry.range_max == 4.0
    for old, new in zip(log, short, strict=True):
        assert new.scan.geometry == short.geometry
        kept = old.scan.ranges <= 4.0
        assert (new.scan.ranges[kept] == old.scan.ranges[kept]).all()
        assert np.isinf(new.scan.ranges[~kept]).all()
        assert new.scan.motion == old.scan.motion


def test_the_beams_that_are_kept_stay_where_and_when_they_were(log):
    thin = with_fewer_beams(log, 4)
    assert thin.geometry.angles == pytest.approx(GEOMETRY.angles[::4])
    assert thin.geometry.scan_time == pytest.approx(GEOMETRY.scan_time)
    assert (thin.records[3].scan.ranges == log.records[3].scan.ranges[::4]).all()


def test_turns_are_scaled_also_between_the_scans(log):
    turned = with_turns(log, 1.1)
    poses = [Pose2D(*pose) for pose in turned.track.poses]
    scaled = STEP._replace(theta=1.1 * STEP.theta)
    for a, b in pairwise(poses):
        assert between(a, b) == pytest.approx(scaled)
    assert turned.records[7].odometry == pytest.approx(poses[14])
    assert turned.records[7].scan.motion == pytest.approx(scaled)


def test_a_laser_of_four_metres_has_no_variant_with_a_longer_one(log):
    names = [name for name, _ in variants(with_range(log, 4.0))]
    assert names == ["whole", "1 of 2 beams", "1 of 4 beams", "turns x 0.9", "turns x 1.1"]


@pytest.mark.parametrize(
    ("first", "others", "left_out"),
    [((0.0, 1.0), 1.0, 0), ((1.0, 0.5), 1.0, 1), ((-0.4, -0.9), 0.0, 0)],
    ids=["a clock that runs", "one that steps back", "one that stands still"],
)
def test_a_log_is_judged_by_its_corrected_path(log, tmp_path, first, others, left_out):
    stamps = [*first, *(7.0 + others * k for k in range(len(log) - 2))]
    lines = ["PARAM robot_front_laser_max 20.0 0 host 0"]
    rows = []
    moved = transform_poses(Pose2D(3.0, -1.0, 0.5), path_of(log).poses)
    for stamp, record, pose in zip(stamps, log, moved, strict=True):
        place = " ".join(f"{value:.6f}" for value in record.odometry)
        ranges = " ".join(f"{value:.3f}" for value in record.scan.ranges)
        lines.append(f"FLASER 9 {ranges} {place} {place} {stamp} host {stamp}")
        rows.append([stamp, *pose])
    with gzip.open(tmp_path / "a.log.gz", "wt") as file:
        file.write("\n".join(lines))
    np.savetxt(tmp_path / "a.corr", rows)
    judged = read_judged_log(tmp_path / "a.log.gz")
    assert judged.kind == "path"
    assert len(judged.log) == len(log) - left_out
    scans = path_of(judged.log)
    assert judged.error(scans, scans, scans) == pytest.approx(0.0, abs=1e-5)
    bent = Trajectory(scans.stamps, scans.poses * np.array([1.0, 1.2, 1.0]))
    assert judged.error(bent, bent, bent) > 0.05


def test_a_log_is_judged_by_its_relations_or_by_its_own_path(log):
    path = path_of(log)
    ends = np.array([compose(STEP, STEP)])
    relations = Relations(path.stamps[:1], path.stamps[1:2], ends + np.array([0.3, 0.0, 0.0]))
    by_relations = JudgedLog(log, relations, None)
    assert by_relations.error(path, path, path) == pytest.approx(0.3)
    own = JudgedLog(log, None, None)
    assert own.kind == "own path"
    assert own.error(path, path, path) == pytest.approx(0.0, abs=1e-6)


def test_walls_turn_where_a_path_bends():
    """A robot spins in the middle of a room of 4 x 4 m, and its path loses 10 degrees on the way."""
    laser = LaserGeometry(360, -math.pi, math.pi / 180.0, 0.1, 8.0)
    headings = np.linspace(0.0, 1.0, 60)
    records = []
    for stamp, heading in enumerate(headings.tolist()):
        angles = laser.angles + heading
        ranges = 2.0 / np.maximum(np.abs(np.cos(angles)), np.abs(np.sin(angles)))
        scan = LaserScan(float(stamp), ranges.astype(np.float32), laser)
        records.append(LogRecord(float(stamp), Pose2D(0.0, 0.0, heading), scan))
    log = Log("room", records, laser)
    path = path_of(log)
    assert zoo.walls_turn(log, path) < 1.0
    lost = np.where(headings > 0.5, math.radians(10.0), 0.0)
    bent = path.poses - np.column_stack([np.zeros((60, 2)), lost])
    # The part in which it bends has walls of either direction, and none in between.
    assert zoo.walls_turn(log, Trajectory(path.stamps, bent)) == pytest.approx(10.0, abs=1.0)


@pytest.mark.parametrize("wrong", [["--drives", "0"], ["--logs", "."], ["--modes", "ground_truth"]])
def test_a_wrong_argument_is_named_before_anything_is_simulated(
    tmp_path, monkeypatch, capsys, wrong
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(zoo.sys, "argv", ["zoo.py", *wrong])
    with pytest.raises(SystemExit):
        zoo.main()
    assert wrong[0] in capsys.readouterr().err.splitlines()[-1]
    assert not list(tmp_path.iterdir())


def test_without_its_package_karto_says_what_to_install(monkeypatch):
    def missing(name):
        raise ImportError(f"No module named {name!r}")

    monkeypatch.setattr(karto.importlib, "import_module", missing)
    with pytest.raises(SystemExit, match="pip install yag-slam"):
        karto.load_yag()


def test_karto_is_told_where_the_laser_is_mounted(tmp_path):
    pytest.importorskip("yag_slam.graph_slam")
    task = zoo.Task("rplidar-c1", "empty-home", 0, arguments(tmp_path, sweep="off"))
    one = task.drive()
    assert one.log.geometry.mount.theta == pytest.approx(0.5 * math.pi)
    path = zoo.mapped(one.log, "karto").scans
    error = absolute_trajectory_error(path, one.truth, align=False).translation.rmse
    assert error < 0.1  # it matches on a grid of 0.05 m


def test_a_run_of_one_mode_keeps_what_the_others_had_on_the_same_drives(tmp_path):
    path = tmp_path / "zoo.json"
    cell = {"robot": "lds-01", "place": "hall", "driven [m]": 40}
    other = {"robot": "vacuum", "place": "hall", "driven [m]": 41}
    now = [cell | {"pose_graph [ms]": 1.0}, other | {"pose_graph [ms]": 2.0}]
    assert zoo.with_other_modes(path, now, zoo.CELL) == now
    before = [
        cell | {"pose_graph [ms]": 9.0, "rbpf [ms]": 8.0},
        other | {"driven [m]": 50, "rbpf [ms]": 7.0},
    ]
    path.write_text(json.dumps({"rows": before}))
    first, second = zoo.with_other_modes(path, now, zoo.CELL)
    assert first == now[0] | {"rbpf [ms]": 8.0}
    assert second == now[1]
