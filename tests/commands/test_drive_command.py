"""Driving by keyboard: keys are posted to a window without a screen."""

import json

import numpy as np
import pytest
from shapely import box

from slamgym.cad import FloorPlan, write_houseexpo
from slamgym.commands import cli
from slamgym.dataset import Layout
from slamgym.viz.canvas import FRAME_HEIGHT, FRAME_WIDTH
from slamgym.viz.window import Window

pygame = pytest.importorskip("pygame")


@pytest.fixture
def drive(tmp_path, monkeypatch):
    """Drive with what is pressed before each picture: its number to the events; gives exit code and pictures."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    write_houseexpo(tmp_path / "flat.json", FloorPlan("flat", box(0, 0, 6.0, 1.0)))
    show = Window.show

    def run(events):
        shown = []

        def watched(window, picture):
            for kind, key in events.get(len(shown), ()):
                pygame.event.post(pygame.event.Event(kind, key=key))
            shown.append(picture)
            show(window, picture)

        monkeypatch.setattr(Window, "show", watched)
        options = [
            "--plans",
            str(tmp_path / "flat.json"),
            "--speed",
            "100",
            "--set",
            "slam.mode=ground_truth",
        ]
        return cli.main(["drive", *options, "-o", str(tmp_path / "driven")]), shown

    return run


def records(tmp_path):
    return [json.loads(line) for line in Layout(tmp_path / "driven").manifest.read_text().splitlines()]


def test_a_person_drives_sees_the_map_and_gets_pairs(drive, tmp_path, capsys):
    down, up = pygame.KEYDOWN, pygame.KEYUP
    there = {
        0: [(down, pygame.K_w)],
        10: [(up, pygame.K_w)],
        20: [(down, pygame.K_RETURN), (up, pygame.K_RETURN)],
    }
    code, shown = drive(there)
    assert code == 0
    assert len(shown) == 21
    assert {picture.shape for picture in shown} == {(FRAME_HEIGHT, FRAME_WIDTH, 3)}
    assert not np.array_equal(shown[0], shown[-1])
    (record,) = records(tmp_path)
    # Two seconds ahead at 0.26 m/s, unless the wall of the narrow flat ended it.
    assert 0.05 < record["path_length"] < 0.6
    assert record["explorer"] == "keyboard"
    assert "1 pair" in capsys.readouterr().out

    assert drive({0: [(down, pygame.K_LEFT)], 8: [(down, pygame.K_RETURN)]})[0] == 0
    first, second = records(tmp_path)
    assert first == record
    assert second["path_length"] < 0.02  # turning on the spot


def test_a_closed_window_keeps_nothing(drive, tmp_path, capsys):
    assert drive({3: [(pygame.QUIT, 0)]})[0] == 2
    assert "the window was closed before the end" in capsys.readouterr().err
    assert records(tmp_path) == []
