"""``slamgym gan texture``: train the network of ``slamgym deform --method generator`` on simulated explorations."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro

from slamgym.core.config import Arguments, CountOrZero, NonNegative, Positive, from_dict
from slamgym.core.errors import InputFileError
from slamgym.core.png import read_png
from slamgym.core.progress import say
from slamgym.core.types import Trajectory

if TYPE_CHECKING:
    from slamgym.gan.texture.training import TextureExample


class TextureArguments(Arguments):
    """Train the network that draws maps for `slamgym deform --method generator`.

    Ctrl-C loses at most the minutes since the last checkpoint; the same command again goes on from there, for as
    many minutes more.
    """

    datasets: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Datasets that `slamgym generate` has made, with their episodes; maps of 5 cm cells are learnt from."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder of the run: checkpoint and weights."""
    minutes: Positive = 60.0
    """CPU time of this run [min]."""
    checkpoint_minutes: NonNegative = 2.0
    """Between two checkpoints [min]."""
    seed: CountOrZero = 0
    """Of weights, order and augmentation."""


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    arguments = tyro.cli(TextureArguments, args=argv, prog="slamgym gan texture")
    from slamgym.gan.texture.training import TextureTrainingConfig, train_texture

    examples = [example for root in arguments.datasets for example in read_examples(root)]
    if not examples:
        raise InputFileError(
            arguments.datasets[0], "holds no map of 5 cm cells whose exploration can be redone"
        )
    say(f"{len(examples)} maps")
    config = TextureTrainingConfig(seed=arguments.seed)
    loss = train_texture(examples, arguments.out, config, arguments.minutes, arguments.checkpoint_minutes)
    sys.stdout.write(f"loss {loss:.4f} nat a cell: {arguments.out}\n")
    return 0


def read_examples(root: Path) -> Iterator[TextureExample]:
    """What error-free scans would have counted along the path that SLAM believed, and what it drew.

    Furniture is what the exploration's seed draws again; people are left out.
    """
    from slamgym.cad import open_plans
    from slamgym.dataset.format import Layout, read_dataset_config, read_manifest
    from slamgym.dataset.generate.recipe import apply_conditions
    from slamgym.envs import ExploreEnv
    from slamgym.envs.episode import EpisodeConfig, fitted_env
    from slamgym.gan.texture.training import TextureExample
    from slamgym.interop import read_tum
    from slamgym.parametric.config import SensingConfig
    from slamgym.parametric.robot_scans import style_of, take_scans, texture_channels
    from slamgym.parametric.trajectory import from_recorded

    layout = Layout(root)
    settings = read_dataset_config(root)
    if "episode" not in settings:
        raise InputFileError(root, "was not made by `slamgym generate`; the network learns from explorations")
    base = from_dict(EpisodeConfig, settings["episode"], str(layout.config))
    for record in read_manifest(root):
        if abs(record.resolution - 0.05) > 1e-9:
            continue
        folder = layout.episode(record.name)
        plans = open_plans(str(folder / "plan.json"))
        plan = plans.load(plans.ids[0])
        env = apply_conditions(base, record.conditions).env
        furniture = np.empty((0, 4))
        if not env.clutter.is_empty:
            explored = ExploreEnv(plan, fitted_env(plan, env, 1.0))
            explored.reset(seed=record.seed, options={"plan": plan})
            if np.hypot(explored.start.x - record.start[0], explored.start.y - record.start[1]) > 1e-3:
                continue  # made by another version: its furniture is not known
            furniture = explored.clutter.segments()
        truth, estimate = (read_tum(folder / f"{name}.tum") for name in ("truth", "estimate"))
        world = Trajectory(truth.stamps, truth.poses + np.array([*record.start[:2], 0.0]))
        path = from_recorded(world).pick(np.searchsorted(truth.stamps, estimate.stamps - 1e-6))
        scans = take_scans(plan, furniture, path, env.lidar, np.random.default_rng(record.index))
        yield TextureExample(
            texture_channels(scans, estimate.poses, record.frame, env.slam),
            style_of(SensingConfig(env.lidar, env.clutter, env.slam)),
            read_png(layout.image("B", record.name)),
        )
