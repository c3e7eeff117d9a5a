"""Whatever lies in a dataset's files, reading them gives a value or an error that the user can fix."""

import dataclasses
import json

import numpy as np
import pytest
import yaml
from fuzz.mutations import (
    cases,
    must_read_or_refuse,
    mutated_bytes,
    mutated_json,
    mutated_lines,
    mutated_value,
)
from hypothesis import given
from hypothesis import strategies as st

from slamgym.commands.dataset.clean import _band
from slamgym.core.config import to_dict
from slamgym.core.pictures import encode_png
from slamgym.dataset.check import check_dataset, check_image_folder
from slamgym.dataset.curate.completeness import FEATURES
from slamgym.dataset.curate.completeness_model import PRETRAINED_MODEL, CompletenessModel
from slamgym.dataset.curate.map_items import open_items
from slamgym.dataset.curate.review import (
    DECISIONS_FILE,
    Decision,
    decisions_document,
    stored_decisions,
)
from slamgym.dataset.curate.split import PlanSide, SplitTable, current_split, read_split
from slamgym.dataset.curate.verdicts import Verdict, read_verdicts
from slamgym.dataset.faults import Criteria, MapFault, record_faults
from slamgym.dataset.folder import read_rejected, read_times
from slamgym.dataset.format import Layout, read_dataset_config, read_manifest
from slamgym.dataset.generate.recipe import RECIPES, DatasetConfig, open_recipe
from slamgym.dataset.images.format import ImageRecord, read_images
from slamgym.dataset.images.render import _read_journal, select_pairs
from slamgym.dataset.manifest_file import ManifestFile
from slamgym.dataset.record import PairRecord
from slamgym.dataset.statistics import dataset_statistics, describe_pairs

RECORD = PairRecord(
    name="000000_hall", index=0, plan_id="hall", plan_source="plans.tar.gz", repetition=0, seed=1,
    config_hash="0" * 12, version="0.1.0", explorer="nearest",
    conditions={"explorer": "nearest", "clutter.furniture": 0.2, "slam.particles": 5}, finished="explored",
    coverage=0.99, robot_seconds=60.0, time_limit=300.0, path_length=20.0, collisions=0, ate=0.05,
    odometry_ate=0.2, final_position_error=0.05, map_error=0.02, mse=0.01, area=20.0, rooms=2, resolution=0.05,
    origin=(-1.0, -1.0), shape=(8, 8), start=(1.0, 1.0, 0.0), sha256={"A": "0", "B": "1", "episode": "2"},
)  # fmt: skip
SECOND = dataclasses.replace(RECORD, name="000001_hall", index=1, repetition=1, seed=2)
IMAGE = ImageRecord.of_pair(RECORD, RECORD.frame, "train", "hall", {"A": "0", "B": "1"})
VERDICT = Verdict(
    RECORD.name, False, "coverage", "truth", 0.5, True, False, 0.9, 0.1, 0.02,
    (MapFault("coverage", 0.9, 0.95, "explored"),),
)  # fmt: skip
SPLIT = SplitTable(
    0, 0.1, {"hall": PlanSide("test", "hall"), "room": PlanSide("train", "room")}, ("hall",)
)
REJECTED = {
    "index": 3,
    "plan_id": "x",
    "repetition": 0,
    "seed": 1,
    "error": "PlanError",
    "reason": "too small",
}
TIMES = {"name": RECORD.name, "cpu_seconds": 3.0, "wall_seconds": 4.0}
CONFIG = {"format_version": 2, "version": "0.1.0", "plans": [], **to_dict(DatasetConfig())}


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    """A dataset of two pairs without their explorations."""
    layout = Layout(tmp_path_factory.mktemp("fuzzed"))
    for side in ("A", "B"):
        (layout.root / side).mkdir()
        for record in (RECORD, SECOND):
            layout.image(side, record.name).write_bytes(encode_png(np.zeros((8, 8), np.uint8)))
    layout.episodes.mkdir()
    layout.config.write_text(json.dumps(CONFIG))
    layout.manifest.write_text(RECORD.to_line() + SECOND.to_line())
    return layout.root


@pytest.fixture(scope="module")
def images(tmp_path_factory):
    """A folder of rendered images without a picture."""
    root = tmp_path_factory.mktemp("images")
    for side in ("train/A", "train/B", "test/A", "test/B"):
        (root / side).mkdir(parents=True)
    (root / "config.json").write_text('{"images_version": 1}')
    return root


@cases(100)
@given(mutated_lines([to_dict(RECORD), to_dict(SECOND)]))
def test_manifests(root, content):
    manifest = Layout(root).manifest
    before = manifest.read_bytes()
    manifest.write_bytes(content)
    try:
        must_read_or_refuse(check_dataset, root)
        must_read_or_refuse(describe_pairs, root)
        must_read_or_refuse(select_pairs, root)
        must_read_or_refuse(dataset_statistics, root)
        must_read_or_refuse(ManifestFile, manifest)
        records = must_read_or_refuse(lambda: list(read_manifest(root)))
        for record in records or []:
            record_faults(record, Criteria())
            assert record.frame.shape == record.shape
            assert "/" not in record.slot.name
            assert Layout(root).episode(record.name).parent == Layout(root).episodes
        for item in must_read_or_refuse(open_items, root) or []:
            must_read_or_refuse(item.load)
    finally:
        manifest.write_bytes(before)


@cases(100)
@given(mutated_lines([to_dict(IMAGE)]))
def test_manifests_of_images(images, content):
    (images / "manifest.jsonl").write_bytes(content)
    (images / ".rendered.jsonl").write_bytes(content)
    for split in ("train", "test"):
        (images / split / "metadata.jsonl").write_bytes(content)
    must_read_or_refuse(check_image_folder, images)
    must_read_or_refuse(_read_journal, type("Layout", (), {"root": images}))
    for record in must_read_or_refuse(read_images, images) or []:
        assert record.frame.shape == (record.size, record.size)


@cases(100)
@given(
    mutated_lines(
        [dataclasses.asdict(VERDICT), dataclasses.asdict(VERDICT) | {"name": SECOND.name}]
    )
)
def test_verdicts(root, content):
    (root / "clean.jsonl").write_bytes(content)
    for verdict in (must_read_or_refuse(read_verdicts, root) or {}).values():
        assert isinstance(verdict.kind, str)
        [fault.sentence for fault in verdict.faults]
    must_read_or_refuse(select_pairs, root)
    (root / "clean.jsonl").unlink()


@cases(100)
@given(mutated_json([{"settings": {"band": [0.4, 0.8]}}]))
def test_summaries_of_cleaning(root, content):
    (root / "clean.json").write_bytes(content)
    must_read_or_refuse(_band, root)


@cases(100)
@given(
    mutated_json(
        [json.loads(decisions_document([Decision("a", True, "0"), Decision("b", False, "1")]))]
    )
)
def test_decisions(root, content):
    (root / DECISIONS_FILE).write_bytes(content)
    for name, decision in (must_read_or_refuse(stored_decisions, root) or {}).items():
        assert name == decision.name


@cases(100)
@given(mutated_json([to_dict(SPLIT)]))
def test_splits(root, content):
    (root / "split.json").write_bytes(content)
    split = must_read_or_refuse(read_split, root)
    if split is not None:
        assert sorted(split.of_side("train") + split.of_side("test")) == sorted(split.plans)
        must_read_or_refuse(current_split, root)
    (root / "split.json").unlink(missing_ok=True)


@cases(100)
@given(mutated_json([CONFIG]))
def test_settings_of_datasets(root, content):
    config = Layout(root).config
    before = config.read_bytes()
    config.write_bytes(content)
    try:
        must_read_or_refuse(read_dataset_config, root)
        must_read_or_refuse(check_dataset, root)
    finally:
        config.write_bytes(before)


@cases(100)
@given(mutated_lines([REJECTED, {**REJECTED, "index": 4}]), mutated_lines([TIMES]))
def test_rejections_and_times(root, rejected, times):
    layout = Layout(root)
    layout.rejected.write_bytes(rejected)
    layout.timing.write_bytes(times)
    entries = must_read_or_refuse(read_rejected, layout.rejected) or {}
    assert all({"plan_id", "error"} <= entry.keys() for entry in entries.values())
    must_read_or_refuse(lambda path: list(read_times(path)), layout.timing)
    must_read_or_refuse(describe_pairs, root)
    layout.rejected.unlink()
    layout.timing.unlink()


RECIPE = yaml.safe_load((RECIPES / "reference.yaml").read_text())


@cases(100)
@given(st.data())
def test_recipes(root, data):
    path = root / data.draw(st.sampled_from(["recipe.yaml", "recipe.json"]))
    value = data.draw(mutated_value([RECIPE]))
    as_yaml = path.suffix == ".yaml" and data.draw(st.booleans())
    text = yaml.safe_dump(value) if as_yaml else json.dumps(value)
    content = text.encode(errors="replace")
    path.write_bytes(
        data.draw(mutated_bytes([content])) if data.draw(st.integers(0, 7)) == 0 else content
    )
    recipe = must_read_or_refuse(open_recipe, str(path))
    if recipe is not None:
        assert set(recipe.draw(7)) <= recipe.settings


@cases(100)
@given(st.data())
def test_models_of_completeness(root, data):
    path = root / "model.json"
    path.write_bytes(data.draw(mutated_json([json.loads(PRETRAINED_MODEL.read_text())])))
    model = must_read_or_refuse(CompletenessModel.read, path)
    if model is not None:
        found = model.probabilities(np.zeros((2, len(FEATURES))))
        assert ((found >= 0.0) & (found <= 1.0)).all()
