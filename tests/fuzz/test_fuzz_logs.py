"""Whatever a log, a trajectory or a file of settings for one holds, reading it gives a value or a SlamgymError."""

import gzip
import warnings

import numpy as np
import pytest
from fuzz.mutations import cases, must_read_or_refuse, mutated_bytes, mutated_text
from hypothesis import given
from hypothesis import strategies as st

from slamgym.core.types import LaserGeometry, LaserScan, Pose2D, Trajectory
from slamgym.interop import LogRecord, open_log, write_carmen, write_tum
from slamgym.interop.logs import read_relations
from slamgym.interop.rosbag_writer import write_rosbag2
from slamgym.interop.tum import read_tum
from slamgym.parametric.paths import read_waypoints

LASER = LaserGeometry(5, -1.5, 0.75, 0.12, 3.5)
ROBOTLASER = (
    b"ROBOTLASER1 0 -1.5 3.0 0.75 80 0.01 0 5 1 2 3 4 5 0 0 0 0 0 0 0 0 0 0 0 0 %d.5 host 0\n"
)
BYTE = st.sampled_from([0, 1, 63, 127, 128, 192, 240, 255])


def records() -> list[LogRecord]:
    ranges = np.array([1.0, 2.0, np.inf, 0.5, np.nan], np.float32)
    return [
        LogRecord(stamp, Pose2D(0.1 * stamp, 0.0, 0.01), LaserScan(stamp, ranges, LASER))
        for stamp in (1.0, 2.0, 3.0)
    ]


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    write_carmen(folder / "a.log", records(), LASER)
    plain = (folder / "a.log").read_bytes()
    robot = b"PARAM robot_front_laser_max 80\n" + b"".join(
        ROBOTLASER % number for number in range(4)
    )
    return [plain, gzip.compress(plain), robot]


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    pytest.importorskip("rosbags")
    folder = tmp_path_factory.mktemp("bags")
    write_rosbag2(folder / "bag", records(), LASER, storage="mcap")
    return next((folder / "bag").glob("*.mcap")).read_bytes()


@given(data=st.data())
@cases(200)
def test_carmen_logs(tmp_path, logs, data):
    path = tmp_path / "a.log"
    path.write_bytes(data.draw(mutated_bytes(logs) | mutated_text([logs[0], logs[2]])))
    must_read_or_refuse(open_log, path)


@given(data=st.data())
@cases(25)
def test_bags(tmp_path, bag, data):
    path = tmp_path / "a.mcap"
    path.write_bytes(data.draw(mutated_bytes([bag])))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        must_read_or_refuse(open_log, path)


@given(data=st.data())
@cases(50)
def test_messages_of_bags(tmp_path, bag, data):
    """The container is whole, so that what its messages hold is read."""
    path, content = tmp_path / "a.mcap", bytearray(bag)
    path.write_bytes(content)
    with pytest.importorskip("rosbags.rosbag2").Reader(path) as reader:
        messages = [(bag.index(message), len(message)) for _, _, message in reader.messages()]
    for _ in range(data.draw(st.integers(1, 4))):
        begin, length = data.draw(st.sampled_from(messages))
        content[begin + data.draw(st.integers(4, length - 1))] = data.draw(BYTE)
    path.write_bytes(content)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        must_read_or_refuse(open_log, path)


@given(mutated_text([b"# t x y z qx qy qz qw\n1.0 0 0 0 0 0 0 1\n2.0 1 0 0 0 0 0.1 0.99\n"]))
@cases(100)
def test_trajectories(tmp_path, content):
    path = tmp_path / "a.tum"
    path.write_bytes(content)
    must_read_or_refuse(read_tum, path)


@given(mutated_text([b"1.0 2.0 0.5 0 0 0 0 0.1\n2.0 3.0 0.5 0 0 0 0 0.1\n"]))
@cases(60)
def test_relations(tmp_path, content):
    path = tmp_path / "a.relations"
    path.write_bytes(content)
    must_read_or_refuse(read_relations, path)


@given(mutated_text([b"x,y,t\n1,2,0\n2;3;1\n", b"1,2\n2,3 # end\n"]))
@cases(60)
def test_waypoints(tmp_path, content):
    path = tmp_path / "a.csv"
    path.write_bytes(content)
    must_read_or_refuse(read_waypoints, path)


def test_good_files_pass(tmp_path, logs):
    for number, content in enumerate(logs):
        (tmp_path / f"{number}.log").write_bytes(content)
        assert len(open_log(tmp_path / f"{number}.log")) >= 3
    write_tum(tmp_path / "a.tum", Trajectory(np.array([1.0]), np.zeros((1, 3))))
    assert len(read_tum(tmp_path / "a.tum").stamps) == 1
