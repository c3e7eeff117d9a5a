import functools

import numpy as np
import pytest
from drawn_drives import FLAT, drive

from slamgym.core.errors import InputFileError
from slamgym.core.types import Pose2D
from slamgym.slam import SlamConfig
from slamgym.slam.graph.graph_files import GRAPH, NODE_SCANS, read_graph, write_graph
from slamgym.slam.graph.map_graph import joined_graph
from slamgym.slam.graph.relative import moved_by, seen_from
from slamgym.slam.replay import replay


@functools.cache
def mapped():
    log, _ = drive(FLAT, [(1, 1), (2.2, 2.3), (3.8, 2.3), (4.7, 2.4)])
    config = SlamConfig.for_log(log.geometry.range_max, log.geometry.num_beams)
    return replay(log, config, np.random.default_rng(0))


def test_a_graph_that_is_read_draws_the_map_of_the_mapper(tmp_path):
    result = mapped()
    write_graph(tmp_path, result.graph)
    read = read_graph(tmp_path)
    # Nine digits are written, and beams meet the same cells.
    assert np.allclose(read.poses, result.processed.poses, atol=1e-7)
    grid = read.grid()
    assert grid.frame == result.grid.frame
    assert (grid.cells == result.grid.cells).mean() > 0.999
    assert read.drives[0].geometry == result.graph.drives[0].geometry
    assert read.drives[0].config == result.graph.drives[0].config


def test_the_edges_in_the_file_hold_at_the_poses_in_it(tmp_path):
    write_graph(tmp_path, mapped().graph)
    graph = read_graph(tmp_path)
    edges = graph.edges
    away = [
        seen_from(moved_by(graph.poses[first], measured), graph.poses[second])
        for first, second, measured in zip(edges.first, edges.second, edges.measured, strict=True)
    ]
    # The optimum of a good drive leaves millimetres to each edge: had the wheels' errors stayed in, centimetres.
    assert np.sqrt(np.mean(np.square(np.array(away)[:, :2]))) < 0.01


def test_two_graphs_in_one_keep_their_edges_and_their_scans(tmp_path):
    graph = mapped().graph
    count = len(graph.poses)
    both = joined_graph(graph, graph.moved(graph.poses + np.array([20.0, 0.0, 0.0])))
    write_graph(tmp_path, both)
    read = read_graph(tmp_path)
    assert len(read.poses) == 2 * count
    assert [drive.first for drive in read.drives] == [0, count]
    assert np.array_equal(read.edges.first[len(graph.edges.first) :] - count, graph.edges.first)
    width = graph.grid().frame.width_px
    assert read.grid().frame.width_px == pytest.approx(width + 20.0 / 0.05, abs=1)


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        (GRAPH, lambda text: text.replace(b"graph 1", b"graph 7"), "version 7"),
        (
            GRAPH,
            lambda text: text.replace(b"VERTEX_SE2 3 ", b"VERTEX_SE3 3 "),
            "no line of a planar g2o",
        ),
        (GRAPH, lambda text: b"".join(text.splitlines(keepends=True)[:-1]), "doesn't belong"),
        (NODE_SCANS, lambda data: data[: len(data) // 2], "no scans of slamgym"),
        (NODE_SCANS, lambda _: b"", "no scans of slamgym"),
    ],
)
def test_a_broken_file_is_one_sentence(tmp_path, name, change, said):
    write_graph(tmp_path, mapped().graph)
    path = tmp_path / name
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(InputFileError, match=said) as caught:
        read_graph(tmp_path)
    assert name in str(caught.value)


def test_missing_scans_are_named(tmp_path):
    write_graph(tmp_path, mapped().graph)
    (tmp_path / NODE_SCANS).unlink()
    with pytest.raises(InputFileError, match=NODE_SCANS):
        read_graph(tmp_path)


def test_a_graph_of_another_laser_is_kept_with_its_mount(tmp_path):
    graph = mapped().graph
    drive_scans = graph.drives[0]
    mounted = drive_scans._replace(
        geometry=drive_scans.geometry._replace(mount=Pose2D(0.1, 0.2, 0.3))
    )
    write_graph(tmp_path, type(graph)(graph.poses, graph.edges, graph.submaps, (mounted,)))
    assert read_graph(tmp_path).drives[0].geometry.mount == Pose2D(0.1, 0.2, 0.3)
