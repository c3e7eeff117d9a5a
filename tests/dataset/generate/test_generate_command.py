"""`slamgym generate` as a user runs it: killed, resumed, mistyped, without permission."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from shapely import box

from slamgym.cad import FloorPlan, write_houseexpo
from slamgym.commands import cli
from slamgym.dataset import Layout, read_manifest

OPTIONS = ["--seed", "3", "--minutes", "0.2", "--set", "particles=5"]


@pytest.fixture(scope="module")
def plans(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plans")
    rooms = box(0, 0, 3.0, 2.4).difference(box(1.4, 0.0, 1.6, 1.4))
    for name in ("a", "b", "c"):
        write_houseexpo(folder / f"{name}.json", FloorPlan(name, rooms))
    return folder


def arguments(plans, out, *more):
    return ["generate", "--plans", str(plans), "--out", str(out), *OPTIONS, *more]


def content(root: Path):
    return {
        str(path.relative_to(root)): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file() and path.name not in ("timing.jsonl", ".lock")
    }


def test_pairs_a_summary_and_a_contact_sheet(plans, tmp_path, capsys):
    command = arguments(plans, tmp_path / "out", "--pairs", "2", "--engine", "in_process")
    assert cli.main(command) == 0
    shown = capsys.readouterr().out
    sheet = tmp_path / "out" / "contact_sheet.png"
    assert f"contact sheet: {sheet}" in shown
    assert "2 pairs of 2 plans" in shown
    assert sheet.stat().st_size > 1000


def test_a_shard_has_a_folder_of_its_own(plans, tmp_path, capsys):
    out = tmp_path / "out"
    assert (
        cli.main(arguments(plans, out, "--pairs", "3", "--engine", "in_process", "--shard", "1/2"))
        == 0
    )
    assert str(out / "shard-00001-of-00002") in capsys.readouterr().out
    assert [record.index for record in read_manifest(out / "shard-00001-of-00002")] == [1]


def test_a_shard_of_fewer_pairs_than_shards_may_be_empty(plans, tmp_path, capsys):
    command = arguments(
        plans, tmp_path / "out", "--pairs", "1", "--engine", "in_process", "--shard", "1/2"
    )
    assert cli.main(command) == 0
    shown = capsys.readouterr().out
    assert "no pairs" in shown
    assert "contact sheet" not in shown


def test_the_settings_reach_the_exploration(plans, tmp_path):
    out = tmp_path / "out"
    more = [
        "--pairs",
        "1",
        "--engine",
        "in_process",
        "--set",
        "odometry=ideal",
        "lidar.range_max=5",
        "clutter.people=1",
    ]
    assert cli.main(arguments(plans, out, *more)) == 0
    env = json.loads((out / "config.json").read_text())["episode"]["env"]
    assert env["odometry"]["model"] == "ideal"
    assert env["lidar"]["range_max"] == 5
    assert env["clutter"]["people"] == 1
    assert env["slam"]["particles"] == 5
    assert next(iter(read_manifest(out))).odometry_ate == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--explorer", "explore_light"], "did you mean 'explore_lite'"),
        (["--pairs", "0"], "--pairs must be at least 1"),
        (["--workers", "-1"], "--workers must be at least 0, not -1"),
        (["--shard", "10/10"], "the last is 9/10"),
        (["--address", "auto"], "add --engine ray"),
        (["--minutes", "0"], "--minutes must be 'auto' or above 0"),
    ],
)
def test_a_senseless_option_is_one_line_and_makes_no_folder(plans, tmp_path, capsys, more, words):
    assert cli.main(arguments(plans, tmp_path / "out", *more)) == 2
    error = capsys.readouterr().err
    assert error.startswith("slamgym: error: ")
    assert words in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_missing_plan_folder_is_one_line(tmp_path, capsys):
    assert cli.main(arguments(tmp_path / "nowhere", tmp_path / "out")) == 2
    assert "nowhere" in capsys.readouterr().err


@pytest.mark.skipif(os.name != "posix", reason="POSIX permissions")
def test_an_unwritable_folder_is_one_line(plans, tmp_path, capsys):
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    if os.access(locked, os.W_OK):  # root may write anywhere but below a file
        locked = tmp_path / "file"
        locked.touch()
    assert cli.main(arguments(plans, locked / "out", "--engine", "in_process")) == 2
    error = capsys.readouterr().err
    assert str(locked) in error
    assert error.count("\n") == 1


def _committed(root):
    episodes = Layout(root).episodes
    return len(list(episodes.iterdir())) if episodes.exists() else 0


def _hear_ctrl_c():
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def test_ctrl_c_keeps_what_is_done(plans, tmp_path):
    out = tmp_path / "out"
    command = [
        sys.executable,
        "-m",
        "slamgym",
        *arguments(plans, out, "--pairs", "500", "--workers", "2"),
    ]
    # Where the tests run in the background of a shell, they and their children are born deaf to Ctrl-C.
    process = subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=_hear_ctrl_c,
    )
    while process.poll() is None and _committed(out) < 2:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=300)
    assert process.returncode == cli.EXIT_INTERRUPTED
    assert error.endswith("slamgym: error: interrupted\n")
    assert "Traceback" not in error
    assert len(list(read_manifest(out))) == _committed(out) >= 2
    assert not Layout(out).incoming.exists()
