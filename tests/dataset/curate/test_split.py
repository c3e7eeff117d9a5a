"""Splits go by plan, keep what looks alike together, and stay as they are when a dataset grows."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slamgym.commands import cli
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.dataset.curate.split import (
    assign_sides,
    current_split,
    make_split,
    read_split,
    split_path,
)
from slamgym.dataset.format import Layout, read_manifest


def alone(count):
    return {f"p{i}": f"p{i}" for i in range(count)}


@given(st.integers(2, 60), st.floats(0.05, 0.95), st.integers(0, 99))
def test_both_sides_have_plans(count, test, seed):
    table = assign_sides(alone(count), test=test, seed=seed)
    assert table.of_side("train")
    assert table.of_side("test")


def test_the_share_is_kept():
    table = assign_sides(alone(5000), test=0.1, seed=3)
    # Binomial: four standard deviations of n = 5000, p = 0.1 are 0.017.
    assert len(table.of_side("test")) / 5000 == pytest.approx(0.1, abs=0.017)
    other = assign_sides(alone(5000), test=0.1, seed=4)
    assert set(table.of_side("test")) != set(other.of_side("test"))


@given(st.dictionaries(st.integers(0, 40), st.integers(0, 9), min_size=1), st.integers(0, 9))
def test_a_group_is_on_one_side(members, seed):
    first = {}
    groups = {f"p{plan}": f"p{first.setdefault(group, plan)}" for plan, group in members.items()}
    table = assign_sides(groups, test=0.5, seed=seed)
    sides = {}
    for place in table.plans.values():
        assert sides.setdefault(place.group, place.side) == place.side


def test_more_plans_leave_sides_as_they_were():
    few = assign_sides(alone(100), test=0.2, seed=1)
    many = assign_sides(alone(300), test=0.2, seed=1)
    assert all(many.plans[plan_id].side == place.side for plan_id, place in few.plans.items())


def test_forced_plans_take_their_group_along():
    groups = {**alone(30), "twin": "p7"}
    table = assign_sides(groups, test=0.1, seed=0, forced=["twin", "p3"])
    assert all(table.plans[plan_id].side == "test" for plan_id in ("twin", "p7", "p3"))
    nothing = assign_sides(groups, test=0.0, seed=0, forced=["p3"])
    assert nothing.of_side("test") == ["p3"]


def test_a_dataset_is_split_by_plan_with_mirror_images_together(dataset_copy):
    table = make_split(dataset_copy, test=0.4, seed=1)
    assert table == read_split(dataset_copy)
    plans = {record.plan_id for record in read_manifest(dataset_copy)}
    assert table.plans.keys() == plans == {"rooms", "corner", "mirrored", "hall"}
    assert table.plans["rooms"].group == table.plans["mirrored"].group
    assert table.groups == 3
    before = split_path(dataset_copy).read_bytes()
    make_split(dataset_copy, test=0.4, seed=1)
    assert split_path(dataset_copy).read_bytes() == before


def test_plans_of_another_size_are_on_one_side(dataset_copy):
    """The hall is made a small copy of the rooms, and so looks like them in images that are scaled to fit."""
    first = {record.plan_id: record.name for record in reversed(list(read_manifest(dataset_copy)))}
    plan = json.loads((Layout(dataset_copy).episode(first["rooms"]) / "plan.json").read_text())
    plan["verts"] = (0.8 * np.array(plan["verts"])).tolist()
    (Layout(dataset_copy).episode(first["hall"]) / "plan.json").write_text(json.dumps(plan))
    table = make_split(dataset_copy, seed=1)
    assert table.plans["rooms"] == table.plans["hall"]
    assert read_split(dataset_copy) == current_split(dataset_copy) == table


def test_a_split_of_another_version_is_refused(dataset_copy):
    make_split(dataset_copy, seed=1)
    written = json.loads(split_path(dataset_copy).read_text())
    split_path(dataset_copy).write_text(json.dumps(written | {"split_version": 1}))
    with pytest.raises(InputFileError, match="of another version"):
        read_split(dataset_copy)


def test_the_command_says_what_it_did(dataset_copy, tmp_path, capsys):
    (tmp_path / "ids.txt").write_text("hall\n")
    command = ["dataset", "split", str(dataset_copy), "--test-plans", str(tmp_path / "ids.txt")]
    assert cli.main(command) == 0
    assert "(1 of them a look-alike of another)" in capsys.readouterr().out
    assert read_split(dataset_copy).plans["hall"].side == "test"
    (tmp_path / "ids.txt").write_text("hal\n")
    assert cli.main(command) == 2
    assert "did you mean 'hall'" in capsys.readouterr().err


def test_without_pairs_there_is_nothing_to_split(dataset_copy):
    Layout(dataset_copy).manifest.write_text("")
    with pytest.raises(ConfigError, match="holds no pairs yet"):
        make_split(dataset_copy)


def test_wrong_shares_and_broken_files_are_named(dataset_copy):
    with pytest.raises(ConfigError, match="share of test plans"):
        make_split(dataset_copy, test=1.5)
    with pytest.raises(InputFileError, match=r"split\.json"):
        read_split(dataset_copy)
    for text in (
        "{",
        "[]",
        json.dumps({"seed": 1}),
        json.dumps({"seed": 1, "test": 0.1, "plans": {"a": {}}}),
        json.dumps({"seed": 1, "test": 0.1, "plans": {}, "split_version": 1}),
    ):
        split_path(dataset_copy).write_text(text)
        with pytest.raises(InputFileError, match=r"split\.json"):
            read_split(dataset_copy)
