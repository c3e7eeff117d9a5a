"""`slamgym dataset clean --set by=trees`: the paper's classifier, on pairs that are drawn here."""

import builtins
import dataclasses
import sys

import numpy as np
import pytest

from slamgym.commands import cli
from slamgym.core.errors import ConfigError
from slamgym.core.types import GridFrame, OccupancyGrid
from slamgym.dataset.curate.cleaning import CleanConfig, clean_maps
from slamgym.dataset.curate.completeness_trees import unseen_probabilities
from slamgym.dataset.curate.map_items import MapItem
from slamgym.dataset.curate.verdicts import read_verdicts
from slamgym.dataset.record import PairRecord
from slamgym.interop import write_ros_map

RECORD = PairRecord(
    name="", index=0, plan_id="", plan_source="", repetition=0, seed=0, config_hash="", version="", explorer="nearest",
    conditions={}, finished="explored", coverage=0.0, robot_seconds=1.0, time_limit=420.0, path_length=9.0,
    collisions=0, ate=0.0, odometry_ate=0.0, final_position_error=0.0, map_error=0.0, mse=0.0, area=9.0, rooms=1,
    resolution=0.05, origin=(0.0, 0.0), shape=(1, 1), start=(0.0, 0.0, 0.0), sha256={},
)  # fmt: skip


def item(number, share):
    """A room of a plan of its own, of which the robot saw a share from the left."""
    rng = np.random.default_rng(number)
    rows, columns = rng.integers(60, 120, 2)
    cells = np.full((rows + 40, columns + 40), 205, np.uint8)
    cells[19:-19, 19:-19] = 0
    cells[20:-20, 20:-20] = 254
    cells[:, 20 + round(columns * share) :][:, : None if share < 1.0 else 0] = 205
    grid = OccupancyGrid(cells, GridFrame(0.05, 0.0, 0.0, *cells.shape))
    name = f"{number:06d}_room"
    record = dataclasses.replace(RECORD, name=name, plan_id=f"room {number}", coverage=share)
    return MapItem(name, lambda: grid, None, record, "")


def pairs(count=24, lowest=0.5):
    return [item(number, 1.0 if number % 2 else lowest) for number in range(count)]


def trees(root, items, **settings):
    pytest.importorskip("sklearn")
    return clean_maps(root, items, CleanConfig(by="trees", **settings), {})


def test_whole_rooms_are_kept_and_halves_are_dropped(tmp_path):
    report = trees(tmp_path, pairs())
    assert [verdict.probability >= 0.5 for verdict in report.verdicts] == [False, True] * 12
    assert not any(verdict.keep for verdict in report.verdicts[::2])
    assert {verdict.by for verdict in report.verdicts} == {"trees"}
    assert report.agreement.accuracy == 1.0
    assert "extra trees" in (tmp_path / "clean.json").read_text()


def test_the_band_waits_for_a_person(tmp_path):
    # Halves that pass for whole ones and the other way round: their features say nothing.
    items = pairs()
    rng = np.random.default_rng(0)
    coverages = rng.permutation([0.5, 1.0] * 12)
    mixed = [
        dataclasses.replace(one, record=dataclasses.replace(one.record, coverage=float(coverage)))
        for one, coverage in zip(items, coverages, strict=True)
    ]
    report = trees(tmp_path, mixed)
    for verdict in report.verdicts:
        assert verdict.keep == (verdict.probability >= 0.8)
        assert verdict.is_doubtful == (0.4 <= verdict.probability < 0.8)
    assert report.undecided > 0
    assert any(verdict.reason.startswith("doubtful: ") for verdict in report.verdicts)


def test_the_seed_decides(tmp_path):
    first, again, other = (
        [verdict.probability for verdict in trees(tmp_path, pairs(), seed=seed).verdicts]
        for seed in (1, 1, 2)
    )
    assert first == again
    assert first != other


def test_no_tree_has_seen_a_map_of_the_plan_that_it_judges():
    # Each plan has its own number and kind: known to the trees they would be right about all, unknown about none.
    pytest.importorskip("sklearn")
    plan = np.repeat(np.arange(8), 5)
    features = np.repeat(plan[:, None], 15, axis=1).astype(np.float64)
    complete = plan % 2 == 0
    said = unseen_probabilities(features, complete.tolist(), [f"{number}" for number in plan], 0)
    assert ((said >= 0.5) == complete).mean() < 0.5


def test_a_map_without_truth_is_judged_but_not_learnt_from():
    pytest.importorskip("sklearn")
    kind = np.arange(30) % 2
    features = np.repeat(kind[:, None], 15, axis=1).astype(np.float64)
    truth = [bool(value) for value in kind[:28]] + [None, None]
    said = unseen_probabilities(features, truth, [str(number) for number in range(30)], 0)
    assert said[28] < 0.1 < 0.9 < said[29]


@pytest.mark.parametrize(
    ("items", "words"),
    [
        (pairs(19), "19 are too few, it takes 20"),
        (pairs(lowest=0.97), "all are complete"),
        ([item(number, 0.5) for number in range(20)], "all are incomplete"),
        (
            [
                dataclasses.replace(one, record=dataclasses.replace(one.record, plan_id="a"))
                for one in pairs()
            ],
            "all are of one plan",
        ),
    ],
)
def test_too_little_to_learn_from_is_one_sentence_and_writes_nothing(tmp_path, items, words):
    with pytest.raises(ConfigError, match=words):
        trees(tmp_path, items)
    assert not list(tmp_path.iterdir())


def test_without_scikit_learn_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "sklearn.ensemble", None)
    monkeypatch.delitem(sys.modules, "sklearn", raising=False)
    real = builtins.__import__

    def refuse(name, *rest):
        if name.startswith("sklearn"):
            raise ModuleNotFoundError("no", name="sklearn")
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(
        ConfigError, match=r"by=trees needs the package 'sklearn'.*slamgym\[clean\]"
    ):
        clean_maps(tmp_path, pairs(), CleanConfig(by="trees"), {})


@pytest.mark.parametrize(
    ("more", "words"), [((), "0 are too few"), (("--model", "m.json"), "leave out --model")]
)
def test_the_command_refuses_in_one_sentence(tmp_path, capsys, more, words):
    write_ros_map(tmp_path / "room", item(0, 1.0).load())
    assert cli.main(["dataset", "clean", str(tmp_path), "--set", "by=trees", *more]) == 2
    (line,) = capsys.readouterr().err.splitlines()[-1:]
    assert words in line
    assert line.startswith("slamgym: error: ")
    assert cli.main(["dataset", "clean", str(tmp_path)]) == 0  # as it was
    assert read_verdicts(tmp_path)["room"].by == "classifier"
