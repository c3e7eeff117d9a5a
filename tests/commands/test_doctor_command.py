"""What the doctor finds, and completion as the shell itself does it."""

import shutil
import subprocess

import pytest
from drawn_drives import FLAT, drive

from slamgym.commands import cli, doctor
from slamgym.commands.completion import completion_script
from slamgym.commands.doctor import findings
from slamgym.interop import write_carmen


@pytest.fixture(scope="module")
def script(tmp_path_factory):
    path = tmp_path_factory.mktemp("completion") / "slamgym.bash"
    path.write_text(completion_script())
    return path


def complete(script, *words):
    """What bash offers for the last word."""
    quoted = " ".join(f"'{word}'" for word in ("slamgym", *words))
    line = (
        f'source {script}; COMP_WORDS=({quoted}); COMP_CWORD={len(words)}; _slamgym; echo "${{COMPREPLY[*]}}"'
    )
    return subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=True).stdout.split()


def test_a_whole_installation_is_in_order(capsys):
    assert cli.main(["doctor"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("ok       slamgym: ")
    assert any(line.startswith("ok       numeric kernels: ") for line in lines)
    assert any(line.startswith("ok       films (ffmpeg): ffmpeg version") for line in lines)


def test_what_is_missing_or_broken_comes_with_its_fix(monkeypatch, capsys):
    installed = doctor._version
    monkeypatch.setattr(
        doctor, "_version", lambda name: "" if name in {"rosbags", "numba"} else installed(name)
    )
    monkeypatch.setattr(doctor, "_films", lambda: (_ for _ in ()).throw(RuntimeError("no ffmpeg\nat all")))
    found = {finding.what: finding for finding in findings()}
    assert found["extra ros"].state == "missing"
    assert found["extra ros"].fix == "pip install 'slamgym[ros]'"
    assert found["packages"].state == "broken"
    assert "numba missing" in found["packages"].found
    assert found["packages"].fix == "pip install slamgym"  # brings what the installed one needs
    assert found["films (ffmpeg)"][1:3] == ("missing", "no ffmpeg at all")
    assert cli.main(["doctor"]) == 1
    assert "         fix: pip install 'slamgym[ros]'\n" in capsys.readouterr().out


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


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_bash_completes_commands_verbs_and_options(script):
    assert complete(script, "gen") == ["generate"]
    assert {"render", "clean", "stats"} <= set(complete(script, "dataset", ""))
    assert complete(script, "plans", "fe") == ["fetch"]
    assert complete(script, "plans", "fetch", "--o") == ["--out"]
    assert "--plans-filter" in complete(script, "generate", "--pairs", "8", "--plans-")
    assert complete(script, "cad", "map.yaml", "--form") == ["--formats"]
