"""Shards: together they are the dataset that one run makes."""

import dataclasses
import json
import shutil

import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import box

from slamgym.agents.registry import make_explorer
from slamgym.cad import FloorPlan
from slamgym.commands import cli
from slamgym.core.errors import ConfigError, PlanError
from slamgym.core.files import StorageError, exclusive_lock
from slamgym.core.parallel.engine import Execution
from slamgym.dataset import DatasetConfig, Layout, build_dataset, read_manifest
from slamgym.dataset.check import check_dataset
from slamgym.dataset.format import WHOLE, Shard, shard_folders
from slamgym.dataset.merge import merge_shards
from slamgym.envs import EpisodeConfig, ExploreConfig
from slamgym.slam import SlamConfig

PAIRS = 9
COUNT = 3
QUICK = DatasetConfig(
    seed=2, episode=EpisodeConfig(minutes=0.05, env=ExploreConfig(slam=SlamConfig(particles=2)))
)


class Plans:
    """Four rooms, a file that can't be read and, on demand, a plan too narrow for the robot."""

    def __init__(self, narrow=False):
        self.plans = {
            f"room{i}": FloorPlan(f"room{i}", box(0, 0, 2.0 + 0.2 * i, 2.0)) for i in range(4)
        }
        self.plans["broken"] = PlanError("broken.json", "is empty")
        if narrow:
            self.plans["tiny"] = FloorPlan("tiny", box(0, 0, 0.2, 0.2))
        self.ids = list(self.plans)

    def __len__(self):
        return len(self.ids)

    def load(self, plan_id):
        plan = self.plans[plan_id]
        if isinstance(plan, Exception):
            raise plan
        return plan


def build(root, shard=WHOLE, narrow=False):
    plans = Plans(narrow)
    execution = Execution(engine="in_process")
    return build_dataset(
        root, plans, QUICK, make_explorer, pairs=PAIRS, execution=execution, shard=shard
    )


def content(root):
    """Every file of a dataset but those that hold times, without its shards."""
    return {
        str(path.relative_to(root)): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file()
        and path.name not in ("timing.jsonl", ".lock")
        and not path.relative_to(root).parts[0].startswith("shard-")
    }


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    root = tmp_path_factory.mktemp("whole")
    build(root)
    return root


@pytest.fixture(scope="module")
def sharded(tmp_path_factory):
    root = tmp_path_factory.mktemp("sharded")
    for number in (2, 0, 1):
        build(root, Shard(number, COUNT))
    return root


@pytest.fixture
def shards(sharded, tmp_path):
    """A copy, to be merged."""
    root = tmp_path / "copy"
    shutil.copytree(sharded, root)
    return root


def test_merged_shards_are_the_dataset_of_one_run(whole, shards):
    report = merge_shards(shards)
    assert (report.shards, report.missing, report.pairs, report.fresh) == (COUNT, [], PAIRS, PAIRS)
    assert content(shards) == content(whole)
    # Its times came along, and another run finds nothing to do.
    assert len(Layout(shards).timing.read_text().splitlines()) == PAIRS
    assert build(shards).fresh == 0
    assert content(shards) == content(whole)


def test_each_shard_is_a_dataset_of_its_own_slots(sharded):
    names = [path.name for path in shard_folders(sharded)]
    assert names == ["shard-00000-of-00003", "shard-00001-of-00003", "shard-00002-of-00003"]
    for number, folder in enumerate(shard_folders(sharded)):
        records = list(read_manifest(folder))
        assert records
        assert {record.index % COUNT for record in records} == {number}


def test_a_shard_that_is_made_again_changes_nothing(sharded):
    before = content(sharded / "shard-00001-of-00003")
    assert build(sharded, Shard(1, COUNT)).fresh == 0
    assert content(sharded / "shard-00001-of-00003") == before


def test_a_merge_goes_on_when_a_shard_is_added(whole, shards, tmp_path):
    late = shards / "shard-00001-of-00003"
    late.rename(tmp_path / "late")
    first = merge_shards(shards)
    assert first.missing == ["1/3"]
    (tmp_path / "late").rename(late)
    second = merge_shards(shards)
    assert (second.missing, second.pairs) == ([], PAIRS)
    assert first.fresh + second.fresh == PAIRS
    assert content(shards) == content(whole)
    assert merge_shards(shards).fresh == 0


def test_shards_can_be_removed_after_the_merge(whole, shards):
    merge_shards(shards)
    for folder in shard_folders(shards):
        shutil.rmtree(folder)
    assert content(shards) == content(whole)
    assert all(path.stat().st_nlink == 1 for path in (shards / "A").iterdir())


def test_without_links_the_files_are_copied(whole, shards, monkeypatch):
    def refuse(*_):
        raise OSError("no links here")

    monkeypatch.setattr("slamgym.dataset.merge.os.link", refuse)
    merge_shards(shards)
    assert content(shards) == content(whole)


def test_what_a_failed_exploration_leaves_open_a_run_without_shards_adds(tmp_path, monkeypatch):
    from slamgym.dataset.generate import exploration as module

    def explore(plan, seed, *args):
        if plan.id == "room1":
            raise ZeroDivisionError("division by zero")
        return original(plan, seed, *args)

    original = module.run_episode
    monkeypatch.setattr(module, "run_episode", explore)
    build(tmp_path / "whole", narrow=True)
    for number in range(COUNT):
        build(tmp_path / "shards", Shard(number, COUNT), narrow=True)
        # What failed is remembered.
        assert build(tmp_path / "shards", Shard(number, COUNT), narrow=True).fresh == 0
    merged = merge_shards(tmp_path / "shards").pairs
    assert merged < PAIRS
    assert build(tmp_path / "shards", narrow=True).fresh == PAIRS - merged
    assert content(tmp_path / "shards") == content(tmp_path / "whole")


def test_a_pair_that_is_not_whole_is_left_out_and_named(shards, capsys):
    record = next(read_manifest(shards / "shard-00000-of-00003"))
    Layout(shards / "shard-00000-of-00003").image("B", record.name).unlink()
    assert cli.main(["dataset", "merge", str(shards)]) == 0
    assert (
        f"Left out: 1 pair without one of its files, such as {record.name}"
        in capsys.readouterr().out
    )
    assert len(list(read_manifest(shards))) == PAIRS - 1
    # A run of the shard makes it again.
    assert build(shards, Shard(0, COUNT)).fresh == 1
    assert merge_shards(shards).pairs == PAIRS


def test_a_shard_that_was_killed_at_once_is_not_there(whole, shards):
    empty = shards / "shard-00003-of-00004"
    empty.mkdir()
    Layout(empty).lock.touch()
    report = merge_shards(shards)
    assert (report.shards, report.pairs, report.broken) == (COUNT, PAIRS, [])
    Layout(empty).config.write_bytes(Layout(shards).config.read_bytes())  # killed a moment later
    assert merge_shards(shards).shards == COUNT + 1
    assert content(shards) == content(whole)


def test_checking_looks_at_shards_only_for_what_is_not_merged(shards):
    assert check_dataset(shards / "shard-00001-of-00003") == []
    late = next(read_manifest(shards / "shard-00001-of-00003")).name
    hidden = Layout(shards / "shard-00001-of-00003").image("A", late)
    picture = hidden.read_bytes()
    hidden.unlink()
    merge_shards(shards)
    assert check_dataset(shards) == []
    hidden.write_bytes(picture)
    (fault,) = check_dataset(shards)
    assert fault.path.name == "shard-00001-of-00003"
    assert (
        f"has 1 pair beyond the dataset's, such as {late}; run `slamgym dataset merge" in fault.what
    )
    merge_shards(shards)
    assert check_dataset(shards) == []
    # The files of both are the same, so damage to a shard is damage to the dataset.
    hidden.write_bytes(b"")
    assert {fault.path.name for fault in check_dataset(shards)} == {f"{late}.png"}


@pytest.mark.parametrize("command", ["check", "stats", "show", "clean", "split"])
def test_shards_that_are_not_merged_are_no_dataset_and_no_maps_from_elsewhere(
    sharded, capsys, command
):
    assert cli.main(["dataset", command, str(sharded)]) == 2
    error = capsys.readouterr().err
    assert f"holds shards that are not merged yet; run `slamgym dataset merge {sharded}`" in error
    assert error.count("\n") == 1


def test_shards_with_other_settings_are_refused(shards):
    config = shards / "shard-00002-of-00003" / "config.json"
    settings = json.loads(config.read_text())
    config.write_text(json.dumps({**settings, "seed": 3}))
    with pytest.raises(ConfigError, match=r"shard-00002-of-00003.*seed was 2, now 3"):
        merge_shards(shards)


def test_a_shard_at_work_is_not_merged(shards):
    lock = Layout(shards / "shard-00001-of-00003").lock
    with exclusive_lock(lock), pytest.raises(StorageError, match="another run"):
        merge_shards(shards)


def test_a_folder_without_shards_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="holds no shard"):
        merge_shards(tmp_path)


def test_the_command_names_what_is_missing(shards, capsys):
    shutil.rmtree(shards / "shard-00000-of-00003")
    assert cli.main(["dataset", "merge", str(shards)]) == 0
    shown = capsys.readouterr().out
    assert "Not there: 0/3." in shown
    assert "of 2 shards" in shown


@given(count=st.integers(1, 50), pairs=st.integers(0, 500))
def test_every_slot_has_one_shard(count, pairs):
    shards = [Shard(number, count) for number in range(count)]
    assert all(sum(shard.owns(index) for shard in shards) == 1 for index in range(pairs))
    assert sum(shard.share_of(pairs) for shard in shards) == pairs
    assert all(
        shard.share_of(pairs) == sum(shard.owns(index) for index in range(pairs))
        for shard in shards
    )


@pytest.mark.parametrize("text", ["", "3", "3/", "1.5/2", "-1/2", "2/2", "0/0", "a/b"])
def test_a_senseless_shard_is_refused(text):
    with pytest.raises(ConfigError, match="--shard"):
        Shard.parse(text)


def test_a_shard_is_read(tmp_path):
    assert Shard.parse("3/10") == Shard(3, 10)
    assert dataclasses.replace(Shard(3, 10), number=4).folder_name == "shard-00004-of-00010"
