"""A parametric map of each method and preset, and a map bent by a random field."""

import dataclasses

import numpy as np
import pytest

from slamgym.cad import open_plans
from slamgym.gan.translation.elastic import bend_with_field, drifted
from slamgym.parametric.config import preset
from slamgym.parametric.model import deform
from slamgym.parametric.paths import plan_trajectory

METHODS = ("two_phase", "ekf_schur", "scan_matching")


@pytest.fixture(scope="module")
def plan():
    return open_plans("bundled").load("home_000012")


@pytest.mark.parametrize("name", ["faithful", "realistic"])
@pytest.mark.parametrize("method", METHODS)
def test_deform(golden, plan, method, name):
    config = dataclasses.replace(preset(name), method=method)
    rng = np.random.default_rng(2)
    path = plan_trajectory(plan, rng, "pair")
    result = deform(plan, path, config, rng)
    measured = {
        "map": golden.of_cells(result.grid.cells),
        "cad": golden.of_cells(result.cad.cells),
        # float32 is too coarse for a digest of rounded values: the next processor rounds a few to the other side.
        "field": np.round(result.field[:, ::80, ::80].astype(np.float64), 6).tolist(),
        "moved": round(float(np.hypot(*result.field)[result.seen].mean()), 6),
        "true": golden.of_path(result.true.poses),
        "odometry": golden.of_path(result.odometry.poses),
        "believed": golden.of_path(result.believed.poses),
    }
    golden.check(f"parametric/{method}/{name}", measured)


def test_elastic_bending(golden, plan):
    cad = plan.raster(0.1).cells
    golden.check("elastic/slam", golden.of_cells(bend_with_field(cad, 0.1, np.random.default_rng(4))[0]))
    golden.check("elastic/cad", golden.of_cells(drifted(cad, 0.1, np.random.default_rng(4))))
