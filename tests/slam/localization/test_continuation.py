import dataclasses
import json

import cv2
import numpy as np
import pytest
from drawn_drives import FLAT, OTHER, draw, drive

from slamgym.commands.cli import TABLE
from slamgym.core.errors import SlamgymError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from slamgym.interop import read_ros_map, read_tum, write_carmen, write_ros_map
from slamgym.slam import SlamConfig
from slamgym.slam.merge.continuing import continue_map
from slamgym.slam.merge.merging import Part
from slamgym.slam.replay import replay


def main(argv):
    return TABLE.run("slamgym", ["slam", *map(str, argv)])


WAY = [(1, 1), (2.2, 2.3), (3.8, 2.3), (4.7, 2.4), (4.7, 3.6), (7, 3.8)]


def half_known(limit=6.5):
    """A map of which the right part was never seen."""
    grid = draw(FLAT, (1, 1))
    cells = grid.cells.copy()
    cells[:, grid.frame.to_cell(limit, 0.0)[1] :] = UNKNOWN
    return OccupancyGrid(cells, grid.frame)


def continued(log, grid, **settings):
    suited = SlamConfig.for_log(log.geometry.range_max, log.geometry.num_beams)
    config = dataclasses.replace(suited, **{"resolution": grid.frame.resolution, **settings})
    alone = replay(log, config, np.random.default_rng(0))
    return continue_map(Part.of_picture("old", grid), alone, "new")


def test_a_mode_without_a_graph_is_refused():
    with pytest.raises(SlamgymError, match="--mode"):
        continued(drive(FLAT, WAY[:2])[0], half_known(), mode="dead_reckoning")


def test_the_old_map_stays_where_it_was_and_grows():
    log, truth = drive(FLAT, WAY)
    old = half_known()
    result = continued(log, old)
    frame = result.grid.frame
    assert frame.resolution == old.frame.resolution
    shift = (
        np.array([frame.origin_x - old.frame.origin_x, frame.origin_y - old.frame.origin_y])
        / frame.resolution
    )
    assert np.abs(shift - shift.round()).max() < 1e-6
    whole = draw(FLAT, (1, 1))
    rows, cols = np.nonzero(whole.cells == OCCUPIED)
    x, y = whole.frame.to_point(rows, cols)
    new_rows, new_cols = frame.to_cell(x, y)
    was = old.cells[rows, cols] == OCCUPIED
    walls = cv2.dilate((result.grid.cells == OCCUPIED).astype(np.uint8), np.ones((3, 3), np.uint8))
    now = walls[new_rows, new_cols] == 1
    assert now[was].mean() > 0.98, "walls of the old map"
    assert now[~was].mean() > 0.7, "walls that only the log has seen"
    away = np.hypot(*(result.trajectory.poses[:, :2] - truth[:, :2]).T)
    assert away.max() < 0.12


def test_what_the_log_never_saw_is_copied_cell_by_cell():
    log, _ = drive(FLAT, WAY)
    old = draw(FLAT, (1, 1))
    result = continued(log, old)
    seen = result.graph.grid()
    rows, cols = np.indices(old.cells.shape)
    x, y = old.frame.to_point(rows, cols)
    # Both lie on one lattice: the corner of the drawn map is at multiples of the cells.
    own_rows, own_cols = seen.frame.to_cell(x, y)
    inside = (own_rows >= 0) & (own_cols >= 0)
    inside &= (own_rows < seen.frame.height_px) & (own_cols < seen.frame.width_px)
    unseen = np.ones(old.cells.shape, dtype=bool)
    unseen[inside] = seen.cells[own_rows[inside], own_cols[inside]] == UNKNOWN
    assert unseen.sum() > 1000
    now = result.grid.cells[result.grid.frame.to_cell(x, y)]
    assert np.array_equal(now[unseen], old.cells[unseen])


def test_furniture_that_is_gone_is_cleared_in_the_end():
    log, _ = drive(FLAT, [(1, 1), (2.2, 2.3), (1, 1), (2.2, 2.3), (1, 1), *WAY[1:]])
    box = [(1.7, 1.2, 2.2, 1.2), (2.2, 1.2, 2.2, 1.7), (2.2, 1.7, 1.7, 1.7), (1.7, 1.7, 1.7, 1.2)]
    old = draw(np.vstack([FLAT, box]), (0.5, 0.5))
    result = continued(log, old)
    at = old.frame.to_cell(1.7, 1.5)
    assert old.cells[at] == OCCUPIED
    assert result.grid.cells[result.grid.frame.to_cell(1.7, 1.5)] == FREE


def test_another_resolution_is_refused():
    log, _ = drive(FLAT, WAY[:2])
    with pytest.raises(SlamgymError, match="resolution"):
        continued(log, draw(FLAT, (1, 1)), resolution=0.1)


def test_the_command_continues_a_run_and_writes_nothing_where_it_cannot(tmp_path, capsys):
    log, _ = drive(FLAT, WAY)
    other, _ = drive(OTHER, [(2, 1.5), (5.5, 1.6), (5.6, 3)])
    (tmp_path / "old").mkdir()
    write_ros_map(tmp_path / "old", half_known())
    for name, records in (("right", log), ("wrong", other)):
        write_carmen(tmp_path / f"{name}.log", records.records, records.geometry)
    arguments = ["--continue", str(tmp_path / "old"), "-o", str(tmp_path / "new")]
    with pytest.raises(SlamgymError, match="isn't sure to find itself"):
        main([str(tmp_path / "wrong.log"), *arguments])
    assert not (tmp_path / "new").exists()
    with pytest.raises(SlamgymError, match="old: is the map to go on with"):
        main([str(tmp_path / "right.log"), *arguments[:-1], str(tmp_path / "old")])
    assert main([str(tmp_path / "right.log"), *arguments]) == 0
    summary = json.loads((tmp_path / "new" / "summary.json").read_text())
    assert summary["continued"] == str(tmp_path / "old")
    grid = read_ros_map(tmp_path / "new" / "map.yaml")
    assert (grid.cells == OCCUPIED).sum() > (half_known().cells == OCCUPIED).sum()
    doubt = (tmp_path / "new" / "trajectory_doubt.csv").read_text().splitlines()
    assert len(doubt) == 1 + len(read_tum(tmp_path / "new" / "trajectory.tum"))
    assert "map" in capsys.readouterr().out


def test_a_turned_map_is_not_continued(tmp_path):
    log, _ = drive(FLAT, WAY[:2])
    write_carmen(tmp_path / "a.log", log.records, log.geometry)
    write_ros_map(tmp_path, dataclasses.replace(draw(FLAT, (1, 1))))
    text = (tmp_path / "map.yaml").read_text().replace(", 0.0]", ", 0.5]")
    (tmp_path / "map.yaml").write_text(text)
    with pytest.raises(SlamgymError, match=r"turned by 0\.5 rad"):
        main(
            [
                str(tmp_path / "a.log"),
                "--continue",
                str(tmp_path / "map.yaml"),
                "-o",
                str(tmp_path / "new"),
            ]
        )
