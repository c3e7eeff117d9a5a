"""The word about compiling."""

from pathlib import Path

import pytest

from slamgym.commands import warmup


@pytest.fixture
def fresh() -> None:
    warmup.announce_compilation.cache_clear()


def test_an_installation_without_compiled_kernels_says_so_once(
    fresh: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(warmup, "kernel_cache", lambda: tmp_path)
    warmup.announce_compilation()
    warmup.announce_compilation()
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert "compiling the numeric kernels, once" in message


def test_compiled_kernels_need_no_word(
    fresh: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "raycast.cast_rays-1.py311.nbi").touch()
    monkeypatch.setattr(warmup, "kernel_cache", lambda: tmp_path)
    warmup.announce_compilation()
    assert capsys.readouterr().err == ""


def test_warming_up_compiles_and_leaves_a_cache() -> None:
    warmup.warm_up()
    assert warmup.kernels_are_compiled()
