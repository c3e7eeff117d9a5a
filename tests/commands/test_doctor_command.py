"""What the doctor finds, and completion as the shell itself does it."""

import shutil
import subprocess

import pytest

from slamgym.commands import cli, doctor
from slamgym.commands.completion import completion_script
from slamgym.commands.doctor import findings


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


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_bash_completes_commands_verbs_and_options(script):
    assert complete(script, "gen") == ["generate"]
    assert {"render", "clean", "stats"} <= set(complete(script, "dataset", ""))
    assert complete(script, "plans", "fe") == ["fetch"]
    assert complete(script, "plans", "fetch", "--u") == ["--url"]
    assert "--plans-filter" in complete(script, "generate", "--pairs", "8", "--plans-")
    assert complete(script, "cad", "map.yaml", "--form") == ["--formats"]
