"""What the doctor finds."""

from drawn_drives import FLAT, drive

from slamgym.commands import cli, doctor
from slamgym.commands.doctor import findings
from slamgym.interop import write_carmen


def test_a_whole_installation_is_in_order(capsys):
    assert cli.main(["doctor"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("ok       slamgym: ")
    assert any(line.startswith("ok       numeric kernels: ") for line in lines)
    assert any(line.startswith("ok       films (ffmpeg): ffmpeg version") for line in lines)


def test_what_is_missing_or_broken_comes_with_its_fix(monkeypatch, capsys):
    installed = doctor._version
    monkeypatch.setattr(
        doctor,
        "_version",
        lambda name: "" if name in {"rosbags", "numba", "ros-rclpy"} else installed(name),
    )
    monkeypatch.setattr(
        doctor, "_films", lambda: (_ for _ in ()).throw(RuntimeError("no ffmpeg\nat all"))
    )
    found = {finding.what: finding for finding in findings()}
    assert found["extra ros"].state == "missing"
    assert found["extra ros"].fix == "pip install 'slamgym[ros]'"
    assert found["packages"].state == "broken"
    assert "numba missing" in found["packages"].found
    assert "ros-rclpy" not in found["packages"].found  # of an extra with a figure in its name
    assert found["packages"].fix == "pip install slamgym"  # brings what the installed one needs
    assert found["films (ffmpeg)"][1:3] == ("missing", "no ffmpeg at all")
    assert cli.main(["doctor"]) == 1
    assert "         fix: pip install 'slamgym[ros]'" in capsys.readouterr().out.splitlines()


def test_a_log_is_described_with_what_is_wrong(tmp_path, capsys):
    log, _ = drive(FLAT, [(1, 1), (2.5, 2.3), (4, 2.3), (7, 1), (5, 1)])
    write_carmen(tmp_path / "good.log", log.records, log.geometry)
    assert cli.main(["doctor", str(tmp_path / "good.log")]) == 0
    shown = capsys.readouterr().out
    assert "180, from -180.0 to 178.0 degrees" in shown
    assert "nothing is wrong" in shown
    assert "odometry / laser" in shown
    still = [record._replace(odometry=log.records[0].odometry) for record in log]
    write_carmen(tmp_path / "still.log", still, log.geometry)
    assert cli.main(["doctor", str(tmp_path / "still.log")]) == 1
    assert "odometry: the odometry measures no turns and no distances" in capsys.readouterr().out
    assert cli.main(["doctor", str(tmp_path / "still.log"), "--odometry-topic", "none"]) == 0
