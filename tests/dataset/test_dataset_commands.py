"""`slamgym dataset stats` and `show`: figures that add up, and the pairs that were asked for."""

import dataclasses
import json

import cv2
import numpy as np
import pytest

from slamgym.commands import cli
from slamgym.dataset.folder import open_dataset
from slamgym.dataset.format import Layout, read_manifest
from slamgym.dataset.record import Slot
from slamgym.dataset.statistics import RecordColumns, ValueColumn, dataset_statistics


def test_the_whole_is_the_sum_of_its_groups(small_dataset):
    statistics = dataset_statistics(small_dataset)
    records = list(read_manifest(small_dataset))
    assert statistics.whole.pairs == len(records) == 8
    assert statistics.whole.plans == 4
    assert statistics.whole.robot_hours == pytest.approx(
        sum(r.robot_seconds for r in records) / 3600
    )
    assert statistics.whole.ate[0] == pytest.approx(np.median([r.ate for r in records]))
    assert statistics.whole.kept is None
    assert statistics.whole.cpu_seconds > 0
    assert sum(statistics.endings.values()) == 8
    assert set(statistics.by_condition) == {"odometry", "clutter.people"}
    for groups in statistics.by_condition.values():
        assert sum(group.pairs for group in groups.values()) == 8
        hours = sum(group.robot_hours for group in groups.values())
        assert hours == pytest.approx(statistics.whole.robot_hours)


def groups_of(*values):
    column = ValueColumn()
    for value in values:
        column.add(value)
    return {label: len(places) for label, places in column.groups().items()}


def test_words_few_numbers_and_what_is_missing_are_groups_of_their_own():
    assert groups_of("b", None, "a", 2, "b", 10) == {"2": 1, "10": 1, "a": 1, "b": 2, "not set": 1}
    assert groups_of(True, False, True) == {"False": 1, "True": 2}
    assert groups_of(5, 0.5, 5) == {"0.5": 1, "5": 2}
    assert groups_of("w", *range(8)) == {**{str(i): 1 for i in range(8)}, "w": 1}


def test_a_condition_that_comes_late_is_missing_before(small_dataset):
    record = next(iter(read_manifest(small_dataset)))
    columns = RecordColumns(
        dataclasses.replace(record, conditions=c) for c in ({}, {"x": 1}, {"x": 2})
    )
    assert {
        label: places.tolist() for label, places in columns.conditions["x"].groups().items()
    } == {"1": [1], "2": [2], "not set": [0]}


def test_lists_are_joined_by_name(small_dataset):
    records = list(read_manifest(small_dataset))
    columns = RecordColumns(records)
    joined = columns.joined([("stranger", 9.0), *((r.name, r.ate) for r in reversed(records[1:]))])
    assert np.isnan(joined[0])
    assert joined[1:].tolist() == [r.ate for r in records[1:]]
    assert np.isnan(columns.joined([])).all()


def test_many_numbers_are_reported_in_ranges():
    groups = groups_of(*[0.0] * 5, *np.linspace(0.2, 1.0, 9).tolist(), None)
    assert groups == {
        "0.0": 5,
        "0.2 to 0.4": 2,
        "0.4 to 0.6": 2,
        "0.6 to 0.8": 2,
        "0.8 to 1": 3,
        "not set": 1,
    }


def test_json_and_tables_say_what_was_rejected(dataset_copy, capsys):
    settings = json.loads(Layout(dataset_copy).config.read_text())
    with open_dataset(dataset_copy, settings) as folder:
        folder.reject(Slot(99, "tiny", 0, 1), "PlanError", "is too small")
    assert cli.main(["dataset", "stats", str(dataset_copy), "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["rejected"] == {"PlanError": 1}
    assert shown["whole"]["pairs"] == 8
    assert cli.main(["dataset", "stats", str(dataset_copy)]) == 0
    table = capsys.readouterr().out
    assert "plans without a pair: 1 PlanError" in table
    assert "odometry: high" in table


def show(folder, tmp_path, *options):
    return cli.main(
        ["dataset", "show", str(folder), *options, "--out", str(tmp_path / "sheet.png")]
    )


def names(text):
    return [line.split()[0] for line in text.splitlines() if "covered" in line]


def test_the_worst_pairs_come_first(small_dataset, tmp_path, capsys):
    records = list(read_manifest(small_dataset))
    assert show(small_dataset, tmp_path, "--sort", "ate", "--limit", "3") == 0
    worst = [r.name for r in sorted(records, key=lambda r: -r.ate)][:3]
    assert names(capsys.readouterr().out) == worst
    assert show(small_dataset, tmp_path, "--sort", "coverage", "--limit", "2") == 0
    least = [r.name for r in sorted(records, key=lambda r: r.coverage)][:2]
    assert names(capsys.readouterr().out) == least
    assert cv2.imread(str(tmp_path / "sheet.png")).shape[1] > 500


def test_pairs_are_picked_by_name_index_or_plan(small_dataset, tmp_path, capsys):
    records = list(read_manifest(small_dataset))
    assert show(small_dataset, tmp_path, records[5].name, "2", records[0].plan_id) == 0
    of_plan = [r.name for r in records if r.plan_id == records[0].plan_id]
    assert names(capsys.readouterr().out) == [records[5].name, records[2].name, *of_plan]
    assert show(small_dataset, tmp_path, "hal") == 2
    assert "there is no pair 'hal'" in capsys.readouterr().err


def test_rendered_images_are_shown_too(dataset_copy, tmp_path, capsys):
    images = tmp_path / "images"
    command = ["dataset", "render", str(dataset_copy), "--out", str(images), "--size", "64"]
    assert cli.main([*command, "--min-coverage", "0", "--workers", "1"]) == 0
    capsys.readouterr()
    assert show(images, tmp_path, "--limit", "4") == 0
    assert len(names(capsys.readouterr().out)) == 4
    assert cv2.imread(str(tmp_path / "sheet.png")) is not None
    assert show(images, tmp_path, "--sort", "area") == 2
    assert "rendered images don't know 'area'" in capsys.readouterr().err


@pytest.mark.parametrize(("options", "words"), [(["--limit", "0"], "--limit must be at least 1")])
def test_senseless_options_are_one_line(small_dataset, tmp_path, capsys, options, words):
    assert show(small_dataset, tmp_path, *options) == 2
    assert words in capsys.readouterr().err


def test_the_table_of_commands_is_shown_and_typos_get_a_hint(capsys):
    assert cli.main(["dataset"]) == 0
    shown = capsys.readouterr().out
    assert all(f"  {name} " in shown for name in cli.TABLE.commands["dataset"].commands)
    assert cli.main(["dataset", "rendr"]) == 2
    assert "did you mean 'render'" in capsys.readouterr().err


def test_a_folder_without_a_dataset_is_one_line(tmp_path, capsys):
    for command in ("stats", "show", "split", "check"):
        assert cli.main(["dataset", command, str(tmp_path)]) == 2
        error = capsys.readouterr().err
        assert "manifest.jsonl" in error
        assert error.count("\n") == 1
