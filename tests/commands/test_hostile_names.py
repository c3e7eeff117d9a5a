"""No command writes outside its output folder, whatever names a dataset, an archive or a folder of maps holds.

Around every attack lies a folder ``outside`` with files that an escape would reach; it must stay as it was.
"""

import io
import json
import shutil
import sys
import tarfile

import pytest
from commands.hostile import RUNS, SMALL, OnePlan, content_of, run
from shapely import box

from slamgym.agents.registry import make_explorer
from slamgym.cad import FloorPlan
from slamgym.cad.houseexpo import format_houseexpo
from slamgym.commands.cli import COMMANDS
from slamgym.core.errors import SlamgymError
from slamgym.core.files import append_line, drop_torn_line, exclusive_lock
from slamgym.dataset import Layout, build_dataset
from slamgym.dataset.images.format import ImageLayout

NAMES = {
    "absolute": "{outside}/x",
    "parent": "../x",
    "sibling": "../episodes/{name}",
    "out of the dataset": "../../outside/x",
    "dots": "..",
    "folder": "a/b",
    "backslash": "a\\b",
    "NUL": "a\0b",
    "hidden": ".lock",
    "empty": "",
    "long": "x" * 300,
}
DATASET = {
    "dataset check": ["dataset", "check", "{dataset}"],
    "dataset stats": ["dataset", "stats", "{dataset}"],
    "dataset show": ["dataset", "show", "{dataset}", "-o", "{out}/sheet.png"],
    "dataset clean": ["dataset", "clean", "{dataset}"],
    "dataset review": ["dataset", "review", "{dataset}", "-o", "{out}/review.html", "--which", "all"],
    "dataset split": ["dataset", "split", "{dataset}"],
    "dataset render": ["dataset", "render", "{dataset}", "-o", "{out}/images", "--min-coverage", "0", "--workers", "1"],
}  # fmt: skip
PLANS = {
    "plans list": ["plans", "list", "{plans}"],
    "plans check": ["plans", "check", "{plans}", "--rejected", "{out}/rejected.jsonl"],
    "plans draw": ["plans", "draw", "{plans}", "--out", "{out}/plans.png"],
    "plans write": ["plans", "write", "{plans}", "--out", "{out}/plans"],
    "generate": ["generate", "--plans", "{plans}", "--pairs", "1", "--minutes", "0.02", "--workers", "1", "--set",
                 "slam.mode=ground_truth", "--out", "{out}/dataset"],
    "deform": ["deform", "{plans}", "-o", "{out}/deformed"],
}  # fmt: skip
ELSEWHERE = {
    "dataset merge": "test_a_merge_takes_no_links_and_no_false_records",
    "merge": "names its files itself; tests/commands/test_merge_command.py",
    "agents train hidden-floor": "names its files itself; tests/agents/test_hidden_floor_training.py",
    "cad compare": "names its files itself; tests/commands/test_cad_compare_command.py",
    "cad draw": "names its files by the stems of the maps' own; tests/commands/test_cad_command.py",
    "agents record": "its id names the folder; tests/commands/test_record_command.py",
    "bench run": "names its files itself, of the track and of the entry made a file name; tests/agents/test_bench.py",
    "bench leaderboard": "writes the page that the command line names, and the JSON beside it",
    "ros2 sim": "writes nothing",
    "ros2 map": "names its files itself; tests/ros2/test_map_node.py",
    "ros2 merge": "names its files itself; tests/ros2/test_team.py",
    "ros2 explore": "names its files itself; tests/ros2/test_explore_node.py",
    "ros2 demo": "runs the other three",
    "drive": "writes the map that the command line names; tests/commands/test_drive_command.py",
    "dataset pack": "names its files itself, entries as the manifest does; tests/dataset/images/test_pack.py",
    "reproduce": "runs other commands on folders that it names itself",
    "plans fetch": "writes the file that the command line names; tests/cad/test_public_archives.py",
    "doctor": "reads and writes nothing of the user's",
    "warmup": "reads and writes nothing of the user's",
}  # fmt: skip


def test_every_command_is_tried_or_needs_no_trial():
    assert COMMANDS.keys() == {*DATASET, *PLANS, *RUNS, *ELSEWHERE}


@pytest.mark.parametrize("name", NAMES.values(), ids=NAMES)
def test_names_in_a_manifest_are_no_paths(place, capsys, name):
    layout = Layout(place / "dataset")
    first, *others = layout.manifest.read_text().splitlines(keepends=True)
    record = json.loads(first)
    record["name"] = name.format(outside=place / "outside", name=record["name"])
    layout.manifest.write_text(json.dumps(record) + "\n" + "".join(others))
    inside = content_of(place / "dataset")
    for command, words in DATASET.items():
        code, error = run(words, place, capsys)
        if command == "dataset check":
            assert code == 1, "a fault, and the checking goes on"
        else:
            assert code == 2
            assert "manifest.jsonl:1" in error
    assert content_of(place / "dataset").keys() - inside.keys() <= {".lock"}
    assert not list((place / "out").rglob("*.png"))


@pytest.mark.parametrize("name", NAMES.values(), ids=NAMES)
def test_names_in_the_journal_of_rendering_are_no_paths(place, capsys, name):
    assert run(DATASET["dataset render"], place, capsys)[0] == 0
    journal = ImageLayout(place / "out" / "images").root / ".rendered.jsonl"
    record = json.loads(journal.read_text().splitlines()[0])
    record["name"] = name.format(outside=place / "outside", name=record["name"])
    journal.write_text(json.dumps(record) + "\n")
    code, error = run(DATASET["dataset render"], place, capsys)
    assert code == 2
    assert "plain file name" in error


LINKS = {
    "dataset clean": ("clean.jsonl", "clean.json", ".lock"),
    "dataset split": ("split.json",),
    "dataset render": ("split.json",),
    "dataset show": ("contact_sheet.png",),
}


@pytest.mark.parametrize("command", LINKS)
@pytest.mark.parametrize("target", ["log", "fresh"])
def test_links_in_a_dataset_are_not_written_through(place, capsys, command, target):
    words = DATASET[command][:3] if command == "dataset show" else DATASET[command]
    for name in LINKS[command]:
        path = place / "dataset" / name
        path.unlink(missing_ok=True)
        path.symlink_to(place / "outside" / target)
        run(words, place, capsys)
        path.unlink()


@pytest.mark.parametrize(
    "name", ["A", "B", "episodes", "timing.jsonl", ".lock", ".incoming", "manifest.jsonl"]
)
def test_links_in_a_dataset_that_grows_are_not_written_through(place, name):
    path = place / "dataset" / name
    shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
    path.symlink_to(place / "outside" / ("log" if "." in name else ""))
    shutil.copytree(place / "outside" / "x", place / "outside" / "000009_x")
    before = content_of(place / "outside")
    try:
        build_dataset(place / "dataset", OnePlan(), SMALL, make_explorer, pairs=3)
    except SlamgymError as error:
        assert name in str(error)  # noqa: PT017 - a file may be replaced instead, which harms nothing
    assert content_of(place / "outside") == before


@pytest.mark.parametrize("name", ["train", "train/A", "test/B", ".rendered.jsonl", ".lock"])
def test_links_in_a_folder_of_images_are_not_written_through(place, capsys, name):
    assert run(DATASET["dataset render"], place, capsys)[0] == 0
    path = place / "out" / "images" / name
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    path.symlink_to(place / "outside" / ("log" if "." in name else ""))
    code, error = run(DATASET["dataset render"], place, capsys)
    assert code == 2
    assert "is a link" in error


def test_a_merge_takes_no_links_and_no_false_records(explored, place, capsys):
    words = ["dataset", "merge", "{parts}"]
    merged = place / "dataset" / "parts"
    shard = place / "dataset" / "parts" / "shard-00000-of-00002"

    def fresh():
        shutil.rmtree(merged, ignore_errors=True)
        shutil.copytree(explored / "parts", merged)
        return next(path for path in (shard / "episodes").iterdir())

    episode = fresh()
    (episode / "map.pgm").unlink()
    (episode / "map.pgm").symlink_to(place / "outside" / "log")
    assert run(words, place, capsys, parts=merged)[0] == 0
    assert not list((merged / "episodes").iterdir()), "a pair with a link is left out"

    episode = fresh()
    record = json.loads((episode / "episode.json").read_text())
    for change in (
        {"name": "../x"},
        {"index": -1},
        {"index": 7},
        {"plan_id": "../../x"},
        {"index": 10**12},
    ):
        fresh()
        (episode / "episode.json").write_text(json.dumps({**record, **change}) + "\n")
        code, error = run(words, place, capsys, parts=merged)
        assert code == 2
        assert "episode.json" in error

    fresh()
    shutil.move(shard, place / "kept")
    shard.symlink_to(place / "kept")
    code, error = run(words, place, capsys, parts=merged)
    assert code == 2
    assert "is a link" in error


PLAN_NAMES = {**NAMES, "odd": "Küche ~ 1. OG (alt)"}


@pytest.fixture(params=["archive", "lines"])
def hostile_plans(request, place):
    """Plans whose names lead elsewhere, in an archive and as lines."""
    names = [name.format(outside=place / "outside", name="x") for name in PLAN_NAMES.values()]
    # Plans of one name, or with a name too long, are refused before anything is written.
    names = [
        f"{name}{number}" if name.endswith("/x") else name for number, name in enumerate(names)
    ]
    names = [name for name in names if len(name) < 200]
    if request.param == "archive":
        path = place / "dataset" / "plans.tar.gz"
        with tarfile.open(path, "w:gz", format=tarfile.PAX_FORMAT) as archive:
            for name in names:
                content = format_houseexpo(FloorPlan(name, box(0, 0, 4.0, 1.6))).encode()
                member = tarfile.TarInfo(f"{name}.json")
                member.size = len(content)
                archive.addfile(member, io.BytesIO(content))
            link = tarfile.TarInfo("link.json")
            link.type = tarfile.SYMTYPE
            link.linkname = str(place / "outside" / "log")
            archive.addfile(link)
        return path
    path = place / "dataset" / "plans.jsonl"
    corners = [[0, 0], [80, 0], [80, 40], [0, 40]]
    room = {"polygon": corners, "label": "hall", "segments": []}
    lines = [{"name": name, "m_per_px": 0.05, "rooms": [room]} for name in names]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


@pytest.mark.parametrize("command", PLANS)
def test_names_of_plans_are_no_paths(place, capsys, hostile_plans, command):
    code, error = run(PLANS[command], place, capsys, plans=hostile_plans)
    if command == "plans write":
        written = list((place / "out" / "plans").rglob("*"))
        assert code == 0, error
        assert len(written) >= 5
        assert all(path.is_file() and path.parent == place / "out" / "plans" for path in written)
    if command == "generate":
        assert code == 0, error
        (pair,) = Layout(place / "out" / "dataset").episodes.iterdir()
        assert len(pair.name) <= 200


@pytest.mark.skipif(sys.platform == "win32", reason="links need rights there")
def test_logs_and_locks_are_no_links(tmp_path):
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere")
    for write in (lambda path: append_line(path, "x\n"), drop_torn_line):
        with pytest.raises(SlamgymError, match="is a link"):
            write(tmp_path / "link")
    with pytest.raises(SlamgymError, match="is a link"), exclusive_lock(tmp_path / "link"):
        pass
    assert not (tmp_path / "elsewhere").exists()
