"""What a rerun recording holds, as rerun itself reads it."""

import collections

import pytest

from slamgym.commands import cli
from slamgym.core.errors import ConfigError
from slamgym.viz import recording


def test_the_name_and_the_package_are_asked_for_before_the_work(tmp_path, monkeypatch):
    with pytest.raises(ConfigError, match=r"run.rrrd: a recording's name must end in \.rrd"):
        recording.check_recording_name(tmp_path / "run.rrrd")
    monkeypatch.setattr(recording.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(
        ConfigError, match=r"needs rerun; install it with: pip install 'slamgym\[viz\]'"
    ):
        recording.check_recording_name(tmp_path / "run.rrd")


def test_a_recording_has_every_moment_and_what_changed(tmp_path, capsys):
    chunks = pytest.importorskip("rerun.chunk")
    path = tmp_path / "run.rrd"
    options = ["--minutes", "0.1", "--set", "particles=3", "--explorer", "tour", "--seed", "1"]
    assert cli.main(["watch", *options, "--rerun", str(path)]) == 0
    assert capsys.readouterr().out == f"{path}\n"
    rows = collections.Counter()
    for chunk in chunks.RrdReader(path).stream().to_chunks():
        rows[chunk.entity_path] += chunk.num_rows
    # 6 s of robot time are 31 states.
    assert rows["/world/robot"] == rows["/belief/scan"] == rows["/figures/coverage"] == 31
    assert rows["/world/plan"] == 1
    assert 1 < rows["/belief/map"] <= rows["/belief/particles"] < 31
    assert rows["/belief/frontiers"] >= 1
    assert [file.name for file in tmp_path.iterdir()] == ["run.rrd"]
