import json

import cv2
import numpy as np
import pytest
from drawn_drives import FLAT, OTHER, draw, drive

from slamgym.commands.cli import TABLE
from slamgym.core.errors import SlamgymError
from slamgym.core.types import FREE
from slamgym.interop import read_tum, write_carmen, write_ros_map


def main(argv):
    return TABLE.run("slamgym", ["localize", *map(str, argv)])


WAY = [(1, 1), (2.2, 2.3), (3.8, 2.3), (4.7, 2.4), (4.7, 3.6)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A map, a log of its building and one of another."""
    folder = tmp_path_factory.mktemp("localize")
    write_ros_map(folder, draw(FLAT, (1, 1)))
    for name, walls, way in (
        ("log", FLAT, WAY),
        ("other", OTHER, [(2, 1.5), (5.5, 1.6), (5.6, 3), (4.6, 4.8)]),
    ):
        log, _ = drive(walls, way)
        write_carmen(folder / f"{name}.log", log.records, log.geometry)
    return folder


def run(folder, out, *options, log="log.log", world="map.yaml"):
    return main([str(folder / world), str(folder / log), "-o", str(out), *options])


def test_a_log_is_localised_and_all_files_are_written(folder, tmp_path, capsys):
    assert run(folder, tmp_path) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "localization.jsonl", "localization.png", "summary.json", "trajectory.tum",
    ]  # fmt: skip
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["final_state"] == "localised"
    assert summary["final_pose"][:2] == pytest.approx([4.7, 3.6], abs=0.15)
    lines = [
        json.loads(line) for line in (tmp_path / "localization.jsonl").read_text().splitlines()
    ]
    assert len(lines) == summary["processed_scans"]
    assert {"stamp", "state", "pose", "covariance", "fit", "hypotheses"} == set(lines[0])
    assert sum(line["state"] == "localised" for line in lines) == summary["states"]["localised"]
    assert 0 < len(read_tum(tmp_path / "trajectory.tum")) < summary["scans"]
    assert cv2.imread(str(tmp_path / "localization.png")).shape[0] > 300
    assert "localised" in capsys.readouterr().out


def test_another_building_is_said(folder, tmp_path, capsys):
    assert run(folder, tmp_path, log="other.log") == 0
    assert "NOT LOCALISED" in capsys.readouterr().out
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["localised_after_s"] is None
    assert summary["final_state"] in ("searching", "ambiguous")


def test_the_image_beside_a_yaml_and_the_folder_are_the_same_map(folder, tmp_path):
    for name, world in (("yaml", "map.yaml"), ("image", "map.pgm"), ("folder", ".")):
        run(folder, tmp_path / name, world=world)
    files = [
        (tmp_path / name / "trajectory.tum").read_bytes() for name in ("yaml", "image", "folder")
    ]
    assert files[0] == files[1] == files[2]


def test_a_map_without_yaml_needs_a_resolution(folder, tmp_path):
    (tmp_path / "bare.pgm").write_bytes((folder / "map.pgm").read_bytes())
    arguments = [str(tmp_path / "bare.pgm"), str(folder / "log.log"), "-o", str(tmp_path / "out")]
    with pytest.raises(SlamgymError, match=r"bare\.pgm: .*--resolution"):
        main(arguments)
    assert main([*arguments, "--resolution", "0.05"]) == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["final_pose"][:2] == pytest.approx([4.7 + 0.5, 3.6 + 0.5], abs=0.15)


def test_an_initial_pose_is_taken(folder, tmp_path):
    run(folder, tmp_path, "--initial-pose", "1", "1", "0.8")
    assert json.loads((tmp_path / "summary.json").read_text())["localised_after_s"] == 0.0


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (["--initial-pose", "1", "nan", "0"], "initial-pose"),
        (["--resolution", "0"], "--resolution"),
        (["--config", "missing.json"], "missing.json"),
    ],
)
def test_bad_arguments_are_one_clear_error(folder, tmp_path, options, problem):
    with pytest.raises(SlamgymError, match=problem):
        run(folder, tmp_path / "out", *options)
    assert not (tmp_path / "out").exists()


def test_a_map_without_floor_is_one_clear_error(folder, tmp_path):
    image = np.zeros((50, 50), np.uint8)
    cv2.imwrite(str(tmp_path / "black.png"), image)
    arguments = [str(tmp_path / "black.png"), str(folder / "log.log"), "-o", str(tmp_path / "out")]
    with pytest.raises(SlamgymError, match="none of its cells is free"):
        main([*arguments, "--resolution", "0.05"])
    assert (image != FREE).all()


@pytest.mark.parametrize("junk", [b"", b"P5\n3 3\n255\n", b"image: [", b"\x00" * 40])
def test_junk_for_a_map_is_one_clear_error(folder, tmp_path, junk):
    for name in ("a.yaml", "a.pgm"):
        (tmp_path / name).write_bytes(junk)
        with pytest.raises(SlamgymError, match=r"a\.(yaml|pgm)"):
            main(
                [
                    str(tmp_path / name),
                    str(folder / "log.log"),
                    "-o",
                    str(tmp_path / "out"),
                    "--resolution",
                    "0.05",
                ]
            )


def test_a_log_without_odometry_is_one_sentence(folder, tmp_path):
    with pytest.raises(SlamgymError, match=r"log\.log.*no odometry to use"):
        run(folder, tmp_path, "--odometry-topic", "none")
