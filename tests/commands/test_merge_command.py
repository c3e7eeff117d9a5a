import functools
import json
import shutil

import numpy as np
import pytest
from drawn_drives import FLAT, HERE, OTHER, ROUND, THERE, draw, drive

from slamgym.commands.cli import TABLE
from slamgym.core.errors import SlamgymError
from slamgym.interop import read_ros_map, read_tum, write_carmen, write_ros_map
from slamgym.slam import SlamConfig
from slamgym.slam.graph.graph_files import GRAPH, NODE_SCANS, read_graph, write_graph
from slamgym.slam.replay import replay


@functools.cache
def log_of(name):
    walls, way = {"a": (FLAT, HERE), "b": (FLAT, THERE), "other": (OTHER, ROUND)}[name]
    return drive(walls, way, seed=len(name))[0]


@functools.cache
def graph_of(name):
    log = log_of(name)
    config = SlamConfig.for_log(log.geometry.range_max, log.geometry.num_beams)
    return replay(log, config, np.random.default_rng(0)).graph


@pytest.fixture
def folder(tmp_path):
    """A mapped drive, a log of another, a bare map, and the log of another building."""
    (tmp_path / "a").mkdir()
    write_graph(tmp_path / "a", graph_of("a"))
    for name in ("b", "other"):
        write_carmen(tmp_path / f"{name}.log", log_of(name).records, log_of(name).geometry)
    (tmp_path / "bare").mkdir()
    write_ros_map(tmp_path / "bare", draw(FLAT, (1, 1)))
    return tmp_path


def merge(folder, *names, out="out", options=()):
    arguments = [str(folder / name) for name in names]
    return TABLE.run("slamgym", ["merge", *arguments, "-o", str(folder / out), *options])


def contents(path):
    return {file.name: file.read_bytes() for file in sorted(path.rglob("*")) if file.is_file()}


def test_a_graph_a_log_and_a_bare_map_become_one_map(folder, capsys):
    before = contents(folder / "a")
    assert merge(folder, "a", "b.log", "bare") == 0
    out = folder / "out"
    summary = json.loads((out / "summary.json").read_text())
    assert summary["sure"]
    assert [entry["is_picture"] for entry in summary["inputs"]] == [False, False, True]
    assert summary["inputs"][0]["pose"] == [0.0, 0.0, 0.0]
    assert all(entry["evidence_nats"] > 4.0 for entry in summary["inputs"][1:])
    assert read_ros_map(out / "map.yaml").cells.size > graph_of("a").grid().cells.size
    graph = read_graph(out)
    assert len(graph.drives) == 2
    for number, drive_scans in enumerate(graph.drives, 1):
        path = read_tum(out / f"trajectory_{number}.tum")
        assert np.allclose(path.poses[:, :2], graph.poses[drive_scans.nodes, :2], atol=1e-5)
    assert (out / "map.png").exists()
    assert contents(folder / "a") == before
    captured = capsys.readouterr()
    assert "picture alone" in captured.err
    lines = [line for line in captured.out.splitlines() if line.startswith(str(folder / "b.log"))]
    assert len(lines) == 1
    assert lines[0].endswith(": sure")


def test_two_buildings_are_refused_in_a_sentence_and_nothing_is_written(folder, capsys):
    assert merge(folder, "a", "other.log") == 1
    assert not (folder / "out").exists()
    said = [line for line in capsys.readouterr().err.splitlines() if "not merged" in line]
    assert len(said) == 1
    assert str(folder / "other.log") in said[0]


def test_a_guess_is_marked_as_one(folder, capsys):
    assert merge(folder, "a", "other.log", options=["--guess"]) == 0
    summary = json.loads((folder / "out" / "summary.json").read_text())
    assert not summary["sure"]
    assert "GUESS" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("names", "out", "said"),
    [
        (["a"], "out", "two maps or more"),
        (["a", "a/../a"], "out", "once more"),
        (["a", "b.log"], "a", "would be written over"),
        (["b.log", "bare/map.yaml"], "bare", "would be written over"),
        (["a", "nowhere"], "out", "doesn't exist"),
        (["a", "b.log"], "b.log", "is a file"),
    ],
)
def test_bad_inputs_are_one_sentence(folder, names, out, said):
    before = contents(folder)
    with pytest.raises(SlamgymError, match=said):
        merge(folder, *names, out=out)
    assert contents(folder) == before


def test_folders_without_scans_other_versions_and_maps_without_resolution_are_one_sentence(folder):
    for name in ("no scans", "old"):
        shutil.copytree(folder / "a", folder / name)
    (folder / "no scans" / NODE_SCANS).unlink()
    text = (folder / "old" / GRAPH).read_text()
    (folder / "old" / GRAPH).write_text(text.replace("graph 1", "graph 9"))
    bare = (folder / "bare" / "map.yaml").read_text()
    lines = [line for line in bare.splitlines() if not line.startswith("resolution")]
    (folder / "bare" / "map.yaml").write_text("\n".join(lines))
    (folder / "empty").mkdir()
    for name, said in {
        "no scans": NODE_SCANS, "old": "version 9", "bare": "resolution", "empty": "empty",
    }.items():  # fmt: skip
        with pytest.raises(SlamgymError, match=said):
            merge(folder, "a", name)
        assert not (folder / "out").exists()
