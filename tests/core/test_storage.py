import errno
import multiprocessing
import os

import pytest

from slamgym.core.errors import InputFileError
from slamgym.core.files import (
    StorageError,
    drop_torn_line,
    exclusive_lock,
    remove_leftovers,
    replace_file,
    staged,
    storage_errors,
)


def test_replace_file_leaves_nothing_else(tmp_path):
    path = tmp_path / "a.txt"
    replace_file(path, b"one")
    replace_file(path, b"two")
    assert path.read_bytes() == b"two"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_a_folder_is_no_file_to_write(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for path in (".", "..", tmp_path):
        with pytest.raises(StorageError, match="name a file"):
            replace_file(path, b"one")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.ENOSPC, "disk is full"),
        (errno.EACCES, "permission denied"),
        (errno.EROFS, "read-only"),
    ],
)
def test_a_disk_error_is_one_sentence_with_the_path_and_the_fix(tmp_path, number, words):
    with pytest.raises(StorageError, match=words) as caught, storage_errors(tmp_path):
        raise OSError(number, os.strerror(number))
    assert str(tmp_path) in str(caught.value)
    assert "\n" not in str(caught.value)


def _run_out_of_space(path):
    with staged(path) as part:
        part.write_bytes(b"half")
        raise OSError(errno.ENOSPC, "No space left on device")


def test_trouble_under_a_writer_of_another_layer_is_the_same_sentence(tmp_path):
    with pytest.raises(StorageError, match=r"map\.pgm: .*disk is full"), storage_errors(tmp_path):
        _run_out_of_space(tmp_path / "map.pgm")
    assert list(tmp_path.iterdir()) == []


def test_other_errors_pass_unchanged(tmp_path):
    with pytest.raises(InputFileError, match=r"plan\.json"), storage_errors(tmp_path):
        raise InputFileError("plan.json", "is empty")


def test_what_killed_writers_of_a_file_left_is_removed(tmp_path):
    left = [".manifest.7.part.jsonl", ".manifest.8.part.jsonl"]
    others = [".config.7.part.json", "manifest.7.part.jsonl", "manifest.jsonl"]
    for name in (*left, *others):
        (tmp_path / name).touch()
    remove_leftovers(tmp_path / "manifest.jsonl")
    assert sorted(path.name for path in tmp_path.iterdir()) == others


def _try_lock(path):
    try:
        with exclusive_lock(path):
            return "free"
    except StorageError as error:
        return str(error)


def test_a_log_is_cut_after_its_last_whole_line(tmp_path):
    path = tmp_path / "log"
    drop_torn_line(path)
    assert not path.exists()
    for content, whole in ((b"", b""), (b"torn", b""), (b"a\nb\n", b"a\nb\n"), (b"a\nb", b"a\n")):
        path.write_bytes(content)
        drop_torn_line(path)
        assert path.read_bytes() == whole


def test_only_one_process_holds_the_lock(tmp_path):
    path = tmp_path / ".lock"
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        with exclusive_lock(path):
            assert "another run" in pool.apply(_try_lock, (path,))
        assert pool.apply(_try_lock, (path,)) == "free"
