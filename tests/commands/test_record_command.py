"""Explorations as Minari reads them."""

import numpy as np
import pytest
from shapely import box

from slamgym.cad import FloorPlan, write_houseexpo
from slamgym.commands import cli
from slamgym.core.errors import ConfigError

minari = pytest.importorskip("minari")
pytest.importorskip("stable_baselines3")


def test_explorations_become_a_minari_dataset(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "unused"))
    rooms = box(0, 0, 8, 4).difference(
        box(3.9, 0, 4.1, 2.8)
    )  # the other room is seen from the door on
    write_houseexpo(tmp_path / "rooms.json", FloorPlan("rooms", rooms))
    words = [
        "agents",
        "record",
        "--plans",
        str(tmp_path / "rooms.json"),
        "--minari",
        "homes/test-v0",
        "--out",
        str(tmp_path),
        "--episodes",
        "2",
    ]
    assert cli.main([*words, "--localization", "ground_truth", "--random-share", "0.3"]) == 0
    dataset = minari.load_dataset("homes/test-v0")
    assert dataset.total_episodes == 2
    assert f"2 episodes, {dataset.total_steps} steps" in capsys.readouterr().out
    episode = next(iter(dataset.iterate_episodes()))
    assert len(episode.rewards) == len(episode.actions) == len(episode.observations["mask"]) - 1
    offered = np.take_along_axis(
        episode.observations["mask"][:-1], episode.actions[:, None], axis=1
    )
    assert (offered > 0.5).all()
    assert dataset.spec.env_spec.id == "slamgym/ExploreFrontiers-v4"
    with pytest.raises(ConfigError, match=r"homes/test-v0.*choose another id"):
        cli.TABLE.run("slamgym", [*words[:-1], "1", "--localization", "ground_truth"])


@pytest.mark.parametrize("name", ["x", "../x-v0", "/tmp/x-v0", "homes/x-v", ""])
def test_an_id_that_is_none_is_refused_before_anything_is_recorded(name, tmp_path):
    with pytest.raises(ConfigError, match=r"is no id; give one such as homes/"):
        cli.TABLE.run(
            "slamgym", ["agents", "record", "--minari", name, "--out", str(tmp_path / "out")]
        )
    assert not (tmp_path / "out").exists()
