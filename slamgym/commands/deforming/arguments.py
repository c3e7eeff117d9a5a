"""Arguments of ``slamgym deform``."""

from pathlib import Path
from typing import Annotated, Literal

import tyro

from slamgym.cad.plan_filter import PlanFilter
from slamgym.commands.frame import Out
from slamgym.core.config import Arguments, Count, CountOrZero, Positive, Within
from slamgym.core.errors import ConfigError
from slamgym.dataset.format import is_dataset
from slamgym.parametric.config import ConversionMethod, Equations

Method = Literal["parametric", "generator", "modelprog", "elastic"]
_OF_METHODS: dict[str, tuple[Method, ...]] = {
    "--conversion": ("parametric",),
    "--equations": ("parametric",),
    "--size": ("parametric",),
    "--resize": ("parametric",),
    "--severity": ("parametric",),
    "--recipe": ("generator",),
    "--trajectory": ("parametric", "generator"),
    "--prm-kind": ("parametric", "generator"),
    "--weights": ("modelprog",),
}
"""Options that not every method takes."""
_NOT_OF_DATASETS = (
    "--plans", "--plans-filter", "--plan-id", "--trajectory", "--prm-kind", "--recipe", "--size",
    "--resize",
)  # fmt: skip
"""Options about what the pairs of a dataset bring with them."""


class DeformArguments(Arguments):
    """Draw hypotheses of the SLAM map of a floor plan, as a dataset that `slamgym dataset render` takes.

    Without --trajectory, a path through all rooms is planned over a probabilistic roadmap. modelprog and
    elastic know no path: they bend the plan by a random field.
    """

    plan: tyro.conf.Positional[str]
    """A floor plan (HouseExpo JSON, ROS map, image), a folder or archive of plans, bundled or procedural; or a dataset
    that `slamgym generate` made, each pair of which is drawn again: same plan, path, robot and split."""

    out: Out
    """Folder of the dataset to make."""

    method: Method = "generator"
    """generator: the simulated robot's scans and mapper along the path; parametric: the paper's model; modelprog: the
    paper's network; elastic: the plan bent."""

    count: Annotated[Count, tyro.conf.arg(aliases=["-n"])] = 1
    """Number of hypotheses of each plan; each draws its own robot and, unless a file gives it, its own path."""

    plans: Count = 1
    """Number of plans of a folder or archive: the first that can be used."""

    plans_filter: PlanFilter = "none"
    """``useful`` takes homes that are worth exploring, as `slamgym generate` does."""

    plan_id: str | None = None
    """Which plan of a folder or archive; the first by default."""

    trajectory: Path | None = None
    """The true path: a .csv of waypoints x,y[,t] or a .tum of poses, in the world frame of the plan."""

    prm_kind: Literal["tour", "pair"] = "tour"
    """Through all rooms, or between two random points as in the paper."""

    recipe: str | None = None
    """Generator: robot, sensors, furniture, mapper and time as `slamgym generate --recipe` draws them: paper, real,
    reference or a YAML file. Without it the default robot in an empty building."""

    conversion: ConversionMethod | None = None
    """Parametric: conversion of odometry errors to map errors: ekf_schur (the default; EKF-SLAM's answer at once),
    ekf (the paper's filter, up to 128 px) or two_phase (dead reckoning)."""

    equations: Equations | None = None
    """Parametric: corrected (the default), or printed: the paper's LIDAR model with its misprints."""

    severity: Annotated[float, Within(ge=0.0, le=10.0)] = 1.0
    """Parametric: multiplies every error magnitude; 0 gives the CAD map back where the robot looked."""

    seed: CountOrZero = 0
    """Equal seeds give equal bytes."""

    resolution: Positive | None = None
    """[m/px]; 0.05 by default, or what a recipe or an exploration had."""

    size: Literal[0] | Annotated[int, Within(ge=16)] = 0
    """Parametric: side of the square map [px]; the resolution follows from the plan. 0 takes --resolution."""

    resize: Literal[0] | Annotated[int, Within(ge=16)] = 0
    """Parametric: enlarge the displacements of --size to a map of this side [px]; 0 doesn't."""

    weights: str | None = None
    """Modelprog: a pretrained name, a .safetensors file or a run's folder."""

    overwrite: bool = False
    """Replace a dataset of an earlier run."""

    def _check(self) -> None:
        if self.plan_id is not None and self.plans > 1:
            raise ConfigError("--plan-id and --plans exclude each other; give one")
        if self.resize and self.resize < self.size:
            raise ConfigError(f"--resize must be at least --size, {self.size}, not {self.resize}")
        given = self._given()
        for option, methods in _OF_METHODS.items():
            if self.method not in methods and option in given:
                raise ConfigError(
                    f"{option} has no effect with --method {self.method}; leave it out "
                    f"or take --method {' or '.join(methods)}"
                )
        if self.resize and not self.size:
            raise ConfigError(
                "--resize enlarges a map of --size; give --size, too, as in --size 64"
            )
        if is_dataset(self.plan):
            for option in _NOT_OF_DATASETS:
                if option in given:
                    raise ConfigError(
                        f"{option} has no effect on a dataset, whose pairs have it; leave it out"
                    )

    def _given(self) -> set[str]:
        """Those of the options which some runs don't take that differ from their defaults."""
        default = DeformArguments
        differs = {
            "--conversion": self.conversion != default.conversion,
            "--equations": self.equations != default.equations,
            "--size": self.size != default.size,
            "--resize": self.resize != default.resize,
            "--severity": self.severity != default.severity,
            "--recipe": self.recipe != default.recipe,
            "--trajectory": self.trajectory != default.trajectory,
            "--prm-kind": self.prm_kind != default.prm_kind,
            "--weights": self.weights != default.weights,
            "--plans": self.plans != default.plans,
            "--plans-filter": self.plans_filter != default.plans_filter,
            "--plan-id": self.plan_id != default.plan_id,
        }
        return {option for option, is_given in differs.items() if is_given}
