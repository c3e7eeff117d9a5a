"""Train the network of the explorer ``rl``: how much floor do frontiers hide?

By hindsight: explorations of training plans are logged (:mod:`slamgym.agents.rl.frontier_log`), of every frontier what
the robot knows and how much unseen floor truly lies behind it, nearer than behind the others. From these the network
learns how probable it is that a frontier hides 0.1, 0.3, 1, 3, 10 and 30 m2. Then ``rl`` explores validation plans with
smaller and smaller shares of risk, until 98 % are seen in 95 % of them.
"""

import dataclasses
import itertools
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from slamgym import __version__
from slamgym.agents.evaluation.trial import Task, TrialConfig, run_trial
from slamgym.agents.hidden_floor import AREAS, DESCRIPTION, FLOOR_LAYERS
from slamgym.agents.plan_groups import BUILDING_GROUPS, plans_of
from slamgym.agents.pretrained_policy import write_weights
from slamgym.agents.rl.frontier_log import logged
from slamgym.agents.rl.train_config import HiddenFloorConfig
from slamgym.agents.rules import TOUR_LOOP
from slamgym.agents.selective_tour import SelectiveTour
from slamgym.cad import FloorPlan
from slamgym.core.config import to_dict
from slamgym.core.files import append_line, own_folder, read_text
from slamgym.core.names import exploration_seed
from slamgym.core.progress import say
from slamgym.envs import ExploreConfig
from slamgym.sim import ClutterConfig

WEIGHTS = "hidden_floor.safetensors"
"""Name of the network in the folder of a run."""
RISKS = (0.25, 0.1, 0.03)
"""Shares of what a promise risks, tried one after the other."""
KINDS = ("furnished", "homes")
"""Groups of plans on which they are tried."""


def train_hidden_floor(config: HiddenFloorConfig, out: Path) -> None:
    """Log explorations, fit the network, and calibrate it.

    Args:
        config: The run.
        out: Its folder; explorations that it holds are not repeated.
    """
    weights = fit(list(logged(config, own_folder(out))), config)
    about = {"version": __version__, "training": to_dict(config)}
    for risk in RISKS:
        save(out / WEIGHTS, weights, about | {"risk": risk})
        if is_kept_often_enough(out / WEIGHTS, risk, config, out):
            break


def save(path: Path, weights: dict[str, Any], about: dict[str, Any]) -> None:
    """Write the network."""
    write_weights(
        path, weights, {"space": DESCRIPTION[0], "network": DESCRIPTION[1], "about": about}
    )


class Network(nn.Module):
    """The network in torch; figures are standardised first."""

    def __init__(self, figures: torch.Tensor) -> None:
        super().__init__()
        self.mean = figures.mean(dim=0)
        self.scale = figures.std(dim=0) + 1e-3
        self.layers = nn.ModuleDict({name: nn.Linear(*size) for name, size in FLOOR_LAYERS.items()})

    def forward(self, figures: torch.Tensor) -> torch.Tensor:
        """Logits of the areas, shape (B, areas)."""
        values = (figures - self.mean) / self.scale
        for name in ("first", "second"):
            values = nn.functional.dropout(
                torch.relu(self.layers[name](values)), 0.2, self.training
            )
        logits: torch.Tensor = self.layers["out"](values)
        return logits

    def exported(self) -> dict[str, Any]:
        """Weights that take in the figures as they are."""
        weights = {
            name: value.detach().numpy().copy() for name, value in self.layers.state_dict().items()
        }
        weights["first.weight"] /= self.scale.numpy()
        weights["first.bias"] -= weights["first.weight"] @ self.mean.numpy()
        return weights


def fit(explored: Sequence[dict[str, Any]], config: HiddenFloorConfig) -> dict[str, Any]:
    """Fit the network to logged explorations."""
    torch.manual_seed(config.seed)
    torch.set_num_threads(1)
    figures, areas = (
        torch.from_numpy(np.concatenate([one[name] for one in explored]))
        for name in ("figures", "areas")
    )
    hides = (areas[:, None] >= torch.tensor(AREAS)).float()
    network = Network(figures)
    batch = 256
    optimiser = torch.optim.AdamW(network.parameters(), weight_decay=0.1)
    steps = config.epochs * math.ceil(len(areas) / batch)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, 2e-3, total_steps=steps, pct_start=0.1
    )
    for _ in range(config.epochs):
        for rows in torch.randperm(len(areas)).split(batch):
            loss = nn.functional.binary_cross_entropy_with_logits(
                network(figures[rows]), hides[rows]
            )
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
    say(f"{len(areas)} frontiers of {len(explored)} explorations, loss {loss.item():.3f}")
    return network.exported()


def is_kept_often_enough(path: Path, risk: float, config: HiddenFloorConfig, out: Path) -> bool:
    """Explore until the promise is broken too often, or all is explored."""
    log = out / f"calibration-{risk:g}.jsonl"
    rows = [json.loads(line) for line in read_text(log).splitlines()] if log.exists() else []
    known = {(row["group"], row["plan"]): row for row in rows}
    broken = 0
    for name in KINDS:
        clutter = BUILDING_GROUPS[name].clutter
        plans = plans_of(config.plans, name, "validation")
        for number, plan in enumerate(itertools.islice(plans, config.calibrated_on)):
            row = known.get((name, plan.id))
            if row is None:
                found = explore_selectively(path, plan, clutter[number % len(clutter)])
                row = {"group": name, "plan": plan.id, **found}
                append_line(log, json.dumps(row) + "\n")
            broken += row["share"] > 0.02
            if broken > 0.05 * config.calibrated_on * len(KINDS):
                say(f"share of risk {risk:g}: broken in {broken}, the last one {name} {number}")
                return False
    say(f"share of risk {risk:g}: broken in {broken} of {config.calibrated_on * len(KINDS)}")
    return True


def explore_selectively(path: Path, plan: FloorPlan, clutter: ClutterConfig) -> dict[str, float]:
    """Explore a building with a network: the time [s], and the share of the floor that is missing at the end."""
    task = Task("rl", plan, exploration_seed(5, plan.id, 0))
    config = TrialConfig(env=ExploreConfig(clutter=clutter))
    loop = dataclasses.replace(TOUR_LOOP, promise=config.promise)
    trial = run_trial(task, config, lambda context: SelectiveTour(context, loop, path))
    return {"time": round(trial.time), "share": 1.0 - trial.coverage}
