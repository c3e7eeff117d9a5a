"""Every kind of damage is named, and a whole dataset has no fault."""

import gzip
import json
import shutil

import cv2
import numpy as np
import pytest

from slamgym.commands import cli
from slamgym.core.errors import InputFileError
from slamgym.dataset.check import check_dataset, check_image_folder
from slamgym.dataset.curate.split import make_split
from slamgym.dataset.format import Layout, read_manifest
from slamgym.dataset.images.format import ImageLayout, read_images


def test_a_whole_dataset_has_no_fault(dataset_copy):
    assert check_dataset(dataset_copy) == []
    make_split(dataset_copy)
    assert check_dataset(dataset_copy) == []


def test_a_whole_folder_of_images_has_no_fault(rendered):
    assert check_image_folder(rendered) == []


def write(path, image):
    cv2.imwrite(str(path), image)


def edit_line(path, number, **changes):
    lines = path.read_text().splitlines()
    lines[number] = json.dumps({**json.loads(lines[number]), **changes})
    path.write_text("\n".join(lines) + "\n")


# What is done to a dataset (its layout and the name of its second pair), and the faults that must be named.
DATASET_DAMAGE = {
    "image missing": (lambda t, n: t.image("B", n).unlink(), [r"B/{n}.png: is missing"]),
    "image changed": (
        lambda t, n: t.image("A", n).write_bytes(t.image("A", n).read_bytes() + b"x"),
        ["A/{n}.png: differs from the digest"],
    ),
    "image torn": (
        lambda t, n: t.image("A", n).write_bytes(t.image("A", n).read_bytes()[:20]),
        ["A/{n}.png: differs from the digest", "A/{n}.png: is not a picture"],
    ),
    "other shape": (lambda t, n: write(t.image("B", n), np.zeros((5, 6), np.uint8)), ["B/{n}.png: has shape (5, 6)"]),
    "colours": (lambda t, n: write(t.image("B", n), np.zeros((5, 6, 3), np.uint8)), ["not one channel of uint8"]),
    "grey in A": (
        lambda t, n: write(t.image("A", n), np.full((5, 6), 205, np.uint8)),
        ["A/{n}.png: has the pixel value 205; side A has 0, 254 only"],
    ),
    "episode missing": (lambda t, n: shutil.rmtree(t.episode(n)), ["episodes/{n}: is missing"]),
    "episode's file missing": (lambda t, n: (t.episode(n) / "truth.tum").unlink(), ["truth.tum: is missing"]),
    "episode's file changed": (
        lambda t, n: (t.episode(n) / "scans.log.gz").write_bytes(gzip.compress(b"x")),
        ["scans.log.gz: differs from its digest"],
    ),
    "episode's digests changed": (
        lambda t, n: (t.episode(n) / "SHA256SUMS").write_text(""),
        ["SHA256SUMS: differs from the digest", "doesn't list plan.json"],
    ),
    "episode's record changed": (
        lambda t, n: (t.episode(n) / "episode.json").write_text("{{}}\n"),
        ["episode.json: differs from the manifest's line"],
    ),
    "extra file in episode": (lambda t, n: (t.episode(n) / "notes.txt").touch(), ["notes.txt: is no file of"]),
    "extra file among images": (lambda t, n: (t.root / "A" / "cat.png").touch(), ["A/cat.png: is not in the manifest"]),
    "extra file among episodes": (lambda t, n: (t.episodes / "000099_x").mkdir(), ["000099_x: is not in the manifest"]),
    "work in progress": (lambda t, n: t.incoming.mkdir(), [".incoming: is what a run left"]),
    "manifest torn": (
        lambda t, n: t.manifest.write_text(t.manifest.read_text()[:-9]),
        ["ends in the middle of a line", "manifest.jsonl:8: is not valid JSON"],
    ),
    "manifest's line doubled": (
        lambda t, n: t.manifest.write_text(t.manifest.read_text() + t.manifest.read_text().splitlines()[1] + "\n"),
        ["has the name {n} twice", "has the seed", "order of the index", "is the same picture"],
    ),
    "manifest's line lost": (
        lambda t, n: t.manifest.write_text("".join(t.manifest.read_text().splitlines(keepends=True)[2:])),
        ["A/{n}.png: is not in the manifest", "episodes/{n}: is not in the manifest"],
    ),
    "seed changed": (lambda t, n: edit_line(t.manifest, 1, seed=5), ["{n}: its seed doesn't follow"]),
    "other settings": (lambda t, n: edit_line(t.manifest, 1, config_hash="0"), ["{n}: was made with other settings"]),
    "other plan": (lambda t, n: edit_line(t.manifest, 1, plan_id="x"), ["give another name", "seed doesn't follow"]),
    "settings missing": (lambda t, n: t.config.unlink(), ["config.json: is missing"]),
    "settings torn": (lambda t, n: t.config.write_text("{"), ["config.json: is not valid JSON"]),
    "settings of old format": (lambda t, n: t.config.write_text("{}"), ["config.json: has version None"]),
    "rejections torn": (lambda t, n: t.rejected.write_text("{\n"), ["rejected.jsonl:1: is not valid JSON"]),
    "split of fewer plans": (
        lambda t, n: (t.root / "split.json").write_text('{"seed": 0, "test": 0.1, "plans": {}}'),
        ["split.json: doesn't know 4 plans"],
    ),
    "split torn": (lambda t, n: (t.root / "split.json").write_text("{"), ["split.json: is not valid JSON"]),
    "verdicts torn": (lambda t, n: (t.root / "clean.jsonl").write_text("{\n"), ["clean.jsonl:1: is not valid JSON"]),
    "verdicts of fewer pairs": (lambda t, n: (t.root / "clean.jsonl").touch(), ["clean.jsonl: doesn't know 8 pairs"]),
}  # fmt: skip


@pytest.mark.parametrize("damage", DATASET_DAMAGE)
def test_damage_of_a_dataset_is_named(dataset_copy, damage):
    act, expected = DATASET_DAMAGE[damage]
    name = list(read_manifest(dataset_copy))[1].name
    act(Layout(dataset_copy), name)
    faults = "\n".join(map(str, check_dataset(dataset_copy)))
    for words in expected:
        assert words.format(n=name) in faults, faults


IMAGE_DAMAGE = {
    "image missing": (lambda t, r: t.image(r.split, "A", r.name).unlink(), ["A/{n}.png: is missing"]),
    "image changed": (
        lambda t, r: write(t.image(r.split, "B", r.name), np.zeros((64, 64), np.uint8)),
        ["B/{n}.png: differs from the digest"],
    ),
    "image torn": (lambda t, r: t.image(r.split, "B", r.name).write_bytes(b""), ["B/{n}.png: is not a picture"]),
    "grey in B": (
        lambda t, r: write(t.image(r.split, "B", r.name), np.full((64, 64), 100, np.uint8)),
        ["has the pixel value 100"],
    ),
    "other size": (
        lambda t, r: write(t.image(r.split, "A", r.name), np.zeros((32, 32), np.uint8)),
        ["has shape (32, 32)"],
    ),
    "extra file": (lambda t, r: (t.root / "train" / "A" / "x.png").touch(), ["train/A/x.png: is not in the manifest"]),
    "side moved": (
        lambda t, r: edit_line(t.manifest, 1, split="test" if r.split == "train" else "train"),
        ["has the plan {p} on both sides", "{n}.png: is missing", "metadata.jsonl: doesn't list"],
    ),
    "group on both sides": (
        lambda t, r: [edit_line(t.manifest, i, group="g") for i in range(8)],
        ["has the group of plans g on both sides"],
    ),
    "doubled": (
        lambda t, r: t.manifest.write_text(t.manifest.read_text() + r.to_line()),
        ["has the name {n} twice", "is the same picture"],
    ),
    "different sizes": (lambda t, r: edit_line(t.manifest, 1, size=32), ["different sizes: [32, 64]"]),
    "line torn": (lambda t, r: t.manifest.write_text(t.manifest.read_text()[:-4]), ["manifest.jsonl:8"]),
    "unknown split": (lambda t, r: edit_line(t.manifest, 1, split="val"), ["split must be 'train' or 'test'"]),
    "card missing": (lambda t, r: t.card.unlink(), ["README.md: is missing"]),
    "metadata missing": (lambda t, r: (t.root / "train" / "metadata.jsonl").unlink(), ["metadata.jsonl: is missing"]),
    "metadata torn": (
        lambda t, r: (t.root / "train" / "metadata.jsonl").write_text("{"),
        ["metadata.jsonl:1: is not valid JSON"],
    ),
    "settings torn": (lambda t, r: t.config.write_text("{"), ["config.json: is not valid JSON"]),
    "settings missing": (lambda t, r: t.config.unlink(), ["config.json: is missing"]),
    "settings of another version": (lambda t, r: t.config.write_text("{}"), ["config.json: has version None"]),
    "side missing": (lambda t, r: shutil.rmtree(t.root / r.split / "A"), ["/A: is missing"]),
}  # fmt: skip


@pytest.mark.parametrize("damage", IMAGE_DAMAGE)
def test_damage_of_rendered_images_is_named(images, damage):
    act, expected = IMAGE_DAMAGE[damage]
    record = read_images(images)[1]
    act(ImageLayout(images), record)
    faults = "\n".join(map(str, check_image_folder(images)))
    for words in expected:
        assert words.format(n=record.name, p=record.plan_id) in faults, faults


def test_all_faults_come_to_light_at_once(dataset_copy):
    for record in read_manifest(dataset_copy):
        Layout(dataset_copy).image("A", record.name).unlink()
    assert len(check_dataset(dataset_copy)) == 8


def test_the_command_has_an_exit_code(dataset_copy, images, tmp_path, capsys):
    assert cli.main(["dataset", "check", str(dataset_copy)]) == 0
    assert "8 pairs, no fault" in capsys.readouterr().out
    assert cli.main(["dataset", "check", str(images)]) == 0
    ImageLayout(images).card.unlink()
    assert cli.main(["dataset", "check", str(images)]) == 1
    assert "README.md: is missing" in capsys.readouterr().out
    assert cli.main(["dataset", "check", str(tmp_path / "nowhere")]) == 2
    with pytest.raises(InputFileError, match="no manifest"):
        check_dataset(tmp_path)
