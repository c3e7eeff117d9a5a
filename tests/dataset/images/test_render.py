"""Rendering: uniform, traceable, resumable, the same whatever the number of workers."""

import dataclasses
import json
import shutil
import signal
import subprocess
import sys

import cv2
import numpy as np
import pytest
from shapely import box

from slamgym.cad import FloorPlan, write_houseexpo
from slamgym.commands import cli
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import temporary_name
from slamgym.dataset.curate.split import make_split, read_split
from slamgym.dataset.faults import MapFault
from slamgym.dataset.format import Layout, load_pair, read_manifest
from slamgym.dataset.images.format import ImageLayout, ImageRecord, load_images, read_images
from slamgym.dataset.images.render import JOURNAL, render_images, select_pairs
from slamgym.dataset.images.square_images import ImageConfig

CONFIG = ImageConfig(size=64)


@pytest.fixture
def dataset(dataset_copy):
    make_split(dataset_copy, test=0.4, seed=1)
    return dataset_copy


def render(dataset, out, config=CONFIG, min_coverage=0.0, workers=1):
    selection = select_pairs(dataset, min_coverage)
    return render_images(
        dataset, out, config, read_split(dataset), selection=selection, workers=workers
    )


def content(root):
    return {
        str(path.relative_to(root)): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file() and path.name not in (".lock", JOURNAL)
    }


def test_every_pair_is_there_once_on_the_side_of_its_plan(dataset, tmp_path):
    report = render(dataset, tmp_path / "images")
    pairs = {record.name: record for record in read_manifest(dataset)}
    images = read_images(tmp_path / "images")
    assert [image.name for image in images] == list(pairs)
    assert report.images == report.fresh == 8
    split = read_split(dataset)
    for image in images:
        pair = pairs[image.name]
        assert image.split == split.plans[image.plan_id].side
        assert (image.seed, image.repetition, image.plan_id) == (
            pair.seed,
            pair.repetition,
            pair.plan_id,
        )
        assert (image.coverage, image.ate, image.map_error) == (
            pair.coverage,
            pair.ate,
            pair.map_error,
        )
        assert image.conditions == pair.conditions
        cad, slam = load_images(tmp_path / "images", image)
        assert cad.shape == slam.shape == (64, 64)
        assert {0, 254} <= set(np.unique(cad)) <= set(range(255))
        assert set(np.unique(slam)) <= {0, 205, 254}
    assert (
        len(read_images(tmp_path / "images", "test"))
        + len(read_images(tmp_path / "images", "train"))
        == 8
    )


def test_images_lie_where_the_record_says(dataset, tmp_path):
    """A point of the full map and the pixel that the record's frame gives for it show the same."""
    render(dataset, tmp_path / "images", ImageConfig(size=256))
    for image in read_images(tmp_path / "images"):
        pair = next(record for record in read_manifest(dataset) if record.name == image.name)
        _, full = load_pair(dataset, image.name)
        cad, slam = load_images(tmp_path / "images", image)
        deep = cv2.erode((full == 254).astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
        row, col = image.frame.to_cell(*pair.frame.to_point(*np.nonzero(deep)))
        assert (slam[row, col] == 254).mean() > 0.99
        assert (cad[row, col] == 254).mean() > 0.8  # these maps have errors


def test_two_workers_and_a_second_run_give_the_same_bytes(dataset, tmp_path):
    render(dataset, tmp_path / "one")
    render(dataset, tmp_path / "two", workers=2)
    assert content(tmp_path / "one") == content(tmp_path / "two")
    before = content(tmp_path / "one")
    assert render(dataset, tmp_path / "one").fresh == 0
    assert content(tmp_path / "one") == before


def test_what_an_interrupted_run_left_is_made_whole(dataset, tmp_path):
    out = tmp_path / "images"
    render(dataset, out)
    whole = content(out)
    layout = ImageLayout(out)
    images = read_images(out)
    lines = (out / JOURNAL).read_text().splitlines(keepends=True)
    (out / JOURNAL).write_text("".join(lines[:5]) + lines[5][:40])  # killed in the middle of a line
    layout.manifest.unlink()
    layout.image(images[1].split, "B", images[1].name).write_bytes(b"")  # a power cut
    layout.image(images[2].split, "A", images[2].name).unlink()
    assert render(dataset, out).fresh == 3 + 2
    assert content(out) == whole


def test_a_plan_that_changes_sides_and_a_dropped_pair_leave_nothing_behind(dataset, tmp_path):
    out = tmp_path / "images"
    render(dataset, out)
    split = read_split(dataset)
    plans = {
        plan_id: dataclasses.replace(place, side="test" if place.side == "train" else "train")
        for plan_id, place in split.plans.items()
    }
    turned = dataclasses.replace(split, plans=plans)
    selection = select_pairs(dataset, 0.0)
    dropped = min(selection.kept)
    fewer = dataclasses.replace(
        selection,
        kept=selection.kept - {dropped},
        left_out={dropped: MapFault("not_clean", detail="why")},
    )
    report = render_images(dataset, out, CONFIG, turned, selection=fewer)
    assert report.fresh == report.images == 7
    assert report.left_out == {"not clean": 1}
    files = {path.stem for path in out.rglob("*.png")}
    assert dropped not in files
    assert len(list(out.rglob("*.png"))) == 14
    skipped = json.loads(ImageLayout(out).skipped.read_text())
    assert skipped == {"name": dropped, "reason": "not clean: why"}


def test_pairs_that_are_too_large_for_a_fixed_scale_are_named(dataset, tmp_path):
    config = ImageConfig(size=64, scaling="fixed", metres_per_px=0.06, margin_px=2)
    report = render(dataset, tmp_path / "images", config)
    assert 0 < report.images < 8
    assert report.left_out == {"too large": 8 - report.images}
    assert {image.metres_per_px for image in read_images(tmp_path / "images")} == {0.06}
    lines = [
        json.loads(line)
        for line in ImageLayout(tmp_path / "images").skipped.read_text().splitlines()
    ]
    assert all("m long but the image shows 3.6 m" in line["reason"] for line in lines)


def test_clean_decides_what_is_drawn(dataset, tmp_path):
    verdicts = [
        {"name": record.name, "keep": number % 2 == 0, "reason": "by hand", "by": "person",
         "probability": None, "is_doubtful": False, "is_complete": None,
         "coverage": None, "ate": None, "map_error": None, "faults": []}
        for number, record in enumerate(read_manifest(dataset))
    ]  # fmt: skip
    (dataset / "clean.jsonl").write_text(
        "".join(json.dumps(verdict) + "\n" for verdict in verdicts)
    )
    report = render_images(dataset, tmp_path / "images", CONFIG, read_split(dataset))
    assert report.images == 4
    assert report.left_out == {"not clean": 4}
    (dataset / "clean.jsonl").write_text(json.dumps(verdicts[0]) + "\n")
    with pytest.raises(ConfigError, match="run `slamgym dataset clean` again"):
        select_pairs(dataset)


def test_without_verdicts_coverage_decides(dataset):
    selection = select_pairs(dataset)
    for record in read_manifest(dataset):
        assert (record.name in selection.kept) == (record.coverage >= 0.95)
        assert (record.name in selection.left_out) == (record.coverage < 0.95)


def test_other_settings_and_other_folders_are_refused(dataset, tmp_path):
    out = tmp_path / "images"
    render(dataset, out)
    before = content(out)
    with pytest.raises(ConfigError, match=r"images\.size was 64, now 32"):
        render(dataset, out, ImageConfig(size=32))
    assert content(out) == before
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.tex").touch()
    with pytest.raises(ConfigError, match=r"thesis\.tex"):
        render(dataset, tmp_path / "other")


def test_a_run_that_was_killed_before_its_settings_were_there_goes_on(dataset, tmp_path):
    out = tmp_path / "images"
    out.mkdir()
    layout = ImageLayout(out)
    layout.lock.touch()
    temporary_name(layout.config).write_text('{"ver')
    render(dataset, out)
    assert len(read_images(out)) > 0
    assert not temporary_name(layout.config).exists()


def test_a_dataset_that_has_grown_needs_a_new_split(longer_small_dataset, tmp_path):
    grown = shutil.copytree(longer_small_dataset, tmp_path / "grown")
    table = make_split(grown, test=0.4, seed=1)
    assert len(read_split(grown).plans) == 4
    fewer = dataclasses.replace(table, plans={k: v for k, v in table.plans.items() if k != "hall"})
    with pytest.raises(ConfigError, match="doesn't know the plan 'hall'"):
        render_images(grown, tmp_path / "out", CONFIG, fewer, selection=select_pairs(grown, 0.0))
    report = render(grown, tmp_path / "images")
    assert report.images == 10


def test_a_missing_episode_file_is_named(dataset, tmp_path):
    name = next(iter(read_manifest(dataset))).name
    (Layout(dataset).episode(name) / "map.yaml").unlink()
    with pytest.raises(InputFileError, match=r"map\.yaml"):
        render(dataset, tmp_path / "images")


def test_the_command_makes_a_split_and_reports_what_is_left_out(dataset_copy, tmp_path, capsys):
    out = tmp_path / "images"
    command = [
        "dataset",
        "render",
        str(dataset_copy),
        "--out",
        str(out),
        "--size",
        "64",
        "--workers",
        "1",
    ]
    assert cli.main([*command, "--min-coverage", "0"]) == 0
    shown = capsys.readouterr()
    assert "8 pairs of images" in shown.out
    assert "no split.json yet" in shown.err
    assert (dataset_copy / "split.json").is_file()
    assert "| train |" in ImageLayout(out).card.read_text()
    assert cli.main([*command[:-4], "--min-coverage", "2"]) == 2
    assert "must lie in [0, 1]" in capsys.readouterr().err


@pytest.mark.parametrize(("test", "is_missed"), [("1.0", False), ("0.0", True)])
def test_a_side_without_pairs_is_missed_unless_all_are_for_testing(
    dataset_copy, tmp_path, capsys, test, is_missed
):
    assert cli.main(["dataset", "split", str(dataset_copy), "--test", test]) == 0
    command = [
        "dataset",
        "render",
        str(dataset_copy),
        "--out",
        str(tmp_path / "images"),
        "--size",
        "64",
    ]
    assert cli.main([*command, "--workers", "1", "--min-coverage", "0"]) == 0
    assert ("No pair is on the side" in capsys.readouterr().err) == is_missed


def test_generate_renders_too_and_goes_on_when_more_pairs_are_asked_for(tmp_path, capsys):
    out = tmp_path / "pairs"
    images = tmp_path / "images"
    for name in ("a", "b", "c"):
        write_houseexpo(
            tmp_path / "plans" / f"{name}.json", FloorPlan(name, box(0, 0, 3, 2 + ord(name) % 5))
        )
    command = ["generate", "--plans", str(tmp_path / "plans"), "--minutes", "0.3", "--set", "particles=3",
               "--engine", "in_process", "--out", str(out),
               "--images", str(images)]  # fmt: skip
    assert cli.main([*command, "--pairs", "2"]) == 0
    assert len(read_images(images)) == len(select_pairs(out).kept)
    assert cli.main([*command, "--pairs", "3"]) == 0
    assert "no split.json yet" in capsys.readouterr().err
    assert len(read_split(out).plans) == 3
    assert len(read_images(images)) == len(select_pairs(out).kept)
    assert cli.main([*command, "--shard", "0/2"]) == 2
    assert "render after the merge" in capsys.readouterr().err


DIES = """
import os, signal, sys
from slamgym.commands import cli
left = int(sys.argv[1])

def count_down(event, _):
    global left
    if event == "os.rename":
        left -= 1
        if left < 0:
            os.kill(os.getpid(), signal.SIGKILL)

sys.addaudithook(count_down)
sys.exit(cli.main(sys.argv[2:]))
"""


def test_killed_while_it_draws_a_run_goes_on(dataset, tmp_path):
    """Kill -9 rendering between two files; the end result is that of a run in peace."""
    peace = tmp_path / "peace"
    killed = tmp_path / "killed"
    size = ["--size", "64", "--min-coverage", "0", "--workers", "1"]
    assert cli.main(["dataset", "render", str(dataset), "--out", str(peace), *size]) == 0
    command = ["dataset", "render", str(dataset), "--out", str(killed), *size]
    images = []
    for renames in (3, 6):
        finished = subprocess.run([sys.executable, "-c", DIES, str(renames), *command], check=False)
        assert finished.returncode == -signal.SIGKILL
        images.append(len(list(killed.rglob("*.png"))))
    assert 0 < images[0] < images[1] < 16
    assert cli.main(command) == 0
    assert content(killed) == content(peace)


def test_a_record_of_images_survives_its_line(dataset, tmp_path):
    render(dataset, tmp_path / "images")
    record = read_images(tmp_path / "images")[0]
    assert ImageRecord.from_line(record.to_line()) == record
    with pytest.raises(InputFileError, match=r"split must be .*'both'"):
        ImageRecord.from_line(record.to_line().replace(f'"{record.split}"', '"both"', 1))
    with pytest.raises(InputFileError, match="holds no manifest"):
        read_images(tmp_path)
    layout = ImageLayout(tmp_path / "images")
    cv2.imwrite(str(layout.image(record.split, "A", record.name)), np.zeros((32, 32), np.uint8))
    with pytest.raises(InputFileError, match="has shape"):
        load_images(tmp_path / "images", record)
