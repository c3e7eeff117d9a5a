"""A parametric map of each conversion, a generated one of each kind of mapper, and a map bent by a random field."""

import numpy as np
import pytest

from slamgym.cad import open_plans
from slamgym.commands.deforming.hypotheses import square_around
from slamgym.envs import ExploreConfig
from slamgym.gan.translation.elastic import bend_with_field, drifted
from slamgym.parametric import ParametricConfig, deform, map_along_path, plan_trajectory
from slamgym.slam import SlamConfig


@pytest.fixture(scope="module")
def plan():
    return open_plans("bundled").load("home_000012")


def measured(golden, result):
    return {
        "map": golden.of_cells(result.grid.cells),
        "cad": golden.of_cells(result.cad.cells),
        # float32 is too coarse for a digest of rounded values: the next processor rounds a few to the other side.
        "field": np.round(result.field[:, ::80, ::80].astype(np.float64), 6).tolist(),
        "moved": round(float(np.hypot(*result.field)[result.seen].mean()), 6),
        "true": golden.of_path(result.true.poses),
        "odometry": golden.of_path(result.odometry.poses),
        "believed": golden.of_path(result.believed.poses),
    }


@pytest.mark.parametrize("method", ["two_phase", "ekf_schur"])
def test_deform(golden, plan, method):
    rng = np.random.default_rng(2)
    path = plan_trajectory(plan, rng, "pair")
    result = deform(plan, path, ParametricConfig(method=method), rng)
    golden.check(f"parametric/{method}/faithful", measured(golden, result))


def test_ekf_of_64_pixels(golden, plan):
    rng = np.random.default_rng(2)
    path = plan_trajectory(plan, rng, "pair")
    frame = square_around(plan, 64)
    result = deform(plan, path, ParametricConfig(method="ekf"), rng, frame)
    golden.check("parametric/ekf/small", measured(golden, result))


@pytest.mark.parametrize("mode", ["pose_graph", "rbpf"])
def test_map_along_path(golden, plan, mode):
    rng = np.random.default_rng(2)
    path = plan_trajectory(plan, rng, "pair")
    result = map_along_path(plan, path, ExploreConfig(slam=SlamConfig(mode=mode)), rng)
    golden.check(f"parametric/{mode}", measured(golden, result))


def test_elastic_bending(golden, plan):
    cad = plan.raster(0.1).cells
    golden.check(
        "elastic/slam", golden.of_cells(bend_with_field(cad, 0.1, np.random.default_rng(4))[0])
    )
    golden.check("elastic/cad", golden.of_cells(drifted(cad, 0.1, np.random.default_rng(4))))
