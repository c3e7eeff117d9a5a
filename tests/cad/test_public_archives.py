"""The archive is fetched from a stand-in on this machine, verified and refused."""

import functools
import hashlib
import http.server
import json
import re
import shutil
import tarfile
import threading
from pathlib import Path
from typing import ClassVar

import pytest

from slamgym.cad import archives
from slamgym.cad.archives import HOUSEEXPO_LICENCE, HOUSEEXPO_URL, fetch_houseexpo
from slamgym.commands.cli import TABLE
from slamgym.core import streams
from slamgym.core.errors import InputFileError
from slamgym.core.streams import DownloadError, download


def main(argv):
    return TABLE.run("slamgym", ["plans", *map(str, argv)])


@pytest.fixture(autouse=True)
def _plain_server(monkeypatch):
    """The stand-in has no certificate."""
    monkeypatch.setattr(streams, "SCHEMES", ("http://127.0.0.1",))


SQUARE = {"verts": [[0, 0], [6, 0], [6, 6], [0, 6]], "room_category": {}, "room_num": 1}


class Server(http.server.SimpleHTTPRequestHandler):
    """Serves files; what it says of the first answers may be changed."""

    changes: ClassVar[list[dict]] = []
    answers: ClassVar[list[int]] = []

    def do_GET(self):
        try:
            data = Path(self.translate_path(self.path)).read_bytes()
        except OSError:
            self.send_error(404)
            return
        change = self.changes.pop() if self.changes else {}
        self.answers.append(len(data))
        self.send_response(change.get("status", 200))
        if "location" in change:
            self.send_header("Location", change["location"])
        self.send_header("Content-Length", change.get("length", str(len(data))))
        self.end_headers()
        self.wfile.write(data[: change.get("cut")])

    def log_message(self, *arguments):
        pass


@pytest.fixture
def served(tmp_path):
    """A folder, and the address under which its files are served."""
    folder = tmp_path / "served"
    folder.mkdir()
    Server.answers.clear()
    handler = functools.partial(Server, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield folder, f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


@pytest.fixture
def archive(served, tmp_path, monkeypatch):
    """An address that serves three plans, which are taken for all of HouseExpo."""
    folder, address = served
    plans = tmp_path / "json"
    plans.mkdir()
    for number in range(3):
        plan_id = f"{number:032x}"
        (plans / f"{plan_id}.json").write_text(json.dumps({"id": plan_id, **SQUARE}))
    with tarfile.open(folder / "json.tar.gz", "w:gz") as file:
        file.add(plans, "json")
    monkeypatch.setattr(archives, "MIN_HOUSEEXPO_PLANS", 3)
    return f"{address}/json.tar.gz"


def test_an_archive_is_fetched_once_and_its_digest_kept(archive, served, tmp_path):
    path = tmp_path / "mine" / "json.tar.gz"
    assert fetch_houseexpo(path, archive) == 3
    assert path.read_bytes() == (served[0] / "json.tar.gz").read_bytes()
    digest, name = (path.parent / "json.tar.gz.sha256").read_text().split()
    assert (digest, name) == (hashlib.sha256(path.read_bytes()).hexdigest(), "json.tar.gz")
    assert fetch_houseexpo(path, archive) == 3
    assert len(Server.answers) == 1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"cut": 100}, r"broke off \(after 100 of \d+ bytes\); run it again"),
        ({"status": 206}, r"can't be fetched \(206"),
        ({"status": 204}, r"can't be fetched \(204"),
    ],
)
def test_what_is_not_the_whole_file_is_refused_and_fetched_again(archive, tmp_path, change, words):
    path = tmp_path / "json.tar.gz"
    Server.changes.append(change)
    with pytest.raises(DownloadError, match=words):
        fetch_houseexpo(path, archive)
    assert not path.exists()
    assert fetch_houseexpo(path, archive) == 3
    assert [found.name for found in tmp_path.iterdir() if "part" in found.name] == []


@pytest.mark.parametrize("length", ["abc", "-5", ""])
def test_a_length_that_is_no_number_is_not_known(archive, served, tmp_path, length):
    Server.changes.append({"length": length})
    seen = []
    download(archive, tmp_path / "file", lambda done, total: seen.append((done, total)))
    assert (tmp_path / "file").read_bytes() == (served[0] / "json.tar.gz").read_bytes()
    assert seen == [(Server.answers[0], 0)]


def test_a_file_without_end_is_refused(archive, tmp_path, monkeypatch):
    monkeypatch.setenv("SLAMGYM_MAX_FILE_BYTES", "50")
    with pytest.raises(InputFileError, match="above the limit of 50"):
        download(archive, tmp_path / "file")
    assert not (tmp_path / "file").exists()


@pytest.mark.parametrize(
    "url", ["", "file:///etc/passwd", "http://[", "http://127.0.0.1:x/", "http://127.0.0.1/ä b"]
)
def test_what_is_no_address_is_refused(tmp_path, url):
    with pytest.raises(DownloadError, match="is no web address"):
        download(url, tmp_path / "file")


def test_another_archive_and_a_changed_one_are_refused(archive, tmp_path, monkeypatch):
    path = tmp_path / "json.tar.gz"
    with monkeypatch.context() as patch:
        patch.setattr(archives, "MIN_HOUSEEXPO_PLANS", 4)
        with pytest.raises(InputFileError, match="holds 3 plans and is not the public archive"):
            fetch_houseexpo(path, archive)
    fetch_houseexpo(path, archive)
    (tmp_path / "json" / f"{7:032x}.json").write_text(json.dumps(SQUARE))
    with tarfile.open(path, "w:gz") as file:
        file.add(tmp_path / "json", "json")
    with pytest.raises(InputFileError, match="has changed since it was fetched"):
        fetch_houseexpo(path, archive)


def test_the_command_shows_the_licence_and_says_what_is_wrong(
    archive, tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(archives, "HOUSEEXPO_URL", archive)
    monkeypatch.chdir(tmp_path)
    shutil.rmtree(tmp_path / "json")
    assert main(["fetch", "houseexpo"]) == 0
    shown = capsys.readouterr()
    printed = shown.out
    assert printed.startswith("HouseExpo")
    assert shown.err.count("json.tar.gz: 0 MB to download") == 1  # said first, and once
    assert "json.tar.gz: 3 plans" in printed
    monkeypatch.setattr(archives, "HOUSEEXPO_URL", archive + ".none")
    with pytest.raises(DownloadError, match="404"):
        main(["fetch", "--out", "other.tar.gz"])
    monkeypatch.setattr(archives, "HOUSEEXPO_URL", "http://127.0.0.1:9/json.tar.gz")
    with pytest.raises(
        DownloadError, match=r"can't be reached \(Connection refused\); is there a network\?"
    ):
        main(["fetch", "--out", "other.tar.gz"])


def test_the_licence_of_houseexpo_is_named():
    assert "MIT" in HOUSEEXPO_LICENCE


def test_houseexpo_is_fetched_from_a_commit_over_https(archive, tmp_path, monkeypatch):
    assert HOUSEEXPO_URL.startswith("https://")
    assert re.search("/[0-9a-f]{40}/", HOUSEEXPO_URL)
    monkeypatch.undo()
    with pytest.raises(DownloadError, match="give one that begins with https://"):
        download(archive, tmp_path / "file")


def test_a_server_that_leads_on_to_an_unsafe_address_is_refused(archive, tmp_path):
    Server.changes.append({"status": 302, "location": "http://example.org/json.tar.gz"})
    with pytest.raises(DownloadError, match="give one that begins with https://"):
        download(archive, tmp_path / "file")


def test_an_archive_of_another_digest_is_refused(archive, served, tmp_path):
    path = tmp_path / "json.tar.gz"
    with pytest.raises(InputFileError, match=r"has the SHA-256 [0-9a-f]{64}, not '0000"):
        fetch_houseexpo(path, archive, sha256="0" * 64)
    digest = hashlib.sha256((served[0] / "json.tar.gz").read_bytes()).hexdigest()
    assert fetch_houseexpo(path, archive, sha256=digest.upper()) == 3
