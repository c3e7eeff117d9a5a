"""Shards hold what the images hold, stream and resume."""

import json
import os
import subprocess
import sys
import tarfile

import pytest

from slamgym.commands import cli
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.dataset.images import pack
from slamgym.dataset.images.format import ImageLayout, read_images
from slamgym.dataset.images.pack import pack_images

pytest.importorskip("pyarrow")
STREAM = """
import json, os, sys
import datasets
datasets.disable_progress_bars()
files = {s: f"{sys.argv[1]}/{s}-*.tar" for s in ("train", "test")}
if sys.argv[2] == "folder":
    pack = datasets.load_dataset(sys.argv[1], streaming=True)
else:
    pack = datasets.load_dataset("webdataset", data_files=files, streaming=True)
if sys.argv[2] == "folder":
    rows = {s: [[r["name"], r["A"].size[0], r["B"].size[0]] for r in pack[s]] for s in pack}
else:
    rows = {s: [[r["json"]["name"], r["cad.png"].size[0], r["slam.png"].size[0]] for r in pack[s]] for s in pack}
print(json.dumps(rows), flush=True)
os._exit(0)  # threads of pyarrow may abort a process that ends while they read ahead
"""


@pytest.fixture
def small_shards(monkeypatch):
    monkeypatch.setattr(pack, "PAIRS_PER_SHARD", 3)


@pytest.mark.usefixtures("small_shards")
def test_the_shards_hold_every_pair_once_and_the_same_bytes_again(images, tmp_path):
    paths = pack_images(images, tmp_path / "pack")
    assert [p.name for p in paths[:4]] == [
        "train-000000.tar",
        "train-000000.parquet",
        "train-000001.tar",
        "train-000001.parquet",
    ]
    found = {}
    for path in paths[::2]:
        with tarfile.open(path) as tar:
            found |= {name: tar.extractfile(name).read() for name in tar.getnames()}
    records = read_images(images)
    assert len(found) == 3 * len(records) == 24
    for record in records:
        image = ImageLayout(images).image(record.split, "A", record.name)
        assert found[f"{record.name}.cad.png"] == image.read_bytes()
        assert json.loads(found[f"{record.name}.json"])["plan_id"] == record.plan_id
    before = {path: path.read_bytes() for path in paths}
    paths[0].unlink()
    stamp = paths[2].stat().st_mtime_ns
    assert pack_images(images, tmp_path / "pack") == paths
    assert {path: path.read_bytes() for path in paths} == before
    assert paths[2].stat().st_mtime_ns == stamp


def renamed(images, names):
    """Give the first pairs of the side ``train`` other names."""
    layout = ImageLayout(images)
    lines = [json.loads(line) for line in layout.manifest.read_text().splitlines()]
    for line, name in zip([line for line in lines if line["split"] == "train"], names, strict=False):
        for side in "AB":
            layout.image("train", side, line["name"]).rename(layout.image("train", side, name))
        line["name"] = name
    layout.manifest.write_text("".join(json.dumps(line) + "\n" for line in lines))


def test_names_with_dots_and_long_ones_have_keys_of_their_own(images, tmp_path):
    names = ["x.y", "x_y", "x%2Ey", "long" * 45, "straße"]
    renamed(images, names)
    pack_images(images, tmp_path / "pack")
    with tarfile.open(tmp_path / "pack" / "train-000000.tar") as tar:
        entries = {entry: tar.extractfile(entry).read() for entry in tar.getnames()}
    keys = {
        entry.partition(".")[0]: json.loads(entries[entry]) for entry in entries if entry.endswith(".json")
    }
    assert len(entries) == 3 * len(keys)
    assert set(names) <= {record["name"] for record in keys.values()}


def test_a_name_that_comes_twice_is_refused(images, tmp_path):
    manifest = ImageLayout(images).manifest
    lines = manifest.read_text().splitlines(keepends=True)
    manifest.write_text("".join([*lines, lines[0]]))
    with pytest.raises(InputFileError, match=r"manifest.jsonl: has the name .* twice"):
        pack_images(images, tmp_path / "pack")


@pytest.mark.usefixtures("small_shards")
@pytest.mark.parametrize("config", ["folder", "webdataset"])
def test_datasets_streams_the_folder(images, tmp_path, config):
    pytest.importorskip("datasets")
    pack_images(images, tmp_path / "pack")
    done = subprocess.run(
        [sys.executable, "-c", STREAM, str(tmp_path / "pack"), config],
        env=os.environ | {"HF_HOME": str(tmp_path / "home"), "HF_HUB_OFFLINE": "1", "HF_DATASETS_OFFLINE": "1"},
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    rows = json.loads(done.stdout)
    for split in ("train", "test"):
        assert sorted(rows[split]) == sorted([r.name, 64, 64] for r in read_images(images, split))


def test_other_images_a_foreign_folder_and_damage_are_refused(images, tmp_path, monkeypatch):
    pack_images(images, tmp_path / "pack")
    with monkeypatch.context() as patch:
        patch.setattr(pack, "PAIRS_PER_SHARD", 3)
        with pytest.raises(ConfigError, match="shards made with other settings"):
            pack_images(images, tmp_path / "pack")
    with pytest.raises(ConfigError, match="and no shards"):
        pack_images(images, images)
    record = read_images(images)[0]
    ImageLayout(images).image(record.split, "B", record.name).write_bytes(b"")
    with pytest.raises(InputFileError, match="differs from its digest"):
        pack_images(images, tmp_path / "again")


def test_the_command_packs(images, tmp_path, capsys):
    out = tmp_path / "pack"
    assert cli.main(["dataset", "pack", str(images), "-o", str(out)]) == 0
    assert "8 pairs in 4 files" in capsys.readouterr().out
    names = ["README.md", "pack.json", "parquet", "test-000000.tar", "train-000000.tar"]
    assert sorted(path.name for path in out.iterdir()) == names
