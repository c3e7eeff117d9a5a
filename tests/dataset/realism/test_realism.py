"""Sets of maps from folders good and bad, and the command that compares them."""

import functools
import json

import numpy as np
import pytest

from slamgym.commands.cli import main
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, OccupancyGrid
from slamgym.dataset.realism.comparison import read_map_sets
from slamgym.interop import write_ros_map
from slamgym.metrics.two_sample import tree_learner

COUNT = 10


def drawing(seed: int, wall: int):
    """A flat of two rooms with walls so many cells thick and some specks."""
    rng = np.random.default_rng(seed)
    height, width = rng.integers(70, 110, 2)
    cells = np.full((height + 20, width + 20), UNKNOWN, np.uint8)
    cells[10:-10, 10:-10] = OCCUPIED
    cells[10 + wall : -10 - wall, 10 + wall : -10 - wall] = FREE
    column = int(rng.integers(35, 45))
    cells[10:50, column : column + wall] = OCCUPIED
    rows, cols = rng.integers(55, 65, (2, 5))
    cells[rows, cols] = OCCUPIED
    return cells


def write_maps(folder, wall, count=COUNT, seed=0, resolution=0.05):
    folder.mkdir(parents=True)
    for i in range(count):
        cells = drawing(seed + i, wall)
        write_ros_map(
            folder / f"flat{i // 2}__run{i}",
            OccupancyGrid(cells, GridFrame(resolution, 0, 0, *cells.shape)),
        )
    return folder


@pytest.fixture
def folders(tmp_path):
    return write_maps(tmp_path / "thin", 1), write_maps(tmp_path / "thick", 3, seed=100)


def test_maps_are_read_and_what_is_no_map_is_counted_with_its_reason(folders):
    thin, thick = folders
    (thin / "broken.yaml").write_text("image: nowhere.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n")
    cells = np.full((60, 60), UNKNOWN, np.uint8)
    write_ros_map(thin / "blank", OccupancyGrid(cells, GridFrame(0.05, 0, 0, 60, 60)))
    write_ros_map(
        thin / "coarse", OccupancyGrid(drawing(1, 1), GridFrame(0.1, 0, 0, *drawing(1, 1).shape))
    )
    one, other = read_map_sets([thin, thick])
    assert [len(s.maps) for s in (one, other)] == [COUNT, COUNT]
    assert one.skipped == {
        "can't be read as a map": 1,
        "less than 4 m2 of free space": 1,
        "cells larger than 0.06 m": 1,
    }
    assert len(set(other.buildings)) == COUNT
    grouped = read_map_sets([thin, thick], building="^[^_]+")[1]
    assert sorted(set(grouped.buildings)) == [f"flat{i}" for i in range(COUNT // 2)]


@pytest.mark.parametrize(
    ("arrange", "message"),
    [
        (lambda folder: write_maps(folder, 1, count=3), "holds 3 maps"),
        (lambda folder: folder.mkdir(), "neither a manifest.jsonl nor ROS maps"),
        (lambda folder: None, "is not a folder"),
    ],
)
def test_too_little_is_one_clear_error(tmp_path, arrange, message):
    arrange(tmp_path / "maps")
    with pytest.raises(InputFileError, match=message):
        read_map_sets([tmp_path / "maps"])


def test_other_mistakes_are_refused(folders, tmp_path):
    thin, thick = folders
    with pytest.raises(ConfigError, match="no regular expression"):
        read_map_sets([thin, thick], building="(")
    with pytest.raises(ConfigError, match="named twice"):
        read_map_sets([thin, thin])
    with pytest.raises(InputFileError, match="shows 1 buildings"):
        read_map_sets([thin], building="flat")


def test_the_command_writes_page_figures_and_the_same_again(folders, tmp_path, capsys, monkeypatch):
    pytest.importorskip("sklearn")
    few_trees = functools.partial(tree_learner, trees=30)
    monkeypatch.setattr("slamgym.dataset.realism.comparison.tree_learner", few_trees)
    words = ["dataset", "realism", str(folders[0]), "--against", str(folders[1]), "--halvings", "1"]
    for out in ("one", "two"):
        assert main([*words, "-o", str(tmp_path / out)]) == 0
    assert "realism.html" in capsys.readouterr().out
    names = ["realism.html", "realism.json", "realism.md"]
    for name in names:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    report = json.loads((tmp_path / "one/realism.json").read_text())
    rows = {(t["first"], t["second"]): t["accuracy"]["value"] for t in report["tests"]}
    assert rows["thin", "thick"] > 0.9
    assert {("thin", "thin"), ("thick", "thick")} < set(rows)
    assert set(report["most_telling"][:3]) < {row["name"] for row in report["statistics"]}
    distances = {row["name"]: row["distances"]["thick"] for row in report["statistics"]}
    assert distances["run_1"] == 1.0
    page = (tmp_path / "one/realism.html").read_text()
    assert page.count("data:image/webp") == 4
    assert "<script" not in page
    assert "://" not in page


def test_what_is_not_installed_is_left_out_and_said(folders, tmp_path, monkeypatch):
    monkeypatch.setattr("slamgym.commands.dataset.realism.is_installed", lambda _: False)
    out = tmp_path / "out"
    assert (
        main(["dataset", "realism", str(folders[0]), "--against", str(folders[1]), "-o", str(out)])
        == 0
    )
    page = (out / "realism.html").read_text()
    assert "slamgym[clean]" in page
