"""A small dataset, and a place for it among files that no command may touch."""

import shutil

import pytest
from commands.hostile import SMALL, OnePlan

from slamgym.agents.registry import make_explorer
from slamgym.dataset import Layout, build_dataset
from slamgym.dataset.format import Shard


@pytest.fixture(scope="session")
def explored(tmp_path_factory):
    root = tmp_path_factory.mktemp("explored")
    build_dataset(root / "dataset", OnePlan(), SMALL, make_explorer, pairs=2)
    build_dataset(root / "parts", OnePlan(), SMALL, make_explorer, pairs=2, shard=Shard(0, 2))
    return root


@pytest.fixture
def place(explored, tmp_path, monkeypatch):
    """A dataset, a folder for output, and beside them what no command may touch."""
    dataset = shutil.copytree(explored / "dataset", tmp_path / "dataset")
    name = next(Layout(dataset).episodes.iterdir()).name
    outside = tmp_path / "outside"
    # A whole exploration, so that a name that leads here would be read and its images written beside it.
    shutil.copytree(Layout(dataset).episode(name), outside / "x")
    (outside / "log").write_text("a line\nand half a")
    (tmp_path / "out").mkdir()
    monkeypatch.chdir(tmp_path / "out")
    return tmp_path
