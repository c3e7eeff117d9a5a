import json
from dataclasses import fields

import cv2
import numpy as np
import pytest

from slamgym.core.errors import InputFileError
from slamgym.dataset import (
    Layout,
    PairRecord,
    load_pair,
    read_dataset_config,
    read_images,
    read_manifest,
)

RECORD = PairRecord(
    name="000003_flat",
    index=3,
    plan_id="flat",
    plan_source="flat.json",
    repetition=0,
    seed=12,
    config_hash="0123456789ab",
    version="0.1.0",
    explorer="explore_lite",
    conditions={"explorer": "explore_lite", "clutter.furniture": 0.5},
    finished="explored",
    coverage=0.99,
    robot_seconds=61.2,
    time_limit=420.0,
    path_length=12.5,
    collisions=0,
    ate=0.05,
    odometry_ate=0.2,
    final_position_error=0.04,
    map_error=0.02,
    mse=0.1,
    area=52.0,
    rooms=4,
    resolution=0.05,
    origin=(-3.0, -2.5),
    shape=(120, 140),
    start=(3.5, 3.0, 0.1),
    sha256={"A": "aa", "B": "bb"},
)


def test_a_record_survives_its_line():
    assert PairRecord.from_line(RECORD.to_line()) == RECORD
    assert RECORD.to_line().count("\n") == 1


def test_every_field_of_a_record_is_in_its_line():
    assert set(json.loads(RECORD.to_line())) == {field.name for field in fields(PairRecord)}


def test_the_frame_places_the_image():
    assert RECORD.frame.shape == (120, 140)
    assert RECORD.frame.bounds == pytest.approx((-3.0, -2.5, 4.0, 3.5))


def test_a_malformed_line_is_named_by_file_and_number(tmp_path):
    manifest = Layout(tmp_path).manifest
    manifest.write_text(RECORD.to_line() + "{torn\n")
    with pytest.raises(InputFileError, match=r"manifest\.jsonl:2"):
        list(read_manifest(tmp_path))
    manifest.write_text(json.dumps({"name": "x"}) + "\n")
    with pytest.raises(InputFileError, match=r"manifest\.jsonl:1"):
        list(read_manifest(tmp_path))


def test_an_unknown_field_is_named_with_a_suggestion():
    line = RECORD.to_line().replace('"coverage"', '"coverge"')
    with pytest.raises(InputFileError, match="did you mean 'coverage'"):
        PairRecord.from_line(line)


@pytest.mark.parametrize(
    "change", [{"coverage": 7.0}, {"ate": -1.0}, {"area": 1e308}, {"resolution": 0.0}]
)
def test_a_senseless_figure_is_refused(change):
    line = json.dumps(json.loads(RECORD.to_line()) | change)
    with pytest.raises(
        InputFileError, match=f"is not a record of a pair .{next(iter(change))} must be"
    ):
        PairRecord.from_line(line)


def test_a_folder_without_a_dataset_is_said_to_be_one(tmp_path):
    with pytest.raises(InputFileError, match="no manifest"):
        list(read_manifest(tmp_path))
    with pytest.raises(InputFileError, match=r"config\.json"):
        read_dataset_config(tmp_path)


def test_a_dataset_and_its_images_are_distinguished(tmp_path):
    dataset = tmp_path / "dataset"
    images = tmp_path / "images"
    (images / "train").mkdir(parents=True)
    (dataset / "episodes").mkdir(parents=True)
    with pytest.raises(InputFileError, match="holds rendered images; name the dataset"):
        list(read_manifest(images))
    with pytest.raises(InputFileError, match="holds explorations; make images of them"):
        read_images(dataset)
    with pytest.raises(InputFileError, match="nowhere: is no folder"):
        list(read_manifest(tmp_path / "nowhere"))


def _write_image(root, side, shape):
    path = Layout(root).image(side, "000003_flat")
    path.parent.mkdir()
    cv2.imwrite(str(path), np.full(shape, 205, np.uint8))


def test_a_pair_is_read_as_it_was_written(tmp_path):
    _write_image(tmp_path, "A", (4, 6))
    _write_image(tmp_path, "B", (4, 6))
    cad, slam = load_pair(str(tmp_path), "000003_flat")
    assert cad.shape == slam.shape == (4, 6)
    assert (cad == 205).all()


def test_a_missing_image_and_unequal_shapes_are_named(tmp_path):
    _write_image(tmp_path, "A", (4, 6))
    with pytest.raises(InputFileError, match=r"B/000003_flat\.png"):
        load_pair(tmp_path, "000003_flat")
    _write_image(tmp_path, "B", (4, 7))
    with pytest.raises(InputFileError, match="shape"):
        load_pair(tmp_path, "000003_flat")
    cv2.imwrite(str(Layout(tmp_path).image("A", "000003_flat")), np.zeros((4, 7, 3), np.uint8))
    with pytest.raises(InputFileError, match=r"A/000003_flat\.png: has colours"):
        load_pair(tmp_path, "000003_flat")
