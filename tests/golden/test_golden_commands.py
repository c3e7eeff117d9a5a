"""Maps from logs and plans, and generated plans, by the commands that a user types."""

import pytest
from drawn_drives import FLAT, GEOMETRY, drive

from slamgym.cad import open_plans
from slamgym.commands.cli import main
from slamgym.interop import read_ros_map, read_tum, write_carmen

PLANS = (
    "procedural:3",
    "procedural:home:3",
    "procedural:office:3",
    "procedural:loops:3",
    "bundled",
)


def slamgym(*words):
    assert main([str(word) for word in words]) == 0


def test_slam(golden, tmp_path, capsys):
    log, _ = drive(FLAT, [(1.0, 1.0), (2.2, 1.0), (2.2, 2.3), (4.7, 2.3), (4.7, 3.7)], seed=2)
    path = tmp_path / "drive.log"
    write_carmen(path, list(log), GEOMETRY)
    out = tmp_path / "map"
    slamgym("slam", path, "-o", out, "--mode", "rbpf", "--particles", 5, "--seed", 2)
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
