import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.core.errors import InputFileError
from slamgym.core.geometry import wrap_angle
from slamgym.core.types import Trajectory
from slamgym.interop import read_tum, write_tum

numbers = st.floats(-1e4, 1e4)


@settings(max_examples=40)
@given(st.lists(st.tuples(st.floats(0, 1e9), numbers, numbers, st.floats(-3.14, 3.14)), max_size=8))
def test_what_is_written_is_read_back(tmp_path_factory, rows):
    path = tmp_path_factory.mktemp("tum") / "path.tum"
    rows.sort()
    table = np.array(rows).reshape(-1, 4)
    write_tum(path, Trajectory(table[:, 0], table[:, 1:]))
    back = read_tum(path)
    assert len(back) == len(rows)
    # Six decimals for stamps and positions; nine for the quaternion.
    assert np.abs(back.stamps - table[:, 0]).max(initial=0.0) < 1e-6
    assert np.abs(back.poses[:, :2] - table[:, 1:3]).max(initial=0.0) < 1e-6
    assert np.abs(wrap_angle(back.poses[:, 2] - table[:, 3])).max(initial=0.0) < 1e-7


@pytest.mark.parametrize(
    ("text", "line"),
    [("1 2 3\n", 1), ("# ok\n1 0 0 0 0 0 0 1\nx 0 0 0 0 0 0 1\n", 3), ("1 nan 0 0 0 0 0 1\n", 1),
     ("2 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n", 2)],
)  # fmt: skip
def test_a_faulty_line_is_named(tmp_path, text, line):
    (tmp_path / "path.tum").write_text(text)
    with pytest.raises(InputFileError, match=f"path.tum:{line}"):
        read_tum(tmp_path / "path.tum")


@settings(max_examples=40)
@given(st.binary(max_size=300))
def test_junk_never_raises_anything_but_the_projects_error(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("tum") / "path.tum"
    path.write_bytes(content)
    try:
        read_tum(path)
    except InputFileError:
        return
