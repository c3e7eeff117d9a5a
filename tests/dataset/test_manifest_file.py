"""The manifest stays whole, sorted and true while pairs come and go."""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.dataset import manifest_file
from slamgym.dataset.manifest_file import ManifestFile


@pytest.fixture(autouse=True, scope="module")
def no_waiting_for_the_disk():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("slamgym.core.files.os.fsync", lambda _: None)
        yield


def line(index):
    return (json.dumps({"name": f"{index:06d}_plan", "index": index}) + "\n").encode()


def listed(path):
    return [json.loads(text)["index"] for text in path.read_bytes().splitlines()]


@settings(max_examples=30)
@given(
    batches=st.lists(st.lists(st.integers(0, 60), max_size=12), max_size=5), limit=st.integers(1, 8)
)
def test_lines_are_merged_in_order(tmp_path_factory, batches, limit):
    path = tmp_path_factory.mktemp("manifest") / "manifest.jsonl"
    whole = set()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(manifest_file, "MOST_FRESH_LINES", limit)
        for batch in batches:
            manifest = ManifestFile(path)
            assert set(manifest.listed) == whole
            for index in batch:
                manifest.add(index, line(index))
            manifest.write()
            whole |= set(batch)
            assert path.read_bytes() == b"".join(line(index) for index in sorted(whole))


@settings(max_examples=30)
@given(before=st.sets(st.integers(0, 40)), now=st.sets(st.integers(0, 40)))
def test_it_agrees_with_the_folder_whatever_was_lost_or_removed(tmp_path_factory, before, now):
    path = tmp_path_factory.mktemp("manifest") / "manifest.jsonl"
    path.write_bytes(b"".join(line(index) for index in sorted(before)))
    manifest = ManifestFile(path)
    read = []
    manifest.agree_with(now, lambda index: read.append(index) or line(index))
    manifest.write()
    assert listed(path) == sorted(now)
    assert set(read) == now - before  # only what is new is read


@pytest.mark.parametrize(
    "text", ["no json\n", '{"name": "torn', "[1]\n", '{"index": 3}\n{"index": 1}\n']
)
def test_a_manifest_that_was_edited_is_written_again(tmp_path, text):
    path = tmp_path / "manifest.jsonl"
    path.write_text(text)
    manifest = ManifestFile(path)
    manifest.agree_with({1, 2}, line)
    manifest.write()
    assert listed(path) == [1, 2]


def test_an_unchanged_manifest_is_not_touched(tmp_path):
    path = tmp_path / "manifest.jsonl"
    path.write_bytes(line(1) + line(2))
    before = path.stat().st_mtime_ns
    ManifestFile(path).write()
    assert path.stat().st_mtime_ns == before
