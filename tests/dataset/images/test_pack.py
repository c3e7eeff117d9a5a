"""Packed images are the images, in Parquet or WebDataset, with card, licence and checksums."""

import hashlib
import io
import json
import re
import shutil
import tarfile

import pytest
import yaml

from slamgym.commands import cli
from slamgym.dataset.images.format import ImageLayout, read_images


def pack(images, out, *more):
    return cli.main(["dataset", "pack", str(images), "-o", str(out), "--licence", "mit", *more])


def pictures_of(images, split):
    layout = ImageLayout(images)
    return {
        record.name: [layout.image(split, side, record.name).read_bytes() for side in "AB"]
        for record in read_images(images, split)
    }


def test_parquet_holds_the_pictures_and_figures_of_each_side(images, tmp_path):
    pytest.importorskip("datasets")
    parquet = pytest.importorskip("pyarrow.parquet")
    out = tmp_path / "packed"
    assert pack(images, out, "--pairs-per-shard", "2") == 0
    for split in ("train", "test"):
        paths = sorted((out / "data").glob(f"{split}-*.parquet"))
        rows = [row for path in paths for row in parquet.read_table(path).to_pylist()]
        assert {row["name"]: [row[side]["bytes"] for side in "AB"] for row in rows} == pictures_of(
            images, split
        )
        records = {record.name: record for record in read_images(images, split)}
        for row in rows:
            assert row["metres_per_px"] == records[row["name"]].metres_per_px
            assert json.loads(row["conditions"]) == records[row["name"]].conditions
        assert all(parquet.read_table(path).num_rows <= 2 for path in paths)
        about = json.loads(parquet.read_schema(paths[0]).metadata[b"huggingface"])
        assert about["info"]["features"]["A"]["_type"] == "Image"


# Its reader leaves its files to the garbage collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_webdataset_holds_the_same(images, tmp_path):
    webdataset = pytest.importorskip("webdataset")
    out = tmp_path / "packed"
    assert pack(images, out, "--kind", "webdataset") == 0
    for split in ("train", "test"):
        (path,) = (out / "data").glob(f"{split}-*.tar")
        samples = list(webdataset.WebDataset(str(path), shardshuffle=False))
        found = {
            json.loads(sample["json"])["name"]: [sample["a.png"], sample["b.png"]]
            for sample in samples
        }
        assert found == pictures_of(images, split)


@pytest.mark.parametrize("kind", ["parquet", "webdataset"])
def test_card_and_checksums_are_of_what_lies_there_and_a_second_run_gives_the_same(
    images, tmp_path, kind
):
    pytest.importorskip("datasets")
    pytest.importorskip("webdataset")
    notice = tmp_path / "notice.txt"
    notice.write_text("MIT License\n")
    sums = []
    for name in ("one", "two"):
        out = tmp_path / name
        assert pack(images, out, "--kind", kind, "--notice", str(notice)) == 0
        sums.append((out / "SHA256SUMS").read_text())
        listed = dict(reversed(line.split("  ", 1)) for line in sums[-1].splitlines())
        files = {
            path.relative_to(out).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in out.rglob("*")
            if path.is_file() and path.name != "SHA256SUMS"
        }
        assert listed == files
        assert {"README.md", "LICENSE"} <= set(files)
    assert sums[0] == sums[1]
    _, head, body = (tmp_path / "one" / "README.md").read_text().split("---\n", 2)
    about = yaml.safe_load(head)
    assert about["license"] == "mit"
    for entry in about["configs"][0]["data_files"]:
        assert list((tmp_path / "one").glob(entry["path"]))
    assert "licences apply" in body
    assert "$" not in body


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda images, out: out.mkdir() or (out / "x").write_text(""), "is not empty"),
        (lambda images, out: out.write_text(""), "is not empty"),
        (lambda images, out: damage(images), "differs from its digest"),
        (lambda images, out: shutil.rmtree(images), "slamgym dataset render"),
        (lambda images, out: (images / "README.md").unlink(), "README.md"),
    ],
)
def test_mistakes_are_one_line_and_leave_nothing(images, tmp_path, capsys, spoil, words):
    pytest.importorskip("datasets")
    out = tmp_path / "packed"
    spoil(images, out)
    before = sorted(tmp_path.iterdir())
    assert pack(images, out) == 2
    error = capsys.readouterr().err
    assert words in re.sub(r"\s+", " ", error)
    assert len([line for line in error.splitlines() if line.startswith("slamgym: error")]) == 1
    assert sorted(tmp_path.iterdir()) == before


def damage(images):
    from PIL import Image

    record = read_images(images)[0]
    path = ImageLayout(images).image(record.split, "B", record.name)
    buffer = io.BytesIO()
    Image.new("L", (record.size, record.size)).save(buffer, "png")
    path.write_bytes(buffer.getvalue())


def test_a_licence_that_is_no_name_is_refused(images, tmp_path, capsys):
    assert (
        cli.main(["dataset", "pack", str(images), "-o", str(tmp_path / "p"), "--licence", "My own"])
        == 2
    )
    assert "--licence must be a name" in capsys.readouterr().err
    assert not (tmp_path / "p").exists()


def test_tar_entries_have_no_time_and_no_owner_of_this_machine(images, tmp_path):
    pytest.importorskip("webdataset")
    assert pack(images, tmp_path / "packed", "--kind", "webdataset") == 0
    for path in (tmp_path / "packed" / "data").iterdir():
        with tarfile.open(path) as archive:
            assert {entry.mtime for entry in archive} == {0}
