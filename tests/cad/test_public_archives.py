"""The archive is fetched from a stand-in on this machine, resumed, verified and refused."""

import functools
import hashlib
import http.server
import json
import shutil
import tarfile
import threading
from pathlib import Path
from typing import ClassVar

import pytest

from slamgym.cad.public_archives import PUBLIC_ARCHIVES, PublicArchive, fetch_plans
from slamgym.commands.plans import main
from slamgym.core.download import DownloadError, download
from slamgym.core.errors import InputFileError

SQUARE = {"verts": [[0, 0], [6, 0], [6, 6], [0, 6]], "room_category": {}, "room_num": 1}


class Server(http.server.SimpleHTTPRequestHandler):
    """Serves files with tags and ranges, as GitHub does; the first answer may break off."""

    breaks_after: ClassVar[list[int]] = []
    ranges: ClassVar[list[str | None]] = []

    def do_GET(self):
        path = self.translate_path(self.path)
        try:
            data = Path(path).read_bytes()
        except OSError:
            self.send_error(404)
            return
        tag = f'"{hashlib.md5(data).hexdigest()}"'
        wanted = self.headers.get("Range")
        self.ranges.append(wanted)
        first = int(wanted[6:-1]) if wanted and self.headers["If-Range"] == tag else 0
        self.send_response(206 if first else 200)
        self.send_header("ETag", tag)
        self.send_header("Content-Length", str(len(data) - first))
        self.end_headers()
        self.wfile.write(data[first:][: self.breaks_after.pop()] if self.breaks_after else data[first:])

    def log_message(self, *arguments):
        pass


@pytest.fixture
def served(tmp_path):
    """A folder, and the address under which its files are served."""
    folder = tmp_path / "served"
    folder.mkdir()
    Server.ranges.clear()
    handler = functools.partial(Server, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield folder, f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


@pytest.fixture
def archive(served, tmp_path):
    folder, address = served
    plans = tmp_path / "json"
    plans.mkdir()
    for number in range(3):
        plan_id = f"{number:032x}"
        (plans / f"{plan_id}.json").write_text(json.dumps({"id": plan_id, **SQUARE}))
    with tarfile.open(folder / "json.tar.gz", "w:gz") as file:
        file.add(plans, "json")
    return PublicArchive(f"{address}/json.tar.gz", "json.tar.gz", 3, 32, "none")


def test_an_archive_is_fetched_once_and_its_digest_kept(archive, served, tmp_path):
    path = tmp_path / "mine" / "json.tar.gz"
    assert fetch_plans(archive, path) == 3
    assert path.read_bytes() == (served[0] / "json.tar.gz").read_bytes()
    digest, name = (path.parent / "json.tar.gz.sha256").read_text().split()
    assert (digest, name) == (hashlib.sha256(path.read_bytes()).hexdigest(), "json.tar.gz")
    assert fetch_plans(archive, path) == 3
    assert len(Server.ranges) == 1


def test_a_download_that_broke_off_goes_on(archive, served, tmp_path):
    path, size = tmp_path / "json.tar.gz", (served[0] / "json.tar.gz").stat().st_size
    Server.breaks_after.append(100)
    with pytest.raises(DownloadError, match=r"broke off .*run it again"):
        fetch_plans(archive, path)
    assert not path.exists()
    assert size > 100
    assert fetch_plans(archive, path) == 3
    assert Server.ranges == [None, "bytes=100-"]
    assert sorted(found.name for found in tmp_path.iterdir() if "part" in found.name) == []


def test_a_changed_file_is_fetched_from_its_start(served, tmp_path):
    folder, address = served
    (folder / "file").write_bytes(b"a" * 500)
    Server.breaks_after.append(100)
    with pytest.raises(DownloadError):
        download(f"{address}/file", tmp_path / "file")
    (folder / "file").write_bytes(b"b" * 300)
    download(f"{address}/file", tmp_path / "file")
    assert (tmp_path / "file").read_bytes() == b"b" * 300


def test_another_archive_and_a_changed_one_are_refused(archive, served, tmp_path):
    path = tmp_path / "json.tar.gz"
    with pytest.raises(InputFileError, match="holds 3 plans and is not the public archive"):
        fetch_plans(PublicArchive(archive.url, "json.tar.gz", 4, 32, ""), path)
    fetch_plans(archive, path)
    (tmp_path / "json" / f"{7:032x}.json").write_text(json.dumps(SQUARE))
    with tarfile.open(path, "w:gz") as file:
        file.add(tmp_path / "json", "json")
    with pytest.raises(InputFileError, match="has changed since it was fetched"):
        fetch_plans(archive, path)


def test_the_command_shows_the_licence_and_says_what_is_wrong(archive, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(PUBLIC_ARCHIVES, "houseexpo", archive)
    monkeypatch.chdir(tmp_path)
    shutil.rmtree(tmp_path / "json")
    assert main(["fetch", "houseexpo"]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("none\n")
    assert "json.tar.gz: 3 plans" in printed
    with pytest.raises(DownloadError, match="404"):
        main(["fetch", "--url", archive.url + ".none", "--out", "other.tar.gz"])
    with pytest.raises(DownloadError, match=r"can't be reached \(Connection refused\); is there a network\?"):
        main(["fetch", "--url", "http://127.0.0.1:9/json.tar.gz", "--out", "other.tar.gz"])
    with pytest.raises(DownloadError, match="no web address"):
        main(["fetch", "--url", "file:///etc/passwd", "--out", "other.tar.gz"])


def test_the_licence_of_houseexpo_is_named():
    assert "MIT" in PUBLIC_ARCHIVES["houseexpo"].licence
    assert PUBLIC_ARCHIVES["houseexpo"].url.startswith("https://")
