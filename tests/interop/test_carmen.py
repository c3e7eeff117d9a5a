import gzip

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.core.errors import InputFileError
from slamgym.core.types import LaserGeometry, LaserScan, Pose2D
from slamgym.interop import LogRecord, read_carmen, write_carmen


def flaser(ranges=(1.0, 2.0, 3.0), pose=(0.0, 0.0, 0.0), stamp=1.0, laser=None):
    values = " ".join(str(r) for r in ranges)
    laser = " ".join(map(str, laser or pose))
    return f"FLASER {len(ranges)} {values} {laser} {' '.join(map(str, pose))} {stamp} host {stamp}"


def read_lines(folder, *lines):
    path = folder / "a.log"
    path.write_text("\n".join(lines) + "\n")
    return read_carmen(path)


class TestRoundTrip:
    @pytest.mark.parametrize("name", ["a.log", "a.log.gz"])
    @pytest.mark.parametrize("message", ["FLASER", "ROBOTLASER1"])
    def test_scans_poses_and_geometry_survive(self, tmp_path, records, geometry, name, message):
        write_carmen(tmp_path / name, records, geometry, message=message)
        log = read_carmen(tmp_path / name)
        assert log.warnings.sentences() == []
        assert len(log) == len(records)
        g = log.geometry
        assert g.num_beams == geometry.num_beams
        assert g.angles == pytest.approx(geometry.angles, abs=1e-7)
        assert (g.range_min, g.range_max) == (0.12, 3.5)
        assert g.mount == pytest.approx(geometry.mount, abs=1e-5)
        for ours, theirs in zip(records, log, strict=True):
            assert theirs.stamp == pytest.approx(ours.stamp, abs=1e-6)
            assert theirs.odometry == pytest.approx(ours.odometry, abs=1e-6)
            finite = np.isfinite(ours.scan.ranges)
            assert theirs.scan.ranges[finite] == pytest.approx(ours.scan.ranges[finite], abs=6e-4)
            assert np.isposinf(theirs.scan.ranges[3])
            # Too close and erroneous readings share one mark in the format.
            assert np.isnan(theirs.scan.ranges[4:6]).all()

    def test_the_same_records_give_the_same_bytes(self, tmp_path, records, geometry):
        for name in ("a.log.gz", "b.log.gz"):
            write_carmen(tmp_path / name, records, geometry)
        assert (tmp_path / "a.log.gz").read_bytes() == (tmp_path / "b.log.gz").read_bytes()

    def test_a_return_just_inside_the_limit_stays_a_return(self, tmp_path, records, geometry):
        records[0].scan.ranges[0] = 3.49996
        write_carmen(tmp_path / "a.log", records, geometry)
        assert np.isfinite(read_carmen(tmp_path / "a.log").records[0].scan.ranges[0])

    @given(
        st.lists(
            st.floats(width=32, min_value=0.0, max_value=4.0)
            | st.sampled_from(
                [0.0005, 0.0625, 1.0625, 3.4995, 3.4999, 3.5, np.inf, -np.inf, np.nan]
            ),
            min_size=2,
            max_size=20,
        )
    )
    def test_ranges_are_written_as_python_rounds_them(self, tmp_path_factory, values):
        ranges = np.array(values, dtype=np.float32)
        geometry = LaserGeometry(len(values), -0.5, 0.1, 0.12, 3.5)
        path = tmp_path_factory.getbasetemp() / "rounded.log"
        scan = LaserScan(1.0, ranges, geometry)
        write_carmen(
            path, [LogRecord(1.0, Pose2D(0.0, 0.0, 0.0), scan)], geometry, message="FLASER"
        )
        written = path.read_text().splitlines()[-1].split()[2 : 2 + len(values)]
        expected = [
            0.0 if not value > 0.0 else 3.5 if value >= 3.5 else min(value, 3.499)
            for value in map(float, ranges)
        ]
        assert written == [f"{value:.3f}" for value in expected]


class TestGeometry:
    @pytest.mark.parametrize(
        ("beams", "step", "last"), [(180, 1.0, 89.0), (181, 1.0, 90.0), (361, 0.5, 90.0)]
    )
    def test_a_sick_without_parameters_covers_half_a_turn(self, tmp_path, beams, step, last):
        angles = np.degrees(read_lines(tmp_path, flaser([1.0] * beams)).geometry.angles)
        assert angles[[0, -1]] == pytest.approx([-90.0, last])
        assert np.diff(angles) == pytest.approx(step)

    def test_parameters_are_used(self, tmp_path):
        log = read_lines(
            tmp_path,
            "PARAM laser_front_laser_resolution 0.5 0 host 0",
            "PARAM robot_front_laser_max 2.5 0 host 0",
            flaser([1.0, 2.0, 2.5]),
        )
        assert log.geometry.angle_increment == pytest.approx(np.radians(0.5))
        assert log.geometry.angles[1] == pytest.approx(0.0)
        assert np.isposinf(log.records[0].scan.ranges[2])

    def test_a_constant_offset_between_the_poses_is_the_mount(self, tmp_path):
        lines = [flaser(pose=(k, 0, 0), laser=(k + 0.2, 0.1, 0), stamp=k) for k in range(5)]
        assert read_lines(tmp_path, *lines).geometry.mount == pytest.approx((0.2, 0.1, 0.0))

    def test_corrected_poses_are_no_mount(self, tmp_path):
        lines = [flaser(pose=(k, 0, 0), laser=(k * 1.1, 0.1 * k, 0), stamp=k) for k in range(9)]
        log = read_lines(tmp_path, *lines)
        assert log.geometry.mount == (0.0, 0.0, 0.0)
        assert log.records[3].odometry.x == 3.0


class TestFaults:
    def test_truncated_broken_and_unknown_lines_are_counted_with_their_place(self, tmp_path):
        good = flaser(stamp=2.0)
        log = read_lines(
            tmp_path,
            good,
            good[: len(good) // 2],
            flaser([1, "x", 2]),
            "WHAT 1 2 3",
            flaser(stamp=3),
        )
        assert len(log) == 2
        text = "\n".join(log.warnings.sentences())
        assert "truncated FLASER line" in text
        assert "unreadable FLASER line" in text
        assert "unknown message type" in text
        assert "a.log:2" in text

    def test_nan_ranges_stay_nan_and_are_counted(self, tmp_path):
        log = read_lines(tmp_path, flaser([1.0, "nan", -1.0, "inf"]))
        assert np.isnan(log.records[0].scan.ranges).tolist() == [False, True, True, False]
        assert "NaN or negative" in log.warnings.sentences()[0]

    @pytest.mark.parametrize("stamp", ["nan", "inf", "1e39", "-1e308"])
    def test_a_stamp_that_is_no_time_costs_one_scan(self, tmp_path, stamp):
        log = read_lines(tmp_path, flaser(stamp=1), flaser(stamp=stamp), flaser(stamp=3))
        assert [record.stamp for record in log] == [1, 3]
        assert log.warnings.counts["stamp that is not a time"] == 1

    @pytest.mark.parametrize("number", ["1e39", "1e308", "nan", "-inf"])
    @pytest.mark.parametrize("kind", ["ROBOTLASER1", "FLASER"])
    def test_impossible_numbers_about_the_laser_are_not_used(
        self, tmp_path, records, geometry, kind, number
    ):
        path = tmp_path / "a.log"
        write_carmen(path, records, geometry, message=kind)
        text = (
            path.read_text()
            .replace(" 3.5 0", f" {number} 0")
            .replace("from 3.5 m", f"from {number} m")
        )
        path.write_text(
            text.replace("offset -0.064", f"offset {number}").replace(
                " 3.5 0.01", f" {number} 0.01"
            )
        )
        log = read_carmen(path)
        assert len(log) == len(records)
        assert log.geometry.range_max == 80.0
        assert log.geometry.mount == pytest.approx(geometry.mount, abs=1e-5)

    def test_one_stamp_far_ahead_costs_one_scan(self, tmp_path):
        stamps = [1, 2, 99, 3, 4, 5]
        log = read_lines(tmp_path, *(flaser(stamp=s) for s in stamps))
        assert [r.stamp for r in log] == [1, 2, 3, 4, 5]
        assert log.warnings.counts["scan left out because time goes backwards"] == 1

    def test_jumps_of_the_odometry_are_left_out_by_speed(self, tmp_path):
        driven = [0.0, 0.1, 5000.0, 5000.1, 0.3, 60.3]
        stamps = [1.0, 2.0, 3.0, 4.0, 5.0, 65.0]
        lines = [
            flaser(pose=(x, 0.0, 0.0), stamp=stamp) for x, stamp in zip(driven, stamps, strict=True)
        ]
        log = read_lines(tmp_path, *lines)
        # 60 m in a minute are driven, 5 km in a second are not.
        assert [record.odometry.x for record in log] == pytest.approx(
            [0.0, 0.1, 0.1, 0.2, 0.2, 60.2]
        )
        assert [finding.kind for finding in log.findings] == ["jump"]
        assert "in 2 places; by 4999.9 m" in log.findings[0].sentence

    def test_a_scan_with_other_beams_is_left_out(self, tmp_path):
        log = read_lines(tmp_path, flaser(), flaser([1.0]), flaser(stamp=2))
        assert len(log) == 2

    @pytest.mark.parametrize(
        "content", [b"", b"ODOM 1 2 3\n", b"\x00\x01\x02" * 100, b"\x1f\x8b\x08 no gzip"]
    )
    def test_a_file_without_scans_is_one_error(self, tmp_path, content):
        (tmp_path / "a.log").write_bytes(content)
        with pytest.raises(InputFileError, match=r"a\.log"):
            read_carmen(tmp_path / "a.log")

    def test_a_missing_file_and_a_folder_are_one_error(self, tmp_path):
        for path in (tmp_path / "none.log", tmp_path):
            with pytest.raises(InputFileError, match="can't be read"):
                read_carmen(path)

    def test_a_truncated_gzip_keeps_what_was_readable(self, tmp_path, records, geometry):
        write_carmen(tmp_path / "a.log.gz", records * 20, geometry)
        content = (tmp_path / "a.log.gz").read_bytes()
        (tmp_path / "a.log.gz").write_bytes(content[: len(content) // 2])
        log = read_carmen(tmp_path / "a.log.gz")
        assert 0 < len(log) < 200
        assert any("end early" in sentence for sentence in log.warnings.sentences())

    def test_gzip_is_known_by_its_content(self, tmp_path):
        (tmp_path / "a.log").write_bytes(gzip.compress((flaser() + "\n").encode()))
        assert len(read_carmen(tmp_path / "a.log")) == 1


LINES = st.one_of(
    st.sampled_from(
        [
            flaser(),
            flaser(stamp=0.5),
            "ODOM 1 2 3 0 0 0 1 h 1",
            "FLASER",
            "ROBOTLASER1",
            "FLASER 1e9",
        ]
    ),
    st.text(max_size=40),
    st.lists(
        st.sampled_from(["FLASER", "ROBOTLASER1", "3", "-1", "nan", "1e999", "1e39", "x", "0.5"]),
        max_size=25,
    ).map(" ".join),
)


@settings(max_examples=150)
@given(st.lists(LINES, max_size=8), st.binary(max_size=60), st.booleans())
def test_no_content_raises_anything_but_the_projects_error(
    tmp_path_factory, lines, junk, compressed
):
    content = "\n".join(lines).encode("utf-8", "surrogatepass") + junk
    path = tmp_path_factory.mktemp("log") / "a.log"
    path.write_bytes(gzip.compress(content) if compressed else content)
    try:
        log = read_carmen(path)
    except InputFileError:
        return
    assert len(log) > 0
    assert isinstance(log.geometry, LaserGeometry)
    stamps = [record.stamp for record in log]
    assert stamps == sorted(stamps)
    assert all(len(record.scan.ranges) == log.geometry.num_beams for record in log)
