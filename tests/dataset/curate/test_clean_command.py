"""`slamgym dataset clean` as a user runs it."""

import json
import shutil

import numpy as np
import pytest
from shapely import box

from slamgym.agents.registry import make_explorer
from slamgym.cad import FloorPlan
from slamgym.commands import cli
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.parallel.engine import Execution
from slamgym.core.types import GridFrame, OccupancyGrid
from slamgym.dataset import DatasetConfig, Layout, build_dataset, read_manifest
from slamgym.dataset.curate import cleaning
from slamgym.dataset.curate.cleaning import CleanConfig, CleanReport, clean_maps
from slamgym.dataset.curate.completeness_model import CompletenessModel
from slamgym.dataset.curate.map_items import open_items
from slamgym.dataset.curate.verdicts import Verdict, read_verdicts, write_verdicts
from slamgym.dataset.faults import MapFault
from slamgym.envs import EpisodeConfig, ExploreConfig
from slamgym.interop import write_ros_map
from slamgym.slam import SlamConfig

QUICK = EpisodeConfig(minutes=0.2, env=ExploreConfig(slam=SlamConfig(mode="ground_truth")))


class Plans:
    """A closet that is seen at once, and a hall that isn't."""

    def __init__(self):
        self.plans = {
            "closet": FloorPlan("closet", box(0, 0, 1.6, 1.6)),
            "hall": FloorPlan("hall", box(0, 0, 14, 9).difference(box(6, 0, 6.2, 7))),
        }
        self.ids = list(self.plans)

    def __len__(self):
        return len(self.ids)

    def load(self, plan_id):
        return self.plans[plan_id]


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    root = tmp_path_factory.mktemp("clean") / "dataset"
    build_dataset(
        root,
        Plans(),
        DatasetConfig(seed=2, episode=QUICK),
        make_explorer,
        pairs=4,
        execution=Execution(engine="in_process"),
    )
    return root


@pytest.fixture
def dataset(built, tmp_path):
    return shutil.copytree(built, tmp_path / "dataset")


def clean(root, *more):
    return cli.main(["dataset", "clean", str(root), *map(str, more)])


def verdict_files(root):
    return {name: (root / name).read_bytes() for name in ("clean.jsonl", "clean.json")}


def decisions_file(path, **decided):
    """A file that says so about names; the digests are those of the dataset at hand."""
    root = path.parent / "dataset"
    digests = {record.name: record.sha256["B"] for record in read_manifest(root)}
    entries = [
        {"name": name, "decision": word, "sha256": digests.get(name, "")}
        for name, word in decided.items()
    ]
    path.write_text(json.dumps({"format": "slamgym-decisions", "version": 1, "decisions": entries}))
    return path


def by_plan(root):
    verdicts = read_verdicts(root)
    return {record.plan_id: verdicts[record.name] for record in read_manifest(root)}


def test_the_truth_decides_and_says_why(dataset, capsys):
    before = {path: path.read_bytes() for path in dataset.rglob("*") if path.is_file()}
    assert clean(dataset) == 0
    verdicts = by_plan(dataset)
    assert verdicts["closet"].keep
    assert verdicts["closet"].reason == "complete"
    hall = verdicts["hall"]
    assert not hall.keep
    assert hall.by == "truth"
    assert "< 0.95: time limit" in hall.reason
    assert hall.coverage is not None
    assert f"coverage {hall.coverage:.2f}" in hall.reason
    # One line for each pair, in the manifest's order, and nothing else was touched.
    assert list(read_verdicts(dataset)) == [record.name for record in read_manifest(dataset)]
    assert all(path.read_bytes() == content for path, content in before.items())
    shown = capsys.readouterr().out
    assert "4 maps, 2 kept (50.0 %)" in shown
    assert "2 dropped: coverage: time limit" in shown or "2 dropped: stuck" in shown
    assert "the classifier agrees with the truth on" in shown


def test_the_same_command_again_leaves_the_same_files_alone(dataset):
    assert clean(dataset) == 0
    first = verdict_files(dataset)
    stamps = [(dataset / name).stat().st_mtime_ns for name in first]
    assert clean(dataset) == 0
    assert verdict_files(dataset) == first
    assert [(dataset / name).stat().st_mtime_ns for name in first] == stamps


def test_an_interruption_keeps_the_old_files_and_workers_change_nothing(dataset, monkeypatch):
    assert clean(dataset, "--workers", 1) == 0
    expected = verdict_files(dataset)
    monkeypatch.setattr(cleaning, "_BATCH", 1)
    for name in expected:
        (dataset / name).unlink()
    assert clean(dataset, "--workers", 2) == 0
    assert verdict_files(dataset) == expected

    def interrupt(cells, resolution):
        raise KeyboardInterrupt

    monkeypatch.setattr(cleaning, "completeness_features", interrupt)
    assert clean(dataset, "--workers", 1) == 130
    assert verdict_files(dataset) == expected


def test_a_person_overrules_the_truth_and_is_remembered(dataset):
    names = {record.plan_id: record.name for record in read_manifest(dataset)}
    path = decisions_file(
        dataset.parent / "d.json", **{names["closet"]: "drop", names["hall"]: "keep"}
    )
    assert clean(dataset, "--apply", path) == 0
    verdicts = read_verdicts(dataset)
    assert (verdicts[names["closet"]].keep, verdicts[names["closet"]].reason) == (
        False,
        "dropped by a person",
    )
    assert (verdicts[names["hall"]].keep, verdicts[names["hall"]].by) == (True, "person")
    path.unlink()
    after = verdict_files(dataset)
    assert clean(dataset) == 0
    assert verdict_files(dataset) == after


def test_conflicts_and_unknown_maps_are_named_and_change_nothing(dataset, capsys):
    name = next(read_manifest(dataset)).name
    first = decisions_file(dataset.parent / "first.json", **{name: "drop"})
    second = decisions_file(dataset.parent / "second.json", **{name: "keep"})
    assert clean(dataset, "--apply", first) == 0
    before = verdict_files(dataset) | {"decisions": (dataset / "decisions.json").read_bytes()}
    for files, words in [
        ([first, second], "conflicting decisions about " + name),
        ([decisions_file(dataset.parent / "x.json", nobody="keep")], "no such maps: nobody"),
    ]:
        assert clean(dataset, "--apply", *files) == 2
        assert words in capsys.readouterr().err
    assert before == verdict_files(dataset) | {
        "decisions": (dataset / "decisions.json").read_bytes()
    }
    assert clean(dataset, "--apply", second) == 0
    assert read_verdicts(dataset)[name].reason == "kept by a person"


def test_the_classifier_decides_if_asked_and_the_band_waits_for_a_person(dataset, monkeypatch):
    items = open_items(dataset)
    monkeypatch.setattr(
        CompletenessModel, "probabilities", lambda *_: np.array([0.9, 0.5, 0.1, 0.8])
    )
    report = clean_maps(dataset, items, CleanConfig(by="classifier"), {})
    assert [verdict.keep for verdict in report.verdicts] == [True, False, False, True]
    assert [verdict.is_doubtful for verdict in report.verdicts] == [False, True, False, False]
    assert report.undecided == 1
    assert report.verdicts[1].reason.startswith("doubtful: probability 0.50")
    assert report.verdicts[2].reason == "incomplete: probability 0.10 of being complete < 0.40"
    assert {verdict.by for verdict in report.verdicts} == {"classifier"}
    report = clean_maps(dataset, items, CleanConfig(by="classifier", band=(0.4, 0.4)), {})
    assert [verdict.keep for verdict in report.verdicts] == [True, True, False, True]


def test_an_image_that_is_broken_is_a_verdict_and_not_the_end(dataset, capsys):
    name = next(read_manifest(dataset)).name
    Layout(dataset).image("B", name).write_bytes(b"no picture")
    assert clean(dataset) == 0
    verdict = read_verdicts(dataset)[name]
    assert (verdict.keep, verdict.by, verdict.probability) == (False, "file", None)
    assert "is not a picture" in verdict.reason
    assert "1 dropped: unreadable" in capsys.readouterr().out


def test_maps_from_elsewhere_are_judged_by_their_looks(tmp_path):
    frame = GridFrame(0.05, 0.0, 0.0, 140, 180)
    closed = np.full((140, 180), 205, np.uint8)
    closed[20:120, 20:160] = 0
    closed[21:119, 21:159] = 254
    half = closed.copy()
    half[:, 90:] = 205
    (tmp_path / "sub").mkdir()
    write_ros_map(tmp_path / "closed", OccupancyGrid(closed, frame))
    write_ros_map(tmp_path / "sub" / "half", OccupancyGrid(half, frame))
    (tmp_path / "notes.yaml").write_text("a: 1\n")
    assert clean(tmp_path) == 0
    verdicts = read_verdicts(tmp_path)
    assert list(verdicts) == ["closed", "sub/half"]
    assert verdicts["closed"].probability > verdicts["sub/half"].probability
    assert verdicts["sub/half"].coverage is None
    assert verdicts["sub/half"].is_complete is None
    assert not verdicts["sub/half"].keep
    assert not (tmp_path / ".lock").exists()


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--set", "band=[0.8, 0.4]"], "ascending order"),
        (["--model", "nowhere.json"], "nowhere.json"),
        (["--apply", "nowhere.json"], "nowhere.json"),
        (["--set", "min_coverage=2"], "min_coverage must be in [0, 1], not 2"),
    ],
)
def test_a_senseless_option_is_one_line_and_writes_nothing(dataset, capsys, more, words):
    assert clean(dataset, *more) == 2
    error = capsys.readouterr().err
    assert words in error.splitlines()[-1]
    assert error.splitlines()[-1].startswith("slamgym: error: ")
    assert not (dataset / "clean.jsonl").exists()


def test_a_folder_without_maps_is_refused(tmp_path, capsys):
    for folder in (tmp_path, tmp_path / "nowhere"):
        assert clean(folder) == 2
        assert str(folder) in capsys.readouterr().err


def test_verdicts_that_are_missing_or_malformed_are_named(tmp_path):
    with pytest.raises(InputFileError, match="slamgym dataset clean"):
        read_verdicts(tmp_path)
    (tmp_path / "clean.jsonl").write_text('{"name": "a", "faults": []}\n')
    with pytest.raises(InputFileError, match=r"clean\.jsonl:1"):
        read_verdicts(tmp_path)


def test_verdicts_of_an_older_version_are_refused(tmp_path):
    (tmp_path / "clean.jsonl").write_text('{"name": "a", "keep": true, "reason": "complete"}\n')
    with pytest.raises(InputFileError, match=r"clean\.jsonl:1: is not a verdict .*; run"):
        read_verdicts(tmp_path)


def test_what_a_verdict_says_is_read_back(tmp_path):
    fault = MapFault("coverage", 0.81, 0.95, "time_limit")
    verdict = Verdict(
        name="a", keep=False, reason=fault.sentence, by="truth", probability=None, is_doubtful=False,
        is_complete=False, coverage=0.81, ate=0.1, map_error=0.1, faults=(fault,),
    )  # fmt: skip
    write_verdicts(tmp_path, [verdict], {})
    (found,) = read_verdicts(tmp_path).values()
    assert found == verdict
    assert found.reason == "coverage 0.81 < 0.95: time limit"
    assert found.kind == "coverage: time limit"


def test_a_band_that_is_none_is_refused():
    with pytest.raises(ConfigError, match="band"):
        CleanConfig(band=(0.5, 1.5))


def test_dropped_maps_are_counted_by_their_first_fault():
    low, lower = (MapFault("coverage", value, 0.95, "time_limit") for value in (0.81, 0.1))
    shifted = MapFault("map_error", 0.41, 0.3)
    lost = MapFault("position_error", 1.02, 0.6)
    groups = [
        (low,),
        (lower, shifted),
        (shifted, lost),
        (MapFault("hardly_driven", 0.3, 1.0), lower),
    ]
    verdicts = tuple(
        Verdict(
            name=str(number), keep=False, reason="", by="truth", probability=None, is_doubtful=False,
            is_complete=False, coverage=None, ate=None, map_error=None, faults=faults,
        )
        for number, faults in enumerate(groups)
    )  # fmt: skip
    counted = CleanReport(verdicts, agreement=None).reasons()
    assert counted == {"coverage: time limit": 2, "map error": 1, "stuck": 1}
