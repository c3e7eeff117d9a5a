"""From plans to training images, and maps from logs and plans, by the commands that a user types."""

import json

import cv2
import pytest

from slamgym.cad import open_plans
from slamgym.cad.sources import BUNDLED
from slamgym.commands.cli import main
from slamgym.interop import read_ros_map, read_tum

PLANS = (
    "procedural:3",
    "procedural:home:3",
    "procedural:office:3",
    "procedural:loops:3",
    "bundled",
)


def slamgym(*words):
    assert main([str(word) for word in words]) == 0


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """Pairs by a recipe of varied conditions."""
    root = tmp_path_factory.mktemp("golden") / "dataset"
    slamgym(
        *("generate", "--plans", BUNDLED, "--recipe", "quick", "--pairs", 6, "--minutes", 0.6),
        *("--seed", 3, "--workers", 1, "-o", root),
    )
    (root / "contact_sheet.png").unlink()
    return root


def lines_of(path, *left_out):
    """The lines of a JSONL file without the fields that change with names, versions and compressors."""
    records = [json.loads(line) for line in path.read_text().splitlines()]
    return [
        {key: value for key, value in record.items() if key not in left_out} for record in records
    ]


def digests_of_pictures(golden, root):
    paths = sorted(root.rglob("*.png"))
    return {str(path.relative_to(root)): golden.digest(cv2.imread(str(path), -1)) for path in paths}


def test_generate_by_a_recipe(golden, dataset):
    golden.check("commands/generate/pairs", digests_of_pictures(golden, dataset))
    hashes = ("config_hash", "version", "sha256")
    golden.check("commands/generate/manifest", lines_of(dataset / "manifest.jsonl", *hashes))


def test_clean(golden, dataset, capsys):
    slamgym("dataset", "clean", dataset)
    golden.check("commands/clean", lines_of(dataset / "clean.jsonl"))
    slamgym("dataset", "clean", dataset, "--set", "by=classifier")
    golden.check("commands/clean by classifier", lines_of(dataset / "clean.jsonl"))
    (dataset / "clean.jsonl").unlink()
    (dataset / "clean.json").unlink()


def test_split_and_render(golden, dataset, tmp_path, capsys):
    slamgym("dataset", "split", dataset, "--test", 0.4, "--seed", 1)
    slamgym(
        "dataset",
        "render",
        dataset,
        "-o",
        tmp_path,
        "--min-coverage",
        0,
        "--workers",
        1,
        "--size",
        128,
    )
    golden.check("commands/render/pictures", digests_of_pictures(golden, tmp_path))
    golden.check("commands/render/manifest", lines_of(tmp_path / "manifest.jsonl", "sha256"))


def test_check_finds_no_fault(dataset, capsys):
    slamgym("dataset", "check", dataset)


def test_slam(golden, dataset, tmp_path, capsys):
    episode = sorted((dataset / "episodes").iterdir())[0]
    out = tmp_path / "map"
    slamgym("slam", episode, "-o", out, "--particles", 5, "--seed", 2)
    (grid,) = (read_ros_map(path) for path in sorted(out.glob("*.yaml")))
    measured = {
        path.name: golden.of_path(read_tum(path).poses) for path in sorted(out.glob("*.tum"))
    }
    golden.check("commands/slam", {"map": golden.of_cells(grid.cells), **measured})


def test_deform(golden, tmp_path, capsys):
    plan = open_plans("bundled").ids[3]
    out = tmp_path / "maps"
    slamgym(
        "deform",
        "bundled",
        "--method",
        "parametric",
        "--plan-id",
        plan,
        "-o",
        out,
        "--seed",
        4,
        "--size",
        128,
    )
    (episode,) = (out / "episodes").iterdir()
    measured = golden.of_cells(read_ros_map(episode / "map.yaml").cells)
    paths = {
        path.name: golden.of_path(read_tum(path).poses) for path in sorted(episode.glob("*.tum"))
    }
    golden.check("commands/deform/roadmap", {"map": measured, **paths})


@pytest.mark.parametrize("source", PLANS)
def test_plans(golden, source):
    plans = open_plans(source)
    for plan_id in plans.ids[:4]:
        plan = plans.load(plan_id)
        figures = {"area": round(plan.area, 4), "rooms": len(plan.rooms)}
        golden.check(
            f"plans/{plan_id}", {**figures, "raster": golden.of_cells(plan.raster(0.05).cells)}
        )
