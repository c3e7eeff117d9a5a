"""A person drives by keys; here they are fed to a window without a screen."""

import re

import pytest
from shapely import box

from slamgym.cad import FloorPlan, write_houseexpo
from slamgym.commands import cli
from slamgym.commands.drive import command_of
from slamgym.interop import read_ros_map
from slamgym.viz.window import Window

pygame = pytest.importorskip("pygame")


@pytest.fixture
def drive(tmp_path, monkeypatch):
    """Drive a room of 8 m by 3 m: a key and whether it goes down or up, by the picture before which it does."""
    path = tmp_path / "hall.json"
    write_houseexpo(path, FloorPlan("hall", box(0, 0, 8.0, 3.0)))
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.chdir(tmp_path)

    def run(keys, *more):
        pictures = []

        def feed(self, picture, show=Window.show):
            for event in keys.get(len(pictures), []):
                pygame.event.post(pygame.event.Event(*event))
            pictures.append(picture)
            show(self, picture)

        with monkeypatch.context() as patch:
            patch.setattr(Window, "show", feed)
            words = ["drive", "--plans", str(path), "--speed", "100", "--set", "particles=3"]
            return cli.main([*words, *more]), len(pictures)

    return run


def down(key):
    return pygame.KEYDOWN, {"key": key}


def up(key):
    return pygame.KEYUP, {"key": key}


def metres(words):
    return float(re.search(r"([\d.]+) m,", words).group(1))


def test_the_robot_goes_while_a_key_is_held_and_the_map_is_written(drive, tmp_path, capsys):
    keys = {0: [down(pygame.K_UP)], 25: [up(pygame.K_UP)], 40: [down(pygame.K_q)]}
    assert drive(keys, "-o", "house", "--seed", "3") == (0, 41)
    shown = capsys.readouterr()
    assert shown.out == "house.yaml\n"
    # 25 steps of 0.2 s at 0.26 m/s, less what it takes to start; a wall may end it.
    assert 0.4 < metres(shown.err) <= 1.4
    assert (read_ros_map(tmp_path / "house.yaml").cells == 254).sum() > 1000


def test_without_keys_it_stands_and_a_closed_window_ends_the_drive(drive, capsys):
    assert drive({6: [(pygame.QUIT, {})]}) == (0, 7)
    shown = capsys.readouterr()
    assert " 0 m," in shown.err
    assert not shown.out


def test_keys_add_up_and_opposite_ones_cancel():
    assert command_of(["up", "left"]) == [1.0, 0.4]
    assert command_of(["w", "up", "d"]) == [1.0, -0.4]
    assert command_of(["up", "down", "x"]) == [0.0, 0.0]
    assert command_of([]) == [0.0, 0.0]


@pytest.mark.parametrize(
    ("more", "words"),
    [(["--plan", "hal"], "did you mean 'hall'"), (["--speed", "0"], "--speed must be in (0, 100]")],
)
def test_mistakes_are_one_line(drive, capsys, more, words):
    assert drive({}, *more)[0] == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "advice"),
    [
        (
            ["drive"],
            "drive where there is one, or let slamgym watch --out FILE.mp4 film an explorer",
        ),
        (["watch", "--explorer", "nearest"], "write a film: --out FILE.mp4"),
    ],
)
def test_without_a_screen_a_window_is_refused_with_what_to_do(monkeypatch, capsys, words, advice):
    monkeypatch.delenv("SDL_VIDEODRIVER", raising=False)
    monkeypatch.setattr("pygame.display.init", lambda: None)
    monkeypatch.setattr("pygame.display.get_driver", lambda: "offscreen")
    assert cli.main(words) == 2
    error = capsys.readouterr().err
    assert f"no screen was found; {advice}" in error.splitlines()[-1]
