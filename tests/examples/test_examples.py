"""The tutorials run from first to last, at a small size; ``tests/agents/test_wheels.py`` runs ``ppo_wheels.py``,
``tests/agents/test_bench.py`` ``own_explorer.py``."""

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


def run(name, folder, *arguments):
    """What an example prints when it is run in a folder."""
    done = subprocess.run(
        [sys.executable, "-W", "error::DeprecationWarning:__main__", str(EXAMPLES / name), *arguments],
        cwd=folder, capture_output=True, text=True, timeout=900, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_example_is_run_here():
    assert {path.name for path in EXAMPLES.glob("*.py")} == {
        "own_reward.py",
        "maps_to_cad.py",
        "log_to_drawing.py",
        "ppo_wheels.py",
        "own_explorer.py",
        "two_robots.py",
    }


def test_a_reward_of_ones_own(tmp_path):
    pytest.importorskip("stable_baselines3")
    printed = run("own_reward.py", tmp_path, "256", "2")
    for name in ("random walk", "before", "after"):
        assert f"{name}: " in printed
    assert "points more than the random walk after 256 decisions" in printed


def test_two_robots_explore_together(tmp_path):
    pytest.importorskip("pettingzoo")
    printed = run("two_robots.py", tmp_path, "home_000001", "0.2", "film.gif")
    assert "seen after 12 s; the robots drove" in printed
    assert (tmp_path / "two_robots" / "map.yaml").is_file()
    assert (tmp_path / "film.gif").is_file()


def test_maps_to_a_translator(tmp_path):
    pytest.importorskip("torch")
    printed = run("maps_to_cad.py", tmp_path, "5", "0.01")
    assert printed.count("mean squared error 0.") == 4
    assert (tmp_path / "maps_to_cad" / "run" / "weights.safetensors").is_file()


def test_a_log_becomes_a_drawing(tmp_path):
    printed = run("log_to_drawing.py", tmp_path)
    assert "walls" in printed
    for name in ("map/map.yaml", "home.dxf", "home.svg", "home.png", "trajectory.tum"):
        assert (tmp_path / "log_to_drawing" / name).is_file()
