"""Why the paper's two conversions of odometry errors disagree: both, and variants, on the same random draws.

Each run draws one robot (wheels), drives a path through all rooms or between two points, and converts the odometry's
error to an error of the map. A row gives how far walls lie from their place, the correlation of that displacement with
the EKF's and with plain dead reckoning's, and the CPU time of the conversion.

Run: ``python benchmarks/parametric/parametric_conversions.py --plans PATH --count 8``.
"""

import argparse
import os
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy starts its threads

import numpy as np

from slamgym.cad import FloorPlan, open_plans
from slamgym.core.errors import SlamgymError
from slamgym.core.types import FREE, BoolArray, Float32Array, FloatArray, GridFrame
from slamgym.parametric import ParametricConfig, plan_trajectory
from slamgym.parametric.config import EkfConfig, ScannerView
from slamgym.parametric.landmarks import landmark_problem
from slamgym.parametric.lidar_error import LidarErrors
from slamgym.parametric.odometry_error import (
    WHEEL_BASE,
    Increments,
    PhaseErrors,
    WheelErrors,
    believed_increments,
    disturb,
    increments_of,
    integrate,
)
from slamgym.parametric.paths import pick_scans
from slamgym.parametric.schur_slam import solve_schur
from slamgym.parametric.visibility import observe
from slamgym.parametric.warp import displacements

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

MODULES = ("slamgym/parametric",)
"""What is measured."""

PIXELS = 256
CALIBRATION_SIDE = 4.0  # [m] of the square over which the paper's beta is measured
Placement = tuple[
    FloatArray | Float32Array, BoolArray
]  # displacement (2, H, W) [m] and where it is known


def runs_of(plan: FloorPlan, kind: str, seed: list[int]) -> dict[str, tuple[Placement, float]]:
    """All conversions of one run, with their CPU seconds."""
    config = ParametricConfig()
    rng = np.random.default_rng(seed)
    scans = pick_scans(plan_trajectory(plan, rng, kind), config.motion)  # type: ignore[arg-type]
    side = max(plan.bounds[2] - plan.bounds[0], plan.bounds[3] - plan.bounds[1])
    frame = GridFrame.covering(plan.bounds, side / (PIXELS - 8), 0.1)
    seen = observe(
        plan.raster(frame.resolution, frame).cells != FREE, frame, scans.poses, ScannerView()
    )
    poses, motion = scans.poses, increments_of(scans.poses)
    unit = rng.standard_normal(3)
    wheels = WheelErrors.of_unit(unit)
    believed, ratio = believed_increments(motion, wheels), wheels.wheel_base_ratio
    phases = PhaseErrors(
        wheels.scale - 1.0, (wheels.diameter_ratio - 1.0) / (ratio * WHEEL_BASE), 1.0 / ratio - 1.0
    )
    quiet = replace(config.two_phase, s_l=0.0, s_lt=0.0, s_t=0.0)
    found: dict[str, tuple[Placement, float]] = {}

    def timed(name: str, placement: Callable[[], Placement]) -> None:
        begun = time.process_time()
        found[name] = placement(), time.process_time() - begun

    def reckoned(increments: Increments) -> Placement:
        return displacements(poses, integrate(poses[0], increments), seen), seen.seen

    def landmarks(ekf: EkfConfig, noise: float = 1.0) -> Placement:
        draws = np.random.default_rng([*seed, 1])
        problem = landmark_problem(poses, believed, seen, LidarErrors(), ekf, draws, noise)
        estimate = solve_schur(problem)
        field, known = np.zeros((2, *frame.shape)), np.zeros(frame.shape, dtype=np.bool_)
        rows, cols = np.divmod(problem.cells, frame.width_px)
        field[:, rows, cols] = (problem.points - estimate.landmarks).T
        known[rows, cols] = True
        return field, known

    def no_information(factor: float) -> Placement:
        sigmas = factor * config.ekf.sigma_range, factor * config.ekf.sigma_bearing_deg
        ekf = replace(config.ekf, sigma_range=sigmas[0], sigma_bearing_deg=sigmas[1])
        return landmarks(ekf, noise=1.0 / factor)

    timed("EKF, Schur complement", lambda: landmarks(config.ekf))
    timed("EKF, Schur, all landmarks", lambda: landmarks(replace(config.ekf, landmarks_per_scan=0)))
    timed("EKF that trusts its scans a tenth", lambda: no_information(10.0))
    timed("EKF that trusts its scans a thousandth", lambda: no_information(1000.0))
    timed("dead reckoning of the wheels, (13)-(20)", lambda: reckoned(believed))
    rng_s = np.random.default_rng([*seed, 2])
    timed(
        "two-phase, same robot, no random part",
        lambda: reckoned(disturb(motion, phases, quiet, rng_s)),
    )
    timed(
        "two-phase, same robot", lambda: reckoned(disturb(motion, phases, config.two_phase, rng_s))
    )
    other = PhaseErrors.of_unit(config.two_phase, rng_s.standard_normal(3))
    timed(
        "two-phase, a robot of its own (before)",
        lambda: reckoned(disturb(motion, other, config.two_phase, rng_s)),
    )
    timed(
        "(14) as printed: beta per segment",
        lambda: reckoned(_beta_per_segment(motion, believed, wheels)),
    )
    twice = Increments(2.0 * believed.distance, believed.lateral, 2.0 * believed.turn)
    timed("(17) as printed: arc = gamma D", lambda: reckoned(twice))
    return found


def _beta_per_segment(motion: Increments, believed: Increments, wheels: WheelErrors) -> Increments:
    """The heading errs by the calibration's beta over every straight piece, however short."""
    straight = np.abs(motion.turn) < 1e-6
    piece = np.cumsum(np.diff(straight.astype(int), prepend=0) == 1)
    length = np.bincount(piece, np.where(straight, motion.distance, 0.0))[piece]
    beta = wheels.kappa * CALIBRATION_SIDE
    turn = believed.turn.copy()
    turn[straight] = beta * motion.distance[straight] / np.maximum(length[straight], 1e-9)
    return Increments(believed.distance, believed.lateral, turn)


def useful_plans(spec: str, count: int) -> list[FloorPlan]:
    """Homes of 40 to 120 m2, in a shuffled order."""
    source = open_plans(spec)
    ids = list(source.ids)
    np.random.default_rng(5).shuffle(ids)
    plans: list[FloorPlan] = []
    for plan_id in ids:
        try:
            plan = source.load(plan_id)
        except SlamgymError:
            continue
        if 40 <= plan.area <= 120 and 3 <= len(plan.rooms) <= 12:
            plans.append(plan)
        if len(plans) == count:
            break
    return plans


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plans", default="bundled")
    parser.add_argument("--count", type=int, default=8)
    parser.add_argument("--robots", type=int, default=2, help="of each plan")
    parser.add_argument("--path", choices=("tour", "pair"), default="tour")
    arguments = parser.parse_args()
    figures: dict[str, list[tuple[float, ...]]] = {}
    for number, plan in enumerate(useful_plans(arguments.plans, arguments.count)):
        for robot in range(arguments.robots):
            found = runs_of(plan, arguments.path, [number, robot])
            (ekf, known), _ = found["EKF, Schur complement"]
            (dead, _), _ = found["dead reckoning of the wheels, (13)-(20)"]
            for name, ((field, where), seconds) in found.items():
                both = known & where
                moved = float(np.sqrt((field[:, both] ** 2).sum(axis=0).mean()))
                of = [
                    float(np.corrcoef(field[:, both].ravel(), one[:, both].ravel())[0, 1])
                    for one in (ekf, dead)
                ]
                figures.setdefault(name, []).append((moved, *of, seconds))
    rows = []
    for name, values in figures.items():
        table = np.array(values)
        rms, by_ekf, by_dead = (
            f"{np.median(c):.3f} ({c.min():.3f}, {c.max():.3f})"
            if k == 0
            else f"{np.median(c):.2f} ({c.min():.2f}, {c.max():.2f})"
            for k, c in enumerate(table[:, :3].T)
        )
        rows.append((name, rms, by_ekf, by_dead, round(float(np.median(table[:, 3])), 3)))
    columns = (
        "conversion",
        "walls displaced, m rms",
        "correlation with EKF",
        "with dead reckoning",
        "CPU s",
    )
    runs = len(next(iter(figures.values())))
    title = (
        f"Conversions on the same draws, {runs} runs, path: {arguments.path}; median (least, most)"
    )
    print_and_save(
        f"parametric/parametric_conversions_{arguments.path}", title, rows, columns, MODULES
    )


if __name__ == "__main__":
    main()
