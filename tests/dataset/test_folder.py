"""The folder's promises, with pairs made by hand: whole or absent, whatever happens."""

import json

import pytest

from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import StorageError
from slamgym.dataset.folder import open_dataset
from slamgym.dataset.format import Layout
from slamgym.dataset.record import Slot

SETTINGS = {"seed": 1, "episode": {"minutes": "auto", "particles": 30}}


def slot(index):
    return Slot(index, f"plan{index}", 0, 100 + index)


def stage(folder, index):
    staged = folder.stage(slot(index).name)
    (staged / "episode").mkdir(parents=True)
    (staged / "episode" / "episode.json").write_text(
        json.dumps({"name": slot(index).name, "index": index}) + "\n"
    )
    for side in "AB":
        (staged / f"{side}.png").write_bytes(side.encode())
    return staged


def names(root):
    """All files, as a reader sees them."""
    return {str(p.relative_to(root)) for p in root.rglob("*") if p.is_file() and p.name != ".lock"}


def test_a_committed_pair_is_there_and_nothing_else(tmp_path):
    with open_dataset(tmp_path, SETTINGS) as folder:
        folder.commit(slot(4), stage(folder, 4), {"cpu_seconds": 1.0})
        folder.commit(slot(2), stage(folder, 2), {"cpu_seconds": 2.0})
        stage(folder, 7)  # never committed
    assert names(tmp_path) == {
        "config.json",
        "manifest.jsonl",
        "timing.jsonl",
        *(f"{side}/{slot(i).name}.png" for side in "AB" for i in (2, 4)),
        *(f"episodes/{slot(i).name}/episode.json" for i in (2, 4)),
    }
    manifest = Layout(tmp_path).manifest.read_text().splitlines()
    assert [json.loads(line)["index"] for line in manifest] == [2, 4]


def test_a_new_run_knows_what_is_done(tmp_path):
    with open_dataset(tmp_path, SETTINGS) as folder:
        folder.commit(slot(0), stage(folder, 0), {})
        folder.reject(slot(1), "PlanError", "is a single point")
    with open_dataset(tmp_path, SETTINGS) as folder:
        assert list(folder.committed) == [0]
        assert folder.rejected[1]["reason"] == "is a single point"


def test_leftovers_of_a_killed_run_are_removed_and_unexpected_files_are_kept(tmp_path):
    layout = Layout(tmp_path)
    with open_dataset(tmp_path, SETTINGS) as folder:
        folder.commit(slot(0), stage(folder, 0), {"cpu_seconds": 1.0})
        folder.commit(slot(1), stage(folder, 1), {"cpu_seconds": 1.0})
    layout.image("A", slot(5).name).write_bytes(b"a run died between the images and the episode")
    (tmp_path / "A" / "my notes.png").write_bytes(b"the user's")
    (layout.episodes / "favourites").mkdir()
    layout.image("B", slot(1).name).unlink()
    (layout.incoming / "old" / slot(6).name).mkdir(parents=True)
    with layout.timing.open("a") as file:
        file.write('{"name": "torn')
    with open_dataset(tmp_path, SETTINGS) as folder:
        assert list(folder.committed) == [0]
    assert not layout.incoming.exists()
    assert {p.name for p in (tmp_path / "A").iterdir()} == {f"{slot(0).name}.png", "my notes.png"}
    assert {p.name for p in layout.episodes.iterdir()} == {slot(0).name, "favourites"}
    assert [json.loads(line)["name"] for line in layout.timing.read_text().splitlines()] == [
        slot(0).name,
        slot(1).name,
    ]


def test_a_worker_that_outlives_its_run_can_not_write_any_more(tmp_path):
    with open_dataset(tmp_path, SETTINGS) as folder:
        old = folder.stage(slot(0).name)
    with open_dataset(tmp_path, SETTINGS), pytest.raises(FileNotFoundError):
        old.mkdir()


def test_other_settings_are_refused_by_name(tmp_path):
    with open_dataset(tmp_path, SETTINGS):
        pass
    other = {"seed": 1, "episode": {"minutes": 7, "particles": 30}}
    with (
        pytest.raises(ConfigError, match=r"episode\.minutes was 'auto', now 7") as caught,
        open_dataset(tmp_path, other),
    ):
        pass
    assert "particles" not in str(caught.value)


def test_a_folder_with_other_things_is_refused(tmp_path):
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(ConfigError, match=r"thesis\.tex"), open_dataset(tmp_path, SETTINGS):
        pass


def test_settings_that_can_not_be_read_are_named(tmp_path):
    with open_dataset(tmp_path, SETTINGS):
        pass
    Layout(tmp_path).config.write_bytes(b"\xff{")
    with (
        pytest.raises(InputFileError, match=r"config\.json: is not valid JSON"),
        open_dataset(tmp_path, SETTINGS),
    ):
        pass


def test_a_file_in_place_of_the_folder_is_refused(tmp_path):
    path = tmp_path / "out"
    path.touch()
    with pytest.raises(StorageError, match="not a folder"), open_dataset(path, SETTINGS):
        pass


def test_two_runs_in_one_folder_are_refused(tmp_path):
    with (
        open_dataset(tmp_path, SETTINGS),
        pytest.raises(StorageError, match="another run"),
        open_dataset(tmp_path, SETTINGS),
    ):
        pass


def test_a_malformed_list_of_rejected_plans_is_named(tmp_path):
    with open_dataset(tmp_path, SETTINGS):
        pass
    Layout(tmp_path).rejected.write_text("no json\n")
    with pytest.raises(InputFileError, match=r"rejected\.jsonl"), open_dataset(tmp_path, SETTINGS):
        pass
