import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from slamgym.core.errors import InputFileError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, OccupancyGrid
from slamgym.interop import read_ros_map, write_ros_map
from slamgym.interop.ros_map import classify_greys

YAML = "image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: {}\n"


def write_image(folder, pixels, free_thresh=0.196):
    pixels = np.asarray(pixels, np.uint8)
    (folder / "map.pgm").write_bytes(b"P5\n%d %d\n255\n" % pixels.shape[::-1] + pixels.tobytes())
    (folder / "map.yaml").write_text(YAML.format(free_thresh))
    return folder / "map.yaml"


@settings(max_examples=30)
@given(
    arrays(
        np.uint8,
        st.tuples(st.integers(1, 9), st.integers(1, 9)),
        elements=st.sampled_from([0, 205, 254]),
    ),
    st.floats(0.001, 1.0),
    st.floats(-1e3, 1e3),
)
def test_what_is_written_is_read_back(tmp_path_factory, cells, resolution, origin):
    grid = OccupancyGrid(cells, GridFrame(resolution, origin, -origin, *cells.shape))
    back = read_ros_map(write_ros_map(tmp_path_factory.mktemp("map"), grid))
    assert back.frame.resolution == resolution
    assert back.frame.bounds == pytest.approx(grid.frame.bounds, abs=1e-11)
    assert (back.cells == cells).all()


def test_the_yaml_is_free_of_the_noise_of_floats(tmp_path):
    write_ros_map(
        tmp_path,
        OccupancyGrid(
            np.zeros((2, 2), np.uint8), GridFrame(0.05, -20.700000000000003, 0.1 + 0.2, 2, 2)
        ),
    )
    assert "origin: [-20.7, 0.3, 0.0]\n" in (tmp_path / "map.yaml").read_text()


def test_a_stem_names_both_files(tmp_path):
    grid = OccupancyGrid(np.full((2, 3), FREE, np.uint8), GridFrame(0.05, 0.0, 0.0, 2, 3))
    assert write_ros_map(tmp_path / "flat.v2", grid) == tmp_path / "flat.v2.yaml"
    assert (tmp_path / "flat.v2.pgm").exists()


@pytest.mark.parametrize("unknown", [205, 204, 127, 128, 220, 100])
@pytest.mark.parametrize("free_thresh", [0.196, 0.25])
def test_unknown_is_found_by_its_grey_value_whatever_the_thresholds_say(
    tmp_path, unknown, free_thresh
):
    pixels = np.full((20, 20), unknown)
    pixels[5:15, 5:15] = 254
    pixels[5, 5:15] = 0
    cells = read_ros_map(write_image(tmp_path, pixels, free_thresh)).cells
    assert cells[0, 0] == UNKNOWN
    assert cells[10, 10] == FREE
    assert cells[5, 10] == OCCUPIED


def test_a_black_and_white_image_has_nothing_unknown():
    assert set(np.unique(classify_greys(np.array([[0, 255], [254, 10]], np.uint8)))) == {
        OCCUPIED,
        FREE,
    }


BROKEN_YAMLS = {
    "no mapping": "- 1\n- 2\n",
    "not yaml": "image: [unclosed\n",
    "no image": "resolution: 0.05\norigin: [0, 0, 0]\n",
    "bad resolution": "image: map.pgm\nresolution: -1\norigin: [0, 0, 0]\n",
    "nan": "image: map.pgm\nresolution: .nan\norigin: [0, 0, 0]\n",
    "bad origin": "image: map.pgm\nresolution: 0.05\norigin: zero\n",
    "rotated": "image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0.7]\n",
    "missing image": "image: other.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n",
}


@pytest.mark.parametrize("text", BROKEN_YAMLS.values(), ids=BROKEN_YAMLS.keys())
def test_a_broken_description_gives_one_error_that_names_the_file(tmp_path, text):
    write_image(tmp_path, np.zeros((2, 2)))
    (tmp_path / "map.yaml").write_text(text)
    with pytest.raises(InputFileError, match=str(tmp_path)):
        read_ros_map(tmp_path / "map.yaml")


@settings(max_examples=60)
@given(st.binary(max_size=200), st.binary(max_size=200))
def test_junk_never_raises_anything_but_the_projects_error(tmp_path_factory, text, image):
    folder = tmp_path_factory.mktemp("junk")
    (folder / "map.yaml").write_bytes(text)
    (folder / "map.pgm").write_bytes(image)
    (folder / "ok.yaml").write_text(YAML.format(0.196))
    for name in ("map.yaml", "ok.yaml"):
        try:
            read_ros_map(folder / name)
        except InputFileError:
            continue


def test_an_unwritable_folder_is_one_error(tmp_path):
    (tmp_path / "file").write_text("")
    grid = OccupancyGrid(np.zeros((1, 1), np.uint8), GridFrame(0.05, 0.0, 0.0, 1, 1))
    with pytest.raises(InputFileError, match="can't be written"):
        write_ros_map(tmp_path / "file" / "map", grid)
